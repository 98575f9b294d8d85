/** Solves by how they ended: the words, the colours and the bar that all pages use. */

import { el } from "./dom.js";
import { number } from "./format.js";

/** @typedef {"strict" | "paper" | "infeasible" | "timeout" | "numerical"} Outcome */

/** Each solve is one of these; `colour` is a name of the style sheet. */
export const OUTCOMES = /** @type {{ key: Outcome, words: string, colour: string }[]} */ ([
  { key: "strict", words: "feasible, strict", colour: "good" },
  { key: "paper", words: "feasible, paper only", colour: "fair" },
  { key: "infeasible", words: "infeasible", colour: "coast" },
  { key: "timeout", words: "out of time", colour: "outage" },
  { key: "numerical", words: "not finite", colour: "target" },
]);

/**
 * Return a bar of solves by outcome, as long as their share of those planned.
 * @param {Record<Outcome, number>} counts
 * @param {number | null} planned null while a budget is open
 * @param {string} name read out
 */
export function outcomeBar(counts, planned, name) {
  const done = total(counts);
  const whole = Math.max(planned ?? done, done, 1);
  const shares = OUTCOMES.filter(({ key }) => counts[key] > 0).map(({ key, words }) =>
    el("span", { class: `share ${key}`, style: `width:${(100 * counts[key]) / whole}%`, title: `${number(counts[key], 0)} ${words}` }),
  );
  const said = { "aria-label": name, "aria-valuemin": 0, "aria-valuemax": whole, "aria-valuenow": done };
  return el("div", { class: "bar", role: "progressbar", ...said }, shares);
}

/**
 * Return how many solves ended how, in words; outcomes that did not occur are left out.
 * @param {Record<Outcome, number>} counts
 */
export function outcomeList(counts) {
  const shown = OUTCOMES.filter(({ key }) => counts[key] > 0);
  return shown.map(({ key, words }) => el("li", {}, el("i", { class: key }), `${number(counts[key], 0)} ${words}`));
}

/** @param {Record<Outcome, number>} counts */
function total(counts) {
  return OUTCOMES.reduce((sum, { key }) => sum + counts[key], 0);
}

/**
 * Say how many of the planned solves there are.
 * @param {number} done
 * @param {number | null} planned
 */
export function ofPlanned(done, planned) {
  return planned === null ? `${number(done, 0)} guesses, budget open` : `${number(done, 0)} of ${number(Math.max(planned, done), 0)} guesses`;
}
