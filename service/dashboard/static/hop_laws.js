/** The laws of a search in words, and the distribution of its step sizes. */

import { axis, Figure } from "./figures.js";
import { NONE, number, small } from "./format.js";
import { decades, lines, middle } from "./solve_figures.js";
import { colour } from "./theme.js";

/**
 * @import { Solve } from "./solves.js"
 * @import { LawsView } from "../types"
 */

const GUESSES = /** @type {Record<string, string>} */ ({
  uniform: "uniform: each variable anywhere in its bounds",
  "thrust-coast-thrust": "thrust-coast-thrust: burns along the velocity at both ends",
});
/** Chance that a step of width 1 is longer than s, docs/method.md eqs. S10 to S13. */
const TAILS = /** @type {Record<string, (s: number, shape: number) => number>} */ ({
  uniform: (s) => Math.max(0, 1 - s),
  gaussian: (s) => complement(s / Math.SQRT2),
  cauchy: (s) => 1 - (2 / Math.PI) * Math.atan(s),
  pareto: (s, shape) => Math.min(1, s ** -shape),
});
const N_POINTS = 160;

/**
 * Return the laws as names and values.
 * @param {LawsView} laws
 * @param {number} hops
 * @returns {[string, string][]}
 */
export function lawFacts(laws, hops) {
  /** @type {[string, string][]} */
  const guess = [["Guess law", GUESSES[laws.guess_law] ?? laws.guess_law]];
  if (hops === 1) return [...guess, ["Hops", "none: every solve is a new random start (multistart)"]];
  const range = laws.width_range;
  return [
    ...guess,
    ["Hop law", laws.hop_law],
    ["Width", `${small(laws.width)} of the range of each variable`],
    ["Tail exponent", laws.shape === null ? NONE : number(laws.shape, 2)],
    ["Adaptive", range ? `yes, from ${small(range[0])} to ${small(range[1])}` : "no"],
    ["Time hops", laws.time_hop_probability > 0 ? `each time variable is redrawn in ${number(100 * laws.time_hop_probability, 0)} % of hops` : "none"],
    ["Restart", `after ${number(laws.max_failures, 0)} consecutive rejected hops`],
  ];
}

/** Adaptive widths by hop; for a law of constant width, the probability of longer steps. */
export class ReachFigure extends Figure {
  /**
   * @param {Solve[]} solves
   * @param {LawsView} laws
   * @param {number} hops
   * @param {string} caption
   */
  draw(solves, laws, hops, caption) {
    if (hops === 1) return this.empty("This search does not hop: each of its chains is one solve.");
    if (!laws.adaptive) return this.reach(laws);
    const known = solves.filter(({ width }) => width !== null);
    if (known.length === 0) return this.empty("No hop yet: the first solve of a chain is a new start.");
    const value = (/** @type {Solve} */ solve) => solve.width ?? 0;
    const at = (/** @type {Solve} */ solve) => solve.hop + 1;
    const last = middle(known, value);
    return this.show(
      [{ ...lines(known, at, value), line: { color: colour("reference"), width: 1 }, opacity: 0.5 }, last],
      { showlegend: true, margin: { l: 64, r: 12, t: 34, b: 44 }, xaxis: axis("hop of the chain"), yaxis: axis("hop width [range of a variable]", { type: "log", exponentformat: "power", dtick: decades(known.map(value)) }) },
      `${caption}A ${laws.hop_law} law whose width grows with each accepted hop and shrinks with each rejected one; a restart resets it.`,
    );
  }

  /** @param {LawsView} laws */
  reach({ hop_law: law, width, shape }) {
    const s = Array.from({ length: N_POINTS }, (_, i) => width * 10 ** (-2 + (i * Math.max(3, Math.log10(1 / width) + 2.05)) / N_POINTS));
    const chance = s.map((step) => TAILS[law]?.(step / width, shape ?? 1) ?? 0);
    const end = { color: colour("reference"), width: 2 };
    return this.show(
      [{ type: "scatter", mode: "lines", x: s, y: chance.map((c) => 100 * c), line: end, hovertemplate: "longer than %{x:.2g}: %{y:.2g} %<extra></extra>" }],
      {
        xaxis: axis("step of a variable [its range]", { type: "log", exponentformat: "power", dtick: decades(s) }),
        yaxis: axis("chance of a longer step [%]", { rangemode: "tozero" }),
        shapes: [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: width, x1: width, line: { color: colour("muted"), width: 1, dash: "dash" } }],
      },
      `The ${law} law of this search; its width, ${small(width)}, is dashed and constant.`,
    );
  }
}

/**
 * Return 1 - erf(x) to 2e-7, by the approximation 7.1.26 of Abramowitz and Stegun.
 * @param {number} x not negative
 */
function complement(x) {
  const t = 1 / (1 + 0.3275911 * x);
  return t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))) * Math.exp(-x * x);
}
