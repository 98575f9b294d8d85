/** Figures of a problem: its outages, its Jacobian, and the probability and duration of outages. */

import { svg } from "./dom.js";
import { axis, Figure, series, SvgFigure } from "./figures.js";
import { lookOf, nameOf } from "./flight.js";
import { number, percent } from "./format.js";
import { colour } from "./theme.js";

/** @import { ProblemStructure, TrajectoryShape } from "../types" */

const ROW_PX = 26;
const BAR_PX = 12;

export class OutageFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Outages over the segments");
  }

  /**
   * @param {TrajectoryShape[]} trajectories
   * @param {number} nSegments
   * @param {string} segmentation
   */
  show(trajectories, nSegments, segmentation) {
    const own = segmentation === "adaptive" ? "as many segments as are left" : "as many segments as the reference";
    const words =
      trajectories.length > 1
        ? `Each outage (orange) begins with a segment of the reference; there its realization branches off, coasts, and has ${own}. An outage is drawn as one segment, whatever its duration. ◆: matchpoint.`
        : "Only the reference: there is no outage to survive. ◆: matchpoint.";
    this.figure.show((width) => outageDrawing(trajectories, nSegments, width), words);
  }
}

/**
 * @param {TrajectoryShape[]} trajectories
 * @param {number} n
 * @param {number} width
 */
function outageDrawing(trajectories, n, width) {
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
 * @param {TrajectoryShape} shape
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
  // A realization's own segments begin after the missed one.
  const begin = shape.outage ? shape.outage.segment : 0;
  const meets = begin + ((shape.matchpoint - 1) / shape.n_segments) * (n - begin);
  const label = shape.outage
    ? `Realization ${i}: outage of ${number(shape.outage.duration_days, 2, "d")} from the start of segment ${shape.outage.segment}; branches off the ${shape.leaves} leg of the reference; ${shape.n_segments} segments of its own.`
    : `Reference: ${shape.n_segments} segments.`;
  const middle = y + BAR_PX / 2;
  return svg(
    "g",
    { "data-trajectory": i },
    svg("title", {}, label),
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

const STATE = 7;
const TOP = 22;

export class SparsityFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Jacobian of the defects");
  }

  /** @param {ProblemStructure} structure */
  show(structure) {
    const share = percent(structure.n_nonzeros / (structure.n_defects * structure.n_variables));
    const filled = structure.filled_gap ? ` Gaps of up to ${structure.filled_gap} columns are drawn filled.` : "";
    this.figure.show(
      (width) => sparsityDrawing(structure, width),
      `${number(structure.n_defects, 0)} rows: seven defects per trajectory; ${number(structure.n_variables, 0)} columns: the variables of each trajectory. ` +
        `${number(structure.n_nonzeros, 0)} entries, ${share} of the matrix; ${number(structure.n_dense, 0)} if the mass rows were dense.${filled}`,
    );
    this.figure.plot.dataset.runs = String(structure.runs.length);
  }
}

/**
 * @param {ProblemStructure} structure
 * @param {number} width
 */
