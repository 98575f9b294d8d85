/** Outcomes of solves and strategies: their words, colours and marks, the same on all pages. */

import { get } from "./api.js";
import { byId, el, fill } from "./dom.js";
import { series } from "./figures.js";
import { number, small } from "./format.js";
import { colour } from "./theme.js";

/** @import { Outcomes, ToleranceView, WorldView } from "../types" */

/** @typedef {keyof Outcomes} Outcome */

/** What users call each tolerance. */
export const LEVELS = { strict: "strict", paper: "loose" };

/**
 * Return the bounds of a tolerance.
 * @param {ToleranceView} tolerance
 */
export function boundsOf({ position_km, velocity_km_s, mass_kg }) {
  return `${position_km}\u00a0km, ${1e3 * velocity_km_s}\u00a0m/s, ${small(mass_kg, "kg")}`;
}

/**
 * Say below the page what strict and loose are where its problems fly.
 * @param {WorldView} world
 */
export function tellTolerances({ strict, loose }) {
  const both = [el("em", {}, "Strict"), ` tolerance: ${boundsOf(strict)}; `, el("em", {}, "loose"), `: ${boundsOf(loose)}.`];
  fill(byId("tolerances"), both);
}

/**
 * Say it where the problems of some cases fly.
 * @param {{ problem_hash: string }[]} cases
 */
export async function tellTolerancesOf([first]) {
  if (first) tellTolerances((await get(`/problems/${first.problem_hash}`)).world);
}

/** Each solve is one of these; `colour` is a name of the style sheet. */
export const OUTCOMES = /** @type {{ key: Outcome, words: string, colour: string }[]} */ ([
  { key: "strict", words: "feasible, strict", colour: "good" },
  { key: "paper", words: "feasible, loose only", colour: "fair" },
  { key: "infeasible", words: "infeasible", colour: "coast" },
  { key: "timeout", words: "timed out", colour: "outage" },
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
 * Return the number of solves of each outcome that has occurred, as list items.
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
 * Return how many of the planned guesses are solved, in words.
 * @param {number} done
 * @param {number | null} planned
 */
export function ofPlanned(done, planned) {
  return planned === null ? `${number(done, 0)} guesses, budget open` : `${number(done, 0)} of ${number(Math.max(planned, done), 0)} guesses`;
}

/**
 * @param {Outcome} outcome
 */
export function colourOf(outcome) {
  return colour(OUTCOMES.find(({ key }) => key === outcome)?.colour ?? "coast");
}

/** @param {Outcome} outcome */
export function isFeasible(outcome) {
  return outcome === "strict" || outcome === "paper";
}

/** Number of colours of `series`, after which they repeat with other marks. */
const COLOURS = 7;

/**
 * Return k and k' of a strategy; k' is null where guesses are drawn.
 * @param {string} strategy
 * @returns {{ k: number, seedK: number | null }}
 */
function partsOf(strategy) {
  const found = /^S\((\d+)(?:\|(\d+))?\)$/.exec(strategy);
  if (!found) return { k: 0, seedK: null };
  return { k: Number(found[1]), seedK: found[2] === undefined ? null : Number(found[2]) };
}

/**
 * Return the rank of a strategy among all possible ones, from 0: S(0), S(0|0), S(1), S(1|0), S(1|1), S(2), ...
 * @param {string} strategy
 */
function placeOf(strategy) {
  const { k, seedK } = partsOf(strategy);
  return (k * (k + 3)) / 2 + (seedK === null ? 0 : 1 + seedK);
}

/**
 * Compare two strategies by k, then by k'; drawn guesses come before seeds.
 * @param {string} a
 * @param {string} b
 */
export function compareStrategies(a, b) {
  return placeOf(a) - placeOf(b);
}

/**
 * Return the colour, mark and dash of a strategy in all figures. Colours repeat after seven strategies, the
 * three together do not.
 * @param {string} strategy
 */
export function lookOf(strategy) {
  const { k, seedK } = partsOf(strategy);
  // S(k|k) is rare and would use up colours: it shares that of S(k) with other marks.
  const place = (k * (k + 1)) / 2 + (seedK === null || seedK >= k ? 0 : 1 + seedK);
  const round = Math.floor(place / COLOURS) + (seedK !== null && seedK >= k ? 3 : 0);
  const { symbol, dash } = series(place + 2 * round);
  return { color: series(place).color, symbol, dash };
}
