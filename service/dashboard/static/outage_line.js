/** The outages of a problem over the segments of its reference, and what each realization flies. */

import { svg } from "./dom.js";
import { lookOf } from "./flight.js";
import { number } from "./format.js";
import { SvgFigure } from "./svg_figure.js";
import { colour } from "./theme.js";

/**
 * @typedef {{ outage: { segment: number, duration_days: number } | null, n_segments: number, first_variable: number,
 *   n_variables: number, matchpoint: number, leaves: "forward" | "backward" | null }} Shape
 */

const ROW_PX = 26;
const BAR_PX = 12;

export class OutageFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Outages over the segments");
  }

  /**
   * @param {Shape[]} trajectories
   * @param {number} nSegments
   * @param {string} segmentation
   */
  show(trajectories, nSegments, segmentation) {
    const own = segmentation === "adaptive" ? "as many segments as are left" : "as many segments as the reference";
    const words =
      trajectories.length > 1
        ? `The outage (orange) begins with its segment; its realization takes over there, coasts, and has ${own}. The missed segment is drawn, whatever the outage lasts. ◆ where the halves of a trajectory meet.`
        : "The reference alone: no outage is to be survived. ◆ where its halves meet.";
    this.figure.show((width) => drawing(trajectories, nSegments, width), words);
  }
}

/**
 * @param {Shape[]} trajectories
 * @param {number} n
 * @param {number} width
 */
function drawing(trajectories, n, width) {
  const left = width < 500 ? 84 : 190;
  const isNarrow = width < 500;
  const x = (/** @type {number} */ segment) => left + (segment / n) * (width - left - 10);
  const bottom = 10 + trajectories.length * ROW_PX;
  const content = ticks(n, width).map((segment) =>
    svg(
      "g",
      {},
      svg("line", { x1: x(segment), x2: x(segment), y1: 4, y2: bottom, stroke: colour("line") }),
      svg("text", { x: x(segment), y: bottom + 16, "text-anchor": "middle", "font-size": 11, fill: colour("muted") }, segment),
    ),
  );
  content.push(svg("text", { x: left, y: bottom + 32, "font-size": 11.5, fill: colour("muted") }, `end of segment, of ${n}`));
  trajectories.forEach((shape, i) => content.push(row(shape, i, x, left, isNarrow, n)));
  return { height: bottom + 38, content };
}

/**
 * @param {Shape} shape
 * @param {number} i
 * @param {(segment: number) => number} x
 * @param {number} left
 * @param {boolean} isNarrow
 * @param {number} n
 */
function row(shape, i, x, left, isNarrow, n) {
  const y = 10 + i * ROW_PX;
  const { color } = lookOf(i);
  const from = shape.outage ? shape.outage.segment - 1 : 0;
  const name = shape.outage ? `${i}: segment ${shape.outage.segment}, ${number(shape.outage.duration_days, 1, "d")}` : "reference";
  const short = shape.outage ? `${i}: ${shape.outage.segment}, ${number(shape.outage.duration_days, 1, "d")}` : "reference";
  // The missed segment is not flown again, so the realization's own ones begin after it.
  const begin = shape.outage ? shape.outage.segment : 0;
  const meets = begin + ((shape.matchpoint - 1) / shape.n_segments) * (n - begin);
  const told = shape.outage
    ? `Realization ${i}: outage of ${number(shape.outage.duration_days, 2, "d")} from the start of segment ${shape.outage.segment}; leaves the ${shape.leaves} half of the reference; ${shape.n_segments} segments of its own.`
    : `Reference: ${shape.n_segments} segments.`;
  const middle = y + BAR_PX / 2;
  return svg(
    "g",
    { "data-trajectory": i },
    svg("title", {}, told),
    svg("text", { x: left - 10, y: middle + 4, "text-anchor": "end" }, isNarrow ? short : name),
    i > 0 && svg("line", { x1: x(0), x2: x(from), y1: middle, y2: middle, stroke: colour("line-strong"), "stroke-dasharray": "2 4" }),
    svg("rect", { x: x(begin), y, width: Math.max(1, x(n) - x(begin)), height: BAR_PX, rx: 3, fill: color, opacity: 0.75 }),
    shape.outage && svg("rect", { x: x(from), y: y - 2, width: Math.max(4, x(begin) - x(from)), height: BAR_PX + 4, rx: 2, fill: colour("outage") }),
    svg("text", { x: x(meets), y: middle + 5, "text-anchor": "middle", "font-size": 13, fill: colour("card") }, "◆"),
  );
}

/**
 * @param {number} n
 * @param {number} width
 */
function ticks(n, width) {
  const wanted = n / (width < 500 ? 5 : 10);
  const power = 10 ** Math.floor(Math.log10(Math.max(1, wanted)));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= wanted) ?? 1;
  return Array.from({ length: Math.floor(n / step) + 1 }, (_, i) => i * step);
}
