/** Marks of solves: the shape tells what became of a hop, filled or hollow and the colour how it ended. */

import { svg } from "./dom.js";
import { OUTCOMES } from "./outcomes.js";
import { colour } from "./theme.js";

/** @typedef {"start" | "accepted" | "rejected" | "restarted" | "mapped"} Role */

/** What the roles are called in legends. */
export const ROLES = /** @type {Record<Role, string>} */ ({
  start: "fresh start",
  accepted: "hop accepted",
  rejected: "hop rejected",
  restarted: "rejected, then restarted",
  mapped: "mapped seed",
});
/** Room for a letter of a legend [px]. */
const LETTER_PX = 6.6;
const LINE_PX = 20;

/**
 * @param {import("./outcomes.js").Outcome} outcome
 */
export function colourOf(outcome) {
  return colour(OUTCOMES.find(({ key }) => key === outcome)?.colour ?? "coast");
}

/**
 * Return a mark.
 * @param {Role} role
 * @param {{ paint: string, isFilled: boolean }} how
 * @param {number} x
 * @param {number} y
 * @param {number} r half its width
 */
export function mark(role, { paint, isFilled }, x, y, r) {
  const thin = Math.max(1.2, r * 0.28);
  const look = { fill: isFilled ? paint : "none", stroke: paint, "stroke-width": thin, "stroke-linejoin": "round" };
  if (role === "start") return svg("rect", { ...look, x: x - 0.9 * r, y: y - 0.9 * r, width: 1.8 * r, height: 1.8 * r });
  if (role === "rejected") {
    const d = 0.8 * r;
    const path = `M${x - d} ${y - d}L${x + d} ${y + d}M${x - d} ${y + d}L${x + d} ${y - d}`;
    return svg("path", { ...look, fill: "none", d: path, "stroke-width": isFilled ? r * 0.62 : thin, "stroke-linecap": "round" });
  }
  if (role === "restarted") return svg("path", { ...look, d: `M${x - r} ${y - 0.8 * r}L${x + r} ${y - 0.8 * r}L${x} ${y + r}Z` });
  return svg("circle", { ...look, cx: x, cy: y, r });
}

/**
 * Return a legend of the roles and outcomes that occur, and its height.
 * @param {Set<Role>} roles
 * @param {Set<import("./outcomes.js").Outcome>} outcomes
 * @param {number} width
 */
export function legend(roles, outcomes, width) {
  const plain = { paint: colour("muted"), isFilled: true };
  /** @type {[Role, { paint: string, isFilled: boolean }, string][]} */
  const entries = [];
  for (const role of /** @type {Role[]} */ (Object.keys(ROLES))) if (roles.has(role) && roles.size > 1) entries.push([role, plain, ROLES[role]]);
  for (const { key, words } of OUTCOMES) {
    if (outcomes.has(key)) entries.push(["mapped", { paint: colourOf(key), isFilled: isFeasible(key) }, words]);
  }
  /** @type {SVGElement[]} */
  const content = [];
  let [x, y] = [8, 10];
  for (const [role, how, words] of entries) {
    const room = 30 + words.length * LETTER_PX;
    if (x > 8 && x + room > width) [x, y] = [8, y + LINE_PX];
    content.push(mark(role, how, x, y, 5), svg("text", { x: x + 11, y: y + 4, fill: colour("muted") }, words));
    x += room;
  }
  return { content, height: y + LINE_PX };
}

/** @param {import("./outcomes.js").Outcome} outcome */
export function isFeasible(outcome) {
  return outcome === "strict" || outcome === "paper";
}
