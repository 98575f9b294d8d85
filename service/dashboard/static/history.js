/** The history of a campaign: figures, and the matrix of seed chains. */

import { el, fill } from "./dom.js";
import { axis, Figure } from "./figures.js";
import { duration, NONE, number, percent } from "./format.js";
import { LEVELS, lookOf, OUTCOMES } from "./looks.js";
import { colour } from "./theme.js";

/** @import { BoxView, ChainView, HistoryView, RatioView, StrategyView } from "../types" */

/** Below this share ratios are drawn on a logarithmic axis. */
const RARE = 0.01;
const LEGEND = { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" };
const UNITS = /** @type {[number, string][]} */ ([[86400, "d"], [3600, "h"], [60, "min"], [1, "s"]]);

/** The best delta-v of each strategy against the core-hours spent. */
export class BestSoFar {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Best Δv so far");
  }

  /** @param {HistoryView} history */
  async show(history) {
    const found = history.strategies.filter((one) => one.steps.length > 0);
    if (found.length === 0) return this.figure.empty("No strict solution yet; the first one starts a line here.");
    const traces = found.map(bestTrace);
    const x = axis("Core-hours spent by the strategy [h]", { type: "log", exponentformat: "power", dtick: 1 });
    const [range, isCut] = bestRange(found);
    const layout = { xaxis: x, yaxis: axis("Best Δv [km/s]", { range }), showlegend: true, hovermode: "closest" };
    const above = isCut ? `First solutions above ${number(range[1], 2, "km/s")} are not shown. ` : "";
    await this.figure.show(traces, layout, `${above}Strict solutions. Core-hours include failed solves, but not those spent on the seeds. Click a mark to open its solution.`);
    this.figure.linkMarks();
  }
}

/**
 * Return a range in which improvements are visible although the first solutions are far worse.
 * @param {StrategyView[]} found
 * @returns {[[number, number], boolean]} the range, and whether something lies above it
 */
function bestRange(found) {
  const all = found.flatMap(({ steps }) => steps.map((step) => step.delta_v_km_s)).sort((a, b) => a - b);
  const [least, greatest] = [all[0], all[all.length - 1]];
  const usual = all[Math.floor(0.8 * (all.length - 1))];
  const top = greatest - least > 2.5 * (usual - least) && usual > least ? least + 1.25 * (usual - least) : greatest;
  const edge = 0.06 * (top - least || 0.1);
  return [[least - edge, top + edge], top < greatest];
}

/** @param {StrategyView} one */
function bestTrace(one) {
  const { color, symbol, dash } = lookOf(one.strategy);
  const last = one.steps[one.steps.length - 1];
  return {
    type: "scatter",
    mode: "lines+markers",
    name: one.strategy,
    x: [...one.steps.map((step) => step.core_hours), one.core_hours],
    y: [...one.steps.map((step) => step.delta_v_km_s), last.delta_v_km_s],
    customdata: [...one.steps.map((step) => step.solution_id), last.solution_id],
    line: { shape: "hv", color, dash, width: 2 },
    // The line continues to the present without another mark.
    marker: { symbol, color, size: [...one.steps.map(() => 7), 0] },
    hovertemplate: `${one.strategy}: %{y:.4f} km/s after %{x:.3g} core-h<extra></extra>`,
  };
}

/** How solves ended, over time. */
export class OutcomeMix {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Outcomes over time");
  }

  /** @param {HistoryView} history */
  async show({ outcomes }) {
    const n = outcomes.strict.length;
    if (n === 0) return this.figure.empty("No guess has been solved yet. If this persists, check that a worker is connected.");
    const width = outcomes.width_seconds;
    const [unit, name] = UNITS.find(([seconds]) => n * width >= 2 * seconds) ?? [1, "s"];
    const x = Array.from({ length: n }, (_, i) => ((i + 0.5) * width) / unit);
    const shown = OUTCOMES.filter(({ key }) => outcomes[key].some(Boolean));
    const traces = shown.map(({ key, words, colour: tint }) => ({
      type: "bar",
      name: words,
      x,
      y: outcomes[key],
      width: width / unit,
      marker: { color: colour(tint), line: { width: 0 } },
      hovertemplate: `%{y} ${words}<extra></extra>`,
    }));
    const layout = { barmode: "stack", bargap: 0, xaxis: axis(`Time since the start [${name}]`), yaxis: axis("Solves"), showlegend: true, hovermode: "x", legend: { ...LEGEND, traceorder: "normal" } };
    await this.figure.show(traces, layout, `Each bar covers ${width % unit ? duration(width) : number(width / unit, 0, name)}.`);
  }
}

