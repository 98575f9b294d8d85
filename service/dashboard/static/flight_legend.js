/** What the colours of a trajectory mean, with a switch for each realization. */

import { el, fill } from "./dom.js";
import { lookOf, nameOf, outageText } from "./flight.js";
import { colour } from "./theme.js";

/**
 * @param {HTMLElement} place a list
 * @param {import("./flight.js").Flight} flight
 * @param {import("./flight.js").Frame} frame
 * @param {Set<number>} hidden
 * @param {(index: number, isShown: boolean) => void} onSwitch
 */
export function showLegend(place, flight, frame, hidden, onSwitch) {
  const focused = place.contains(document.activeElement) ? document.activeElement?.id : undefined;
  const switches = flight.trajectories.map((trajectory, index) => {
    const { color, dash } = lookOf(index);
    const input = el("input", { type: "checkbox", id: `shows-${index}`, checked: !hidden.has(index) });
    input.addEventListener("change", () => onSwitch(index, /** @type {HTMLInputElement} */ (input).checked));
    const swatches = [swatch("thick", color, dash), swatch("thin", index === 0 ? colour("coast") : color, dash)];
    const about = trajectory.outage && el("small", { class: "muted" }, outageText(trajectory));
    return el("li", {}, el("label", {}, input, swatches, el("span", {}, nameOf(index), " ", about)));
  });
  /** @type {[string, string, string][]} */
  const others = [["medium", colour("target"), "target orbit"]];
  if (flight.trajectories.length > 1) others.unshift(["thick", colour("outage"), "outage"]);
  if (frame === "inertial") others.push(["dotted", colour("moon"), "Moon’s path"]);
  const rest = others.map(([kind, tint, words]) => el("li", {}, swatch(kind, tint), words));
  fill(place, switches, rest, el("li", { class: "muted" }, "thick: thrust; thin: coast; ◆ spacecraft now"));
  if (focused) document.getElementById(focused)?.focus();
}

/**
 * @param {string} kind
 * @param {string} tint
 * @param {string} [dash]
 */
function swatch(kind, tint, dash = "solid") {
  const style = dash === "solid" ? "" : `; border-top-style: ${dash === "dash" ? "dashed" : "dotted"}`;
  return el("i", { class: kind, style: `--tint:${tint}${style}`, "aria-hidden": "true" });
}
