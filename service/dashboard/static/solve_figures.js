/** Figures of the solves of a search: violation, delta-v, step sizes and time. */

import { axis, Figure } from "./figures.js";
import { counted, small } from "./format.js";
import { colourOf, isFeasible, OUTCOMES } from "./looks.js";
import { byChain, outcomeOf, quantile } from "./solves.js";
import { colour } from "./theme.js";

/** @import { Solve } from "./solves.js" */

const SYMBOLS = { strict: "circle", paper: "diamond", infeasible: "circle-open", timeout: "x-thin-open", numerical: "triangle-up-open" };
/** Most decades of an axis that are all labelled. */
const MOST_DECADES = 7;
/** A defect of zero has no logarithm. */
const LEAST = 1e-12;
const MOST_BINS = 40;
const TOP_LEGEND = { showlegend: true, margin: { l: 64, r: 12, t: 34, b: 44 } };

/**
 * Return the abscissa of each solve: its hop, or its order of arrival where chains have one solve.
 * @param {Solve[]} solves
 * @param {number} hops
 */
function places(solves, hops) {
  if (hops > 1) return { title: "hop of the chain", at: new Map(solves.map((solve) => [solve.id, solve.hop + 1])) };
  const inTime = [...solves].sort((a, b) => a.id - b.id);
  return { title: "solve, in order of arrival", at: new Map(inTime.map((solve, i) => [solve.id, i + 1])) };
}

export class ViolationFigure extends Figure {
  /**
   * @param {Solve[]} solves
   * @param {number} hops
   * @param {string} caption
   */
  draw(solves, hops, caption) {
    const { title, at } = places(solves, hops);
    const finite = solves.filter(({ violation }) => violation !== null);
    const value = (/** @type {Solve} */ solve) => Math.max(solve.violation ?? 0, LEAST);
    const traces = [];
    if (hops > 1) traces.push(lines(finite, (solve) => at.get(solve.id) ?? 0, value), middle(finite, value));
    traces.push(...marks(finite, (solve) => at.get(solve.id) ?? 0, value, "violation %{y:.2g}"));
    const lost = solves.length - finite.length;
    const words = lost ? `${counted(lost, "solve")} with a violation that is not finite ${lost === 1 ? "is" : "are"} not shown. ` : "";
    return this.show(
      traces,
      {
        ...TOP_LEGEND,
        xaxis: axis(title, { dtick: hops > 1 && hops <= 20 ? 1 : undefined }),
        yaxis: axis("violation [strict tolerances]", { type: "log", exponentformat: "power", dtick: decades(finite.map(value)) }),
        shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: 1, y1: 1, line: { color: colour("muted"), width: 1, dash: "dash" } }],
      },
      `${caption}${words}Largest defect as solved, relative to the strict tolerance; feasible on and below the dashed line.`,
    );
  }
}

export class DeltaVFigure extends Figure {
  /**
   * @param {Solve[]} solves
   * @param {number} hops
   * @param {string} caption
   */
  draw(solves, hops, caption) {
    const found = solves.filter(({ delta_v_km_s: deltaV }) => deltaV !== null);
    if (found.length === 0) {
      return this.empty("No feasible solve yet. Each appears here with its Δv; the violations show how close the others come.");
    }
    const { title, at } = places(solves, hops);
    const value = (/** @type {Solve} */ solve) => solve.delta_v_km_s ?? 0;
    const traces = marks(found, (solve) => at.get(solve.id) ?? 0, value, "%{y:.4f} km/s");
    return this.show(
      [best(found, at), ...traces],
      { ...TOP_LEGEND, xaxis: axis(title, { dtick: hops > 1 && hops <= 20 ? 1 : undefined }), yaxis: axis("Δv of the transfer [km/s]") },
      `${caption}The line is the best strict Δv ${hops > 1 ? "of all chains up to that hop" : "so far"}.`,
    );
  }
}

export class TimeFigure extends Figure {
  /**
   * @param {Solve[]} solves
   * @param {string} caption
   */
  draw(solves, caption) {
    const seconds = solves.map(({ cpu_seconds: spent }) => spent).filter((spent) => spent > 0);
    const [median, tail] = [quantile(seconds, 0.5) ?? 0, quantile(seconds, 0.9) ?? 0];
    const bins = binsOf(seconds);
    const traces = OUTCOMES.map(({ key, words, colour: name }) => {
      const counts = bins.centres.map(() => 0);
      for (const solve of solves) if (outcomeOf(solve) === key && solve.cpu_seconds > 0) counts[bins.place(solve.cpu_seconds)] += 1;
      const hover = "%{y} solves around %{x:.2g} s<extra></extra>";
      return { type: "bar", x: bins.centres, y: counts, width: bins.widths, name: words, marker: { color: colour(name) }, hovertemplate: hover };
    }).filter(({ y }) => y.some(Boolean));
    const line = { type: "line", yref: "paper", y0: 0, y1: 1, x0: median, x1: median, line: { color: colour("text"), width: 1.5, dash: "dot" } };
    return this.show(
      traces,
      { ...TOP_LEGEND, barmode: "stack", bargap: 0, shapes: [line], xaxis: axis("CPU time of a solve [s]", bins.isLog ? { type: "log", dtick: "D1", exponentformat: "none" } : {}), yaxis: axis("solves") },
      `${caption}Median ${small(median, "s")} (dotted); 90 % take at most ${small(tail, "s")}.`,
    );
  }
}

