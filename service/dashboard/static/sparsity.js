/** Where the Jacobian of a problem has entries: one bar for each run of neighbours in a row. */

import { svg } from "./dom.js";
import { lookOf, nameOf } from "./flight.js";
import { number, percent } from "./format.js";
import { SvgFigure } from "./svg_figure.js";
import { colour } from "./theme.js";

/**
 * @typedef {import("./outage_line.js").Shape} Shape
 * @typedef {{ n_variables: number, n_defects: number, n_nonzeros: number, n_dense: number, runs: [number, number, number][],
 *   filled_gap: number, trajectories: Shape[] }} Structure
 */

const STATE = 7;
const TOP = 22;

export class SparsityFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Jacobian of the defects");
  }

  /** @param {Structure} structure */
  show(structure) {
    const share = percent(structure.n_nonzeros / (structure.n_defects * structure.n_variables));
    const filled = structure.filled_gap ? ` Gaps of up to ${structure.filled_gap} columns are drawn filled.` : "";
    this.figure.show(
      (width) => drawing(structure, width),
      `${number(structure.n_defects, 0)} rows, seven defects a trajectory; ${number(structure.n_variables, 0)} columns, the variables of each trajectory. ` +
        `${number(structure.n_nonzeros, 0)} entries, ${share} of the matrix; with mass rows as dense as the others ${number(structure.n_dense, 0)}.${filled}`,
    );
    this.figure.plot.dataset.runs = String(structure.runs.length);
  }
}

/**
 * @param {Structure} structure
 * @param {number} width
 */
function drawing(structure, width) {
  const left = width < 500 ? 40 : 120;
  const rowPx = Math.max(2.5, Math.min(9, 360 / structure.n_defects));
  const x = (/** @type {number} */ column) => left + (column / structure.n_variables) * (width - left - 4);
  const height = TOP + structure.n_defects * rowPx + 6;
  const content = structure.trajectories.flatMap((shape, i) => band(shape, i, x, rowPx, left, height, width));
  // One path for the runs of each block keeps the picture small.
  const paths = structure.trajectories.map((_, i) => {
    const own = structure.runs.filter(([row]) => Math.floor(row / STATE) === i);
    const parts = own.map(([row, first, length]) => {
      const [x1, x2, y] = [x(first), x(first + length), TOP + row * rowPx];
      return `M${x1.toFixed(2)},${y.toFixed(2)}h${Math.max(0.6, x2 - x1).toFixed(2)}v${(rowPx * 0.86).toFixed(2)}h${(-Math.max(0.6, x2 - x1)).toFixed(2)}z`;
    });
    return svg("path", { d: parts.join(""), fill: lookOf(i).color });
  });
  return { height, content: [...content, ...paths] };
}

/**
 * Return the frame of a trajectory: its rows named to the left, its columns at the top.
 * @param {Shape} shape
 * @param {number} i
 * @param {(column: number) => number} x
 * @param {number} rowPx
 * @param {number} left
 * @param {number} height
 * @param {number} width
 */
function band(shape, i, x, rowPx, left, height, width) {
  const y = TOP + i * STATE * rowPx;
  const [from, to] = [x(shape.first_variable), x(shape.first_variable + shape.n_variables)];
  const isWide = left > 100;
  const name = isWide ? nameOf(i) : i === 0 ? "ref." : String(i);
  return [
    i % 2 === 0 && svg("rect", { x: left, y, width: width - left - 4, height: STATE * rowPx, fill: colour("raised") }),
    svg("line", { x1: from, x2: from, y1: TOP - 4, y2: height - 4, stroke: colour("line-strong"), "stroke-width": 0.8 }),
    to - from > 26 && svg("text", { x: (from + to) / 2, y: 13, "text-anchor": "middle", "font-size": 11, fill: colour("muted") }, to - from > 80 ? nameOf(i) : i === 0 ? "ref." : String(i)),
    STATE * rowPx > 13 && svg("text", { x: left - 8, y: y + (STATE * rowPx) / 2 + 4, "text-anchor": "end", "font-size": 11, fill: colour("muted") }, name),
  ].filter((part) => part instanceof SVGElement);
}
