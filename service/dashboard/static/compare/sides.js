/** The sides of a comparison: which solutions, and how each looks in all pictures. */

import { shortId } from "../format.js";
import { series } from "../plots.js";

/**
 * @typedef {Record<string, any>} Record_
 * @typedef {import("../flight.js").Flight} Flight
 * @typedef {{ id: string, record: Record_, flight: Flight | null }} Side
 */

/**
 * Return the look of a side; strategies may be the same, so it is that of its place.
 * @param {number} place
 */
export function lookOf(place) {
  const { color, dash } = series(place);
  return { color, dash, letter: "ABCD"[place] };
}

/**
 * @param {Side} side
 * @param {number} place
 * @param {boolean} [isShort] where there is little room
 */
export function nameOf(side, place, isShort = false) {
  const name = `${lookOf(place).letter} ${side.record.strategy}`;
  return isShort ? name : `${name} ${shortId(side.id)}`;
}
