/** A small line that shows how something got better, without axes. */

import { svg } from "./dom.js";

const [WIDTH, HEIGHT, EDGE] = [180, 40, 3];

/**
 * Return a step line through values at moments as far apart as each other; null where there is none yet.
 * @param {(number | null)[]} values
 * @param {string} words read out
 */
export function sparkline(values, words) {
  const known = values.filter((value) => value !== null);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const x = (/** @type {number} */ i) => EDGE + (i / Math.max(1, values.length - 1)) * (WIDTH - 2 * EDGE);
  const y = (/** @type {number} */ value) => HEIGHT - EDGE - (high > low ? (value - low) / (high - low) : 0) * (HEIGHT - 2 * EDGE);
  /** @type {string[]} */
  const path = [];
  values.forEach((value, i) => {
    if (value !== null) path.push(path.length ? `H${x(i).toFixed(1)}V${y(value).toFixed(1)}` : `M${x(i).toFixed(1)} ${y(value).toFixed(1)}`);
  });
  const last = values[values.length - 1];
  return svg(
    "svg",
    { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "sparkline", role: "img", "aria-label": words, preserveAspectRatio: "none" },
    svg("path", { d: path.join(""), fill: "none", "vector-effect": "non-scaling-stroke" }),
    // A point that stays round however the line is stretched.
    typeof last === "number" && svg("path", { class: "now", d: `M${x(values.length - 1)} ${y(last)}h0`, "vector-effect": "non-scaling-stroke" }),
  );
}