function sparsityDrawing(structure, width) {
  const left = width < 500 ? 40 : 120;
  const rowPx = Math.max(2.5, Math.min(9, 360 / structure.n_defects));
  const x = (/** @type {number} */ column) => left + (column / structure.n_variables) * (width - left - 4);
  const height = TOP + structure.n_defects * rowPx + 6;
  const content = structure.trajectories.flatMap((shape, i) => band(shape, i, x, rowPx, left, height, width));
  // One path for the runs of each block keeps the figure small.
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
 * @param {TrajectoryShape} shape
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

export class ChanceFigures {
  /**
   * @param {HTMLElement} counts
   * @param {HTMLElement} durations
   */
  constructor(counts, durations) {
    this.counts = new Figure(counts, "Probability of an outage during the transfer");
    this.durations = new Figure(durations, "Duration of an outage");
  }

  /**
   * @param {ProblemStructure} structure
   * @param {number | null} arcDays of the best solution
   * @param {number[]} missed durations of the problem's outages [days]
   */
  async show(structure, arcDays, missed) {
    await this.counts.show(countTraces(structure), countLayout(arcDays), countWords(structure, arcDays));
    await this.durations.show([durationTrace(structure)], durationLayout(structure, missed), durationWords(structure, missed));
  }
}

/** @param {ProblemStructure} structure */
function countTraces({ chances }) {
  /** @type {[string, (chance: ProblemStructure["chances"][number]) => number][]} */
  const curves = [["one or more", (c) => 1 - c.none], ["exactly one", (c) => c.one], ["two or more", (c) => c.several]];
  return curves.map(([name, of], place) => ({
    type: "scatter",
    mode: "lines",
    name,
    x: chances.map((chance) => chance.arc_days),
    y: chances.map(of),
    line: { color: series(place).color, dash: series(place).dash, width: 2, shape: "spline" },
    hovertemplate: `%{y:.1%}<extra>${name}</extra>`,
  }));
}

/** @param {number | null} arcDays */
function countLayout(arcDays) {
  const line = arcDays === null ? [] : [marked(arcDays)];
  return {
    showlegend: true,
    hovermode: "x unified",
    margin: { l: 58, r: 12, t: 34, b: 46 },
    xaxis: axis("arc: coast and thrust [d]", { rangemode: "tozero" }),
    yaxis: axis("probability [–]", { tickformat: ".0%", rangemode: "tozero" }),
    shapes: line.map(({ shape }) => shape),
  };
}

/** @param {number} x */
function marked(x) {
  return {
    shape: { type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1, line: { color: colour("text"), width: 1, dash: "dot" } },
  };
}

/**
 * @param {ProblemStructure} structure
 * @param {number | null} arcDays
 */
function countWords({ between, chances }, arcDays) {
  const law =
    `Assumption: the times between safe modes are Weibull-distributed, scale ${number(between.scale_days, 1, "d")}, shape ${number(between.shape, 3)} ` +
    `(mean ${number(between.mean_days, 0, "d")}), and the process starts with the transfer; the duration of outages is neglected.`;
  if (arcDays === null) return `${law} There is no solution yet to evaluate it for.`;
  const chance = 1 - Math.exp(-((arcDays / between.scale_days) ** between.shape));
  const reach = chances[chances.length - 1].arc_days;
  return `Dotted: the best solution, whose last segment ends ${number(arcDays, 1, "d")} after departure; the probability of an outage until then is ${percent(chance)}. ${law} The axis ends at the ${number(reach, 0, "d")} that the bounds allow.`;
}

/** @param {ProblemStructure} structure */
function durationTrace({ durations }) {
  return {
    type: "scatter",
    mode: "lines",
    name: "lasts at most this long",
    x: durations.map(({ days }) => days),
    y: durations.map((chance) => chance.at_most),
    line: { color: colour("outage"), width: 2 },
    hovertemplate: "%{x:.2f} d: %{y:.1%}<extra></extra>",
  };
}

/**
 * @param {ProblemStructure} structure
 * @param {number[]} missed
 */
function durationLayout({ durations }, missed) {
  const last = durations[durations.length - 1].days;
  return {
    margin: { l: 58, r: 12, t: 14, b: 46 },
    xaxis: axis("duration of the outage [d]", { range: [0, last] }),
    yaxis: axis("cumulative probability [–]", { tickformat: ".0%", range: [0, 1.02] }),
    shapes: [...new Set(missed)].map((days) => marked(days).shape),
  };
}

/**
 * @param {ProblemStructure} structure
 * @param {number[]} missed
 */
function durationWords({ recovery, durations }, missed) {
  const law =
    `Assumption: Weibull-distributed, scale ${number(recovery.scale_days, 2, "d")}, shape ${number(recovery.shape, 3)} ` +
    `(median ${number(recovery.median_days, 2, "d")}); the delay until an outage is noticed is not included.`;
  const own = [...new Set(missed)].sort((a, b) => a - b).map((days) => {
    const found = durations.find((chance) => chance.days === days);
    return `${percent(found?.at_most)} of outages last at most ${number(days, 1, "d")}`;
  });
  return own.length ? `Dotted, the outages of this problem: ${own.join("; ")}. ${law}` : `This problem has no outage. ${law}`;
}