/** The share of feasible solves of each strategy. */
export class Feasibility {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Feasibility by strategy");
  }

  /** @param {HistoryView} history */
  async show({ strategies }) {
    if (strategies.length === 0) return this.figure.empty("No guess has been solved yet; each strategy gets a point with its interval.");
    const isRare = strategies.some(({ strict_ratio: { value } }) => value !== null && value > 0 && value < RARE);
    const levels = /** @type {const} */ ([["strict", "strict_ratio", -0.14], ["paper", "paper_ratio", 0.14]]);
    const traces = levels.map(([level, key, shift]) => ratioTrace(strategies, level, (one) => one[key], shift));
    const ticks = { tickvals: strategies.map((_, i) => i), ticktext: strategies.map(({ strategy }) => strategy) };
    const x = isRare ? axis("Feasible solves [%]", { type: "log" }) : axis("Feasible solves [%]", { range: [-2, 102] });
    const layout = { xaxis: x, yaxis: axis("", { ...ticks, range: [strategies.length - 0.5, -0.5], showgrid: false }), showlegend: true };
    await this.figure.show(traces, layout, "Share of solves that the independent verification found feasible, with 95 % Wilson intervals.");
  }
}

/**
 * @param {StrategyView[]} strategies
 * @param {"strict" | "paper"} level
 * @param {(one: StrategyView) => RatioView} ratioOf
 * @param {number} shift
 */
function ratioTrace(strategies, level, ratioOf, shift) {
  const ratios = strategies.map(ratioOf);
  const values = ratios.map(({ value }) => 100 * (value ?? 0));
  const tint = colour(level === "strict" ? "good" : "fair");
  return {
    type: "scatter",
    mode: "markers",
    name: LEVELS[level],
    x: values,
    y: strategies.map((_, i) => i + shift),
    error_x: {
      type: "data",
      symmetric: false,
      array: ratios.map(({ high }, i) => 100 * high - values[i]),
      arrayminus: ratios.map(({ low }, i) => values[i] - 100 * low),
      color: tint,
      thickness: 1.5,
      width: 4,
    },
    marker: { color: tint, symbol: level === "strict" ? "circle" : "diamond-open", size: 9, line: { width: 2 } },
    text: strategies.map((one) => `${one.strategy}: ${number(level === "strict" ? one.n_strict : one.n_paper, 0)} of ${number(one.n_solves, 0)}`),
    hovertemplate: "%{text}, %{x:.1f} %<extra></extra>",
  };
}

/** Delta-v of the solutions of each strategy by outage duration. */
export class Boxes {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Δv by strategy and outage duration");
  }

  /** @param {HistoryView} history */
  async show({ delta_v: boxes }) {
    if (boxes.length === 0) return this.figure.empty("No strict solution yet; each strategy and outage duration gets a box.");
    const places = boxPlaces(boxes);
    const strategies = [...new Set(boxes.map(({ strategy }) => strategy))];
    const traces = strategies.map((strategy) => boxTrace(strategy, boxes, places));
    const middle = (/** @type {string} */ strategy) => {
      const own = places.filter((_, i) => boxes[i].strategy === strategy);
      return (own[0] + own[own.length - 1]) / 2;
    };
    // Without room for labels, only the order of the boxes tells durations.
    const isNarrow = this.figure.plot.clientWidth < 14 * boxes.length + 90;
    const ticks = { tickvals: places, ticktext: isNarrow ? boxes.map(() => "") : boxes.map(durationText), tickangle: -90, tickfont: { size: 10 }, showgrid: false };
    const names = strategies.map((strategy) => ({ x: middle(strategy), y: 1, yref: "paper", yanchor: "bottom", text: strategy, showarrow: false, textangle: strategies.length > 5 ? -40 : 0, font: { size: 11 } }));
    const layout = { xaxis: axis(isNarrow ? "Outage duration increases to the right" : "Outage duration [d]", ticks), yaxis: axis("Δv [km/s]"), annotations: names, margin: { l: 64, r: 24, t: 44, b: 60 } };
    const shown = boxes.reduce((sum, box) => sum + box.sample_km_s.length, 0);
    const all = boxes.reduce((sum, box) => sum + box.n_solutions, 0);
    const points = shown < all ? `${number(shown, 0)} of ${number(all, 0)} solutions are drawn as points, evenly by rank; the boxes use all of them. ` : "";
    await this.figure.show(traces, layout, `${points}Strict solutions: boxes from the lower to the upper quartile, whiskers from the minimum to the maximum.`);
  }
}

