/** Strategies S(k) and S(k|k'): their order, and a look that is the same on all pages. */

import { series } from "./plots.js";

/** As many looks as `series` has, before colours repeat with other marks. */
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
 * Return the place of a strategy among all that there can be, from 0: S(0), S(0|0), S(1), S(1|0), S(1|1), S(2), ...
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
