/** Defects at the matchpoints, as solved and as verified: a table, and a figure against the tolerances. */

import { el, fill, svg } from "./dom.js";
import { SvgFigure } from "./figures.js";
import { nameOf } from "./flight.js";
import { small } from "./format.js";
import { colour } from "./theme.js";

/** @import { RecordInFull, WorldView } from "../types" */
/** @typedef {{ strict: number[], loose: number[] }} Bounds */

const PARTS = ["position", "velocity", "mass"];
const UNITS = ["km", "km/s", "kg"];
const HEAD = ["Trajectory", "Part", "Solved", "Verified", "Strict", "Loose"];
const HEAD_CLASSES = [null, null, "number", "number", "number minor", "number minor"];
/** Powers of ten of the strict tolerance that the figure shows; values beyond are drawn at the edge. */
const [LEAST, MOST] = [-8, 4];
const ROW_PX = 17;

/**
 * @param {HTMLElement} place
 * @param {RecordInFull} judged
 * @param {WorldView} world
 */
export function showDefectTable(place, judged, world) {
  const { strict, loose } = boundsOf(world);
  const rows = judged.defects_verified.flatMap((_, i) => {
    const [solved, verified] = [norms(judged.defects_solved[i]), norms(judged.defects_verified[i])];
    return PARTS.map((part, j) =>
      el(
        "tr",
        {},
        j === 0 && el("th", { scope: "rowgroup", rowspan: 3 }, nameOf(i)),
        el("td", {}, part),
        el("td", { class: "number" }, small(solved[j], UNITS[j])),
        el("td", { class: "number", "data-within": within(verified[j], strict[j], loose[j]) }, small(verified[j], UNITS[j])),
        el("td", { class: "number muted minor" }, `≤ ${small(strict[j])}`),
        el("td", { class: "number muted minor" }, `≤ ${small(loose[j])}`),
      ),
    );
  });
  const head = el("thead", {}, el("tr", {}, HEAD.map((words, i) => el("th", { scope: "col", class: HEAD_CLASSES[i] }, words))));
  const caption = el("caption", { class: "visually-hidden" }, "Norms of the defects");
  fill(place, el("table", { class: "defects" }, caption, head, el("tbody", {}, rows)));
}

export class DefectFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Defects against tolerances");
  }

  /**
   * @param {RecordInFull} judged
   * @param {WorldView} world
   */
  show(judged, world) {
    this.figure.show(
      (width) => drawing(judged, boundsOf(world), width),
      "Verified (●) and solved (○), as multiples of the strict tolerance; the upright mark is the loose tolerance.",
    );
  }
}

/**
 * Return the tolerances as norms of position, velocity and mass, in the order of `PARTS`.
 * @param {WorldView} world
 * @returns {Bounds}
 */
function boundsOf({ strict, loose }) {
  const [first, second] = [strict, loose].map(({ position_km, velocity_km_s, mass_kg }) => [position_km, velocity_km_s, mass_kg]);
  return { strict: first, loose: second };
}

/**
 * @param {RecordInFull} judged
 * @param {Bounds} bounds
 * @param {number} width
 */
function drawing(judged, bounds, width) {
  const left = width < 420 ? 104 : 150;
  const x = (/** @type {number} */ ratio) => left + ((power(ratio) - LEAST) / (MOST - LEAST)) * (width - left - 26);
  const n = judged.defects_verified.length;
  const height = 14 + n * (3 * ROW_PX + 8) + 26;
  const content = [];
  for (let exponent = LEAST; exponent <= MOST; exponent += 2) {
    const at = x(10 ** exponent);
    content.push(svg("line", { x1: at, x2: at, y1: 6, y2: height - 24, stroke: colour("line") }));
    content.push(svg("text", { x: at, y: height - 8, "text-anchor": "middle", fill: colour("muted"), "font-size": 11 }, exponent === 0 ? "1" : small(10 ** exponent)));
  }
  content.push(svg("line", { x1: x(1), x2: x(1), y1: 6, y2: height - 24, stroke: colour("good"), "stroke-width": 2 }));
  for (let i = 0; i < n; i += 1) content.push(...rows(judged, bounds, i, left, x, width < 420));
  return { height, content };
}

/**
 * @param {RecordInFull} judged
 * @param {Bounds} bounds
 * @param {number} i
 * @param {number} left
 * @param {(ratio: number) => number} x
 * @param {boolean} isNarrow
 */
function rows(judged, { strict, loose }, i, left, x, isNarrow) {
  const [solved, verified] = [norms(judged.defects_solved[i]), norms(judged.defects_verified[i])];
  const name = isNarrow ? (i === 0 ? "ref." : `real. ${i}`) : nameOf(i);
  return PARTS.flatMap((part, j) => {
    const y = 20 + i * (3 * ROW_PX + 8) + j * ROW_PX;
    const tint = colour({ strict: "good", paper: "fair", none: "poor" }[within(verified[j], strict[j], loose[j])] ?? "poor");
    const label = `${nameOf(i)}, ${part}: solved ${small(solved[j], UNITS[j])}, verified ${small(verified[j], UNITS[j])}`;
    const limit = x(loose[j] / strict[j]);
    return [
      svg("text", { x: left - 10, y: y + 4, "text-anchor": "end", fill: colour("muted"), "font-size": 11.5 }, j === 0 ? `${name}, ${part}` : part),
      svg("line", { x1: limit, x2: limit, y1: y - 6, y2: y + 6, stroke: colour("fair"), "stroke-width": 2 }),
      svg("g", {}, svg("title", {}, label), svg("circle", { cx: x(solved[j] / strict[j]), cy: y, r: 4.5, fill: "none", stroke: colour("muted"), "stroke-width": 1.5 }), svg("circle", { cx: x(verified[j] / strict[j]), cy: y, r: 4, fill: tint })),
    ];
  });
}

/** @param {number} ratio */
function power(ratio) {
  if (!Number.isFinite(ratio)) return MOST;
  return Math.min(MOST, Math.max(LEAST, ratio > 0 ? Math.log10(ratio) : LEAST));
}

/**
 * Return the norms of position, velocity and mass; NaN where a defect is not finite.
 * @param {(number | null)[]} row
 */
function norms(row) {
  const finite = row.map((value) => value ?? NaN);
  return [Math.hypot(...finite.slice(0, 3)), Math.hypot(...finite.slice(3, 6)), Math.abs(finite[6])];
}

/**
 * @param {number} value
 * @param {number} strict
 * @param {number} loose
 */
function within(value, strict, loose) {
  if (value <= strict) return "strict";
  return value <= loose ? "paper" : "none";
}