/**
 * Return the position of each box, with a gap between strategies.
 * @param {BoxView[]} boxes
 */
function boxPlaces(boxes) {
  let place = 0;
  return boxes.map(({ strategy }, i) => (place += i > 0 ? (boxes[i - 1].strategy === strategy ? 1 : 1.8) : 0));
}

/** @param {BoxView} box */
function durationText({ duration_days: days }) {
  return days === null ? "mixed" : days === 0 ? "none" : number(days, days % 1 ? 1 : 0);
}

/**
 * @param {string} strategy
 * @param {BoxView[]} boxes
 * @param {number[]} places
 */
function boxTrace(strategy, boxes, places) {
  const own = boxes.map((box, i) => ({ box, place: places[i] })).filter(({ box }) => box.strategy === strategy);
  const { color } = lookOf(strategy);
  return {
    type: "box",
    name: strategy,
    x: own.map(({ place }) => place),
    q1: own.map(({ box }) => box.lower_quartile_km_s),
    median: own.map(({ box }) => box.median_km_s),
    q3: own.map(({ box }) => box.upper_quartile_km_s),
    lowerfence: own.map(({ box }) => box.least_km_s),
    upperfence: own.map(({ box }) => box.greatest_km_s),
    y: own.map(({ box }) => box.sample_km_s),
    boxpoints: "all",
    jitter: 0.6,
    pointpos: 0,
    width: 0.7,
    line: { color, width: 1.5 },
    fillcolor: "rgba(0,0,0,0)",
    marker: { color, size: 3, opacity: 0.55 },
    hoverinfo: "y",
  };
}

/**
 * @param {HTMLElement} place
 * @param {ChainView[]} chains
 */
export function showChains(place, chains) {
  if (chains.length === 0) {
    fill(place, el("p", { class: "empty" }, "No guess has been solved yet; the matrix fills as solves come in."));
    return;
  }
  const columns = [...new Set(chains.map(({ k }) => k))].sort((a, b) => a - b);
  const rows = [...new Set(chains.map(({ seed_k }) => seed_k))].sort((a, b) => (a ?? -1) - (b ?? -1));
  const cellOf = (/** @type {number | null} */ seedK, /** @type {number} */ k) => chains.find((one) => one.seed_k === seedK && one.k === k);
  fill(
    place,
    el(
      "table",
      { class: "chains" },
      el("caption", { class: "visually-hidden" }, "Yield of strict solutions by number of outages of seed and of problem"),
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Guesses from"), columns.map((k) => el("th", { scope: "col" }, `for k = ${k}`)))),
      el("tbody", {}, rows.map((seedK) => el("tr", {}, el("th", { scope: "row" }, seedK === null ? "drawn" : `seeds of k′ = ${seedK}`), columns.map((k) => cell(cellOf(seedK, k)))))),
    ),
  );
}

/** @param {ChainView | undefined} chain */
function cell(chain) {
  if (!chain) return el("td", { class: "none" }, el("span", { class: "muted" }, NONE));
  const share = chain.strict_ratio.value ?? 0;
  const used = chain.seed_k === null ? `${number(chain.n_solves, 0)} drawn` : `${number(chain.n_seeds, 0)} seeds, ${number(chain.n_solves, 0)} solves`;
  const cost = chain.core_seconds_per_strict;
  const title = `95 % interval ${percent(chain.strict_ratio.low)} to ${percent(chain.strict_ratio.high)}`;
  return el(
    "td",
    { style: `--shade:${Math.round(45 * share)}%`, "data-chain": `${chain.seed_k ?? "drawn"}-${chain.k}`, title },
    el("strong", {}, percent(share)),
    el("span", {}, used),
    el("span", {}, cost === null ? "no solution yet" : `${number(cost, cost < 100 ? 1 : 0, "core-s")} per solution`),
  );
}