/**
 * Return up to forty bins, equally wide on the axis that suits the values.
 * @param {number[]} values
 */
function binsOf(values) {
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, 0]);
  const isLog = high > 20 * low;
  const to = (/** @type {number} */ v) => (isLog ? Math.log10(v) : v);
  const from = (/** @type {number} */ v) => (isLog ? 10 ** v : v);
  const number_ = Math.max(4, Math.min(MOST_BINS, Math.ceil(2 * Math.sqrt(values.length))));
  const step = (to(high) - to(low)) / number_ || 1;
  const edges = Array.from({ length: number_ + 1 }, (_, i) => from(to(low) + i * step));
  const centres = edges.slice(1).map((edge, i) => from((to(edge) + to(edges[i])) / 2));
  const widths = edges.slice(1).map((edge, i) => edge - edges[i]);
  const place = (/** @type {number} */ v) => Math.min(number_ - 1, Math.max(0, Math.floor((to(v) - to(low)) / step)));
  return { isLog, centres, widths, place };
}

/**
 * Return a trace of marks for each outcome that occurs; a mark leads to its solution.
 * @param {Solve[]} solves
 * @param {(solve: Solve) => number} x
 * @param {(solve: Solve) => number} y
 * @param {string} shown
 */
function marks(solves, x, y, shown) {
  return OUTCOMES.flatMap(({ key, words }) => {
    const own = solves.filter((solve) => outcomeOf(solve) === key);
    if (own.length === 0) return [];
    const text = own.map((solve) => (solve.seed ? `seed ${solve.seed.slice(0, 8)}` : `chain ${solve.chain + 1}, hop ${solve.hop + 1}`));
    const marker = { color: colourOf(key), symbol: SYMBOLS[key], size: isFeasible(key) ? 7 : 6, opacity: 0.9 };
    return [{ type: "scatter", mode: "markers", name: words, x: own.map(x), y: own.map(y), text, marker, customdata: own.map((solve) => solve.solution_id), hovertemplate: `%{text}: ${shown}<extra>${words}</extra>` }];
  });
}

/**
 * Return the tick step of a logarithmic axis: whole decades if it spans enough, since finer ticks would be labelled too.
 * @param {number[]} values
 */
export function decades(values) {
  const [low, high] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, LEAST]);
  const span = Math.log10(high / low);
  if (span < 0.4) return undefined;
  return span < 1.5 ? "D2" : Math.max(1, Math.ceil(span / MOST_DECADES));
}

/**
 * Return a thin line for each chain, all in one trace.
 * @param {Solve[]} solves
 * @param {(solve: Solve) => number} x
 * @param {(solve: Solve) => number} y
 */
export function lines(solves, x, y) {
  /** @type {(number | null)[][]} */
  const [xs, ys] = [[], []];
  for (const chain of byChain(solves).values()) {
    xs.push(...chain.map(x), null);
    ys.push(...chain.map(y), null);
  }
  return { type: "scatter", mode: "lines", x: xs, y: ys, line: { color: colour("line-strong"), width: 1 }, hoverinfo: "skip", showlegend: false };
}

/**
 * Return the median by hop as a line.
 * @param {Solve[]} solves
 * @param {(solve: Solve) => number} value
 */
export function middle(solves, value) {
  /** @type {Map<number, number[]>} */
  const byHop = new Map();
  for (const solve of solves) byHop.set(solve.hop, [...(byHop.get(solve.hop) ?? []), value(solve)]);
  const hops = [...byHop.keys()].sort((a, b) => a - b);
  const line = { color: colour("text"), width: 2 };
  return { type: "scatter", mode: "lines", name: "median", x: hops.map((hop) => hop + 1), y: hops.map((hop) => quantile(byHop.get(hop) ?? [], 0.5)), line, hovertemplate: "median %{y:.2g}<extra></extra>" };
}

/**
 * Return the best strict delta-v up to each place, as steps.
 * @param {Solve[]} found
 * @param {Map<number, number>} at
 */
function best(found, at) {
  const strict = found.filter(({ verdict }) => verdict === "strict").sort((a, b) => (at.get(a.id) ?? 0) - (at.get(b.id) ?? 0));
  /** @type {number[][]} */
  const [x, y] = [[], []];
  for (const solve of strict) {
    const deltaV = solve.delta_v_km_s ?? Infinity;
    const place = at.get(solve.id) ?? 0;
    if (x[x.length - 1] !== place) {
      x.push(place);
      y.push(y[y.length - 1] ?? Infinity);
    }
    y[y.length - 1] = Math.min(deltaV, y[y.length - 1]);
  }
  return { type: "scatter", mode: "lines", name: "best", x, y, line: { color: colour("text"), width: 2, shape: "hv" }, hoverinfo: "skip" };
}
