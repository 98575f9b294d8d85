/** Several trajectories in one picture, in one of three frames. */

import { el } from "../dom.js";
import { Figure, sampled } from "../figure.js";
import { FRAMES, LIT, NOWHERE, pointsOf } from "../flight.js";
import { bodies, columns, line, proportions, sceneLayout } from "../scene.js";
import { colour } from "../theme.js";
import { lookOf, nameOf } from "./sides.js";

/**
 * @typedef {import("../flight.js").Frame} Frame
 * @typedef {import("../flight.js").Point} Point
 * @typedef {import("../flight.js").Trajectory} Trajectory
 * @typedef {import("./sides.js").Side} Side
 */

/** Points of one picture. */
const MOST_POINTS = 5000;

export class Overlay {
  /**
   * @param {HTMLElement} place
   * @param {(frame: Frame) => void} onFrame
   * @param {(isShown: boolean) => void} onRealizations
   */
  constructor(place, onFrame, onRealizations) {
    this.figure = new Figure(place, "Trajectories", { tall: true });
    this.onFrame = onFrame;
    const box = el("input", { type: "checkbox", id: "realizations", onchange: (/** @type {Event} */ event) => onRealizations(/** @type {HTMLInputElement} */ (event.target).checked) });
    this.box = /** @type {HTMLInputElement} */ (box);
    this.tabs = el("div", { class: "tabs", role: "tablist", "aria-label": "Frame" }, FRAMES.map(({ id, title }) => el("button", { type: "button", role: "tab", "data-frame": id, onclick: () => onFrame(id) }, title)));
    this.tabs.addEventListener("keydown", (event) => this.turn(event));
    this.figure.buttons.before(el("label", { class: "switch" }, box, "Realizations"), this.tabs);
    this.waiting = el("p", { class: "muted waiting", role: "status" }, "The solutions are being flown again for their pictures; the first time after a start this may take a minute.");
    this.figure.plot.before(this.waiting);
  }

  /** @param {KeyboardEvent} event */
  turn(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const tabs = /** @type {HTMLElement[]} */ ([...this.tabs.children]);
    const place = tabs.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    if (step === undefined || place < 0) return;
    const next = tabs[(place + step + tabs.length) % tabs.length];
    this.onFrame(/** @type {Frame} */ (next.dataset.frame));
    next.focus();
    event.preventDefault();
  }

  /**
   * @param {Side[]} sides those that have been flown
   * @param {Frame} frame
   * @param {boolean} hasRealizations
   */
  async show(sides, frame, hasRealizations) {
    for (const tab of this.tabs.children) {
      const isChosen = tab.getAttribute("data-frame") === frame;
      tab.setAttribute("aria-selected", String(isChosen));
      tab.setAttribute("tabindex", isChosen ? "0" : "-1");
    }
    this.box.checked = hasRealizations;
    const shown = sides.flatMap((side) => flown(side, hasRealizations));
    const n = shown.reduce((sum, { days }) => sum + days.length, 0);
    const step = Math.max(1, Math.ceil(n / MOST_POINTS));
    const first = /** @type {import("../flight.js").Flight} */ (sides[0].flight);
    const isNarrow = this.figure.plot.clientWidth < 500;
    const traces = [
      ...bodies(first, frame),
      ...(frame === "rotating" ? [moon(first)] : []),
      line("Target orbit", pointsOf(first.target, frame), { color: colour("target"), width: 4 }),
      ...sides.flatMap((side, place) => flown(side, hasRealizations).flatMap((trajectory, i) => arcs(trajectory, i, nameOf(side, place, isNarrow), lookOf(place).color, frame, step))),
    ];
    const note = FRAMES.find(({ id }) => id === frame)?.note ?? "";
    const words = `${note} Thick: thrust; thin: coast; realizations dotted, without thrust orange. ${sampled(Math.ceil(n / step), n, "samples")}`;
    const layout = { ...sceneLayout(frame, proportions(traces), this.figure.plot.clientWidth), showlegend: true };
    this.waiting.hidden = true;
    await this.figure.show(traces, layout, words);
    Object.assign(this.figure.plot.dataset, { frame, sides: sides.length, realizations: hasRealizations });
  }
}

/**
 * Return the Moon where it stands still.
 * @param {import("../flight.js").Flight} flight
 */
function moon(flight) {
  const label = { mode: "markers+text", text: ["Moon"], textposition: "top center", textfont: { color: colour("muted"), size: 12 } };
  const marker = { color: colour("moon"), size: 7 };
  return { type: "scatter3d", name: "Moon", ...columns([pointsOf(flight.moon, "rotating")[0]]), ...label, marker, hovertemplate: "Moon<extra></extra>" };
}

/**
 * @param {Side} side
 * @param {boolean} hasRealizations
 */
function flown(side, hasRealizations) {
  const all = side.flight?.trajectories ?? [];
  return hasRealizations ? all : all.slice(0, 1);
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index 0 is the reference
 * @param {string} name
 * @param {string} color
 * @param {Frame} frame
 * @param {number} step every so many samples are drawn, and the ends of arcs
 */
function arcs(trajectory, index, name, color, frame, step) {
  const points = pointsOf(trajectory, frame);
  const dash = index === 0 ? "solid" : "dot";
  const styles = { thrust: { color, width: index === 0 ? 6 : 3, dash }, coast: { color, width: 2, dash }, outage: { color: colour("outage"), width: 8 } };
  const title = index === 0 ? name : `${name}, realization ${index}`;
  return /** @type {const} */ (["coast", "thrust", "outage"]).flatMap((kind) => {
    const chosen = trajectory.arcs.filter((arc) => (arc.kind === "thrust" && arc.throttle < LIT ? "coast" : arc.kind) === kind);
    if (chosen.length === 0) return [];
    const drawn = chosen.flatMap(({ first, stop }) => [...thinned(points, first, stop, step), NOWHERE]);
    const isNamed = index === 0 && kind === "thrust";
    return [{ ...line(title, drawn, styles[kind]), hoverinfo: "name", showlegend: isNamed }];
  }).map((trace, i, all) => ({ ...trace, showlegend: index === 0 && (trace.showlegend || (i === 0 && !all.some((one) => one.showlegend))) }));
}

/**
 * @param {Point[]} points
 * @param {number} first
 * @param {number} stop
 * @param {number} step
 */
function thinned(points, first, stop, step) {
  return points.slice(first, stop).filter((_, i) => i % step === 0 || i === stop - first - 1);
}
