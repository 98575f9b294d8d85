/** How likely outages are on an arc, and how long they last. */

import { Figure } from "./figure.js";
import { number, percent } from "./format.js";
import { axis, series } from "./plots.js";
import { colour } from "./theme.js";

/**
 * @typedef {{ scale_days: number, shape: number, mean_days: number, median_days: number }} Law
 * @typedef {{ chances: { arc_days: number, none: number, one: number, several: number }[],
 *   durations: { days: number, at_most: number }[], between: Law, recovery: Law }} Structure
 */

export class ChanceFigures {
  /**
   * @param {HTMLElement} counts
   * @param {HTMLElement} durations
   */
  constructor(counts, durations) {
    this.counts = new Figure(counts, "Chance of an outage during the transfer");
    this.durations = new Figure(durations, "How long an outage lasts");
  }

  /**
   * @param {Structure} structure
   * @param {number | null} arcDays of the best solution
   * @param {number[]} missed durations of the problem's outages [days]
   */
  async show(structure, arcDays, missed) {
    await this.counts.show(counted(structure), countLayout(arcDays), countWords(structure, arcDays));
    await this.durations.show([lasting(structure)], durationLayout(structure, missed), durationWords(structure, missed));
  }
}

/** @param {Structure} structure */
function counted({ chances }) {
  /** @type {[string, (chance: Structure["chances"][number]) => number][]} */
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
 * @param {Structure} structure
 * @param {number | null} arcDays
 */
function countWords({ between, chances }, arcDays) {
  const law =
    `Assumed: safe modes follow each other after Weibull times, scale ${number(between.scale_days, 1, "d")}, shape ${number(between.shape, 3)} ` +
    `(mean ${number(between.mean_days, 0, "d")}), and the process begins with the transfer; the time that outages last is neglected.`;
  if (arcDays === null) return `${law} There is no solution yet to read it at.`;
  const chance = 1 - Math.exp(-((arcDays / between.scale_days) ** between.shape));
  const reach = chances[chances.length - 1].arc_days;
  return `Dotted: the best solution, whose thrusting ends ${number(arcDays, 1, "d")} after departure: one or more with ${percent(chance)}. ${law} Drawn up to the ${number(reach, 0, "d")} that the bounds allow.`;
}

/** @param {Structure} structure */
function lasting({ durations }) {
  return {
    type: "scatter",
    mode: "lines",
    name: "lasts at most so long",
    x: durations.map(({ days }) => days),
    y: durations.map((chance) => chance.at_most),
    line: { color: colour("outage"), width: 2 },
    hovertemplate: "%{x:.2f} d: %{y:.1%}<extra></extra>",
  };
}

/**
 * @param {Structure} structure
 * @param {number[]} missed
 */
function durationLayout({ durations }, missed) {
  const last = durations[durations.length - 1].days;
  return {
    margin: { l: 58, r: 12, t: 14, b: 46 },
    xaxis: axis("duration of the outage [d]", { range: [0, last] }),
    yaxis: axis("probability of at most so long [–]", { tickformat: ".0%", range: [0, 1.02] }),
    shapes: [...new Set(missed)].map((days) => marked(days).shape),
  };
}

/**
 * @param {Structure} structure
 * @param {number[]} missed
 */
function durationWords({ recovery, durations }, missed) {
  const law =
    `Assumed: a Weibull time, scale ${number(recovery.scale_days, 2, "d")}, shape ${number(recovery.shape, 3)} ` +
    `(median ${number(recovery.median_days, 2, "d")}); the delay until somebody notices is not in it.`;
  const own = [...new Set(missed)].sort((a, b) => a - b).map((days) => {
    const found = durations.find((chance) => chance.days === days);
    return `${number(days, 1, "d")} suffice for ${percent(found?.at_most)} of outages`;
  });
  return own.length ? `Dotted, the outages of this problem: ${own.join("; ")}. ${law}` : `This problem has no outage. ${law}`;
}
