/** Several solutions in one figure: trajectories in one of three frames; throttle and mass against time. */

import { el, fill } from "./dom.js";
import { axis, Figure, sampled, series } from "./figures.js";
import { FRAMES, framesOf, LIT, NOWHERE, outageOf, pointsOf } from "./flight.js";
import { shortId } from "./format.js";
import { bodies, columns, inUnits, line, proportions, sceneLayout } from "./scene.js";
import { colour } from "./theme.js";

/**
 * @import { Flight, Frame, Point, Trajectory } from "./flight.js"
 * @import { RecordInFull, WorldView } from "../types"
 */

/** @typedef {{ id: string, record: RecordInFull, world: WorldView, flight: Flight | null }} Side */

/**
 * Return the look of a side by its place, since sides may be of the same strategy.
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

/** Most points of one figure. */
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
    this.waiting = el("p", { class: "muted waiting", role: "status" }, "The solutions are being propagated for their figures; the first time after a start this may take a minute.");
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
    const shown = sides.flatMap((side) => shownTrajectories(side, hasRealizations));
    const n = shown.reduce((sum, { days }) => sum + days.length, 0);
    const step = Math.max(1, Math.ceil(n / MOST_POINTS));
    const first = /** @type {Flight} */ (sides[0].flight);
    framesOf(first.world).forEach(({ title }, i) => fill(/** @type {HTMLElement} */ (this.tabs.children[i]), title));
    const isNarrow = this.figure.plot.clientWidth < 500;
    const traces = inUnits([
      ...bodies(first, frame),
      ...(frame === "rotating" ? [moon(first)] : []),
      line("Target orbit", pointsOf(first.target, frame), { color: colour("target"), width: 4 }),
      ...sides.flatMap((side, place) => shownTrajectories(side, hasRealizations).flatMap((trajectory, i) => arcs(trajectory, i, nameOf(side, place, isNarrow), lookOf(place).color, frame, step))),
    ], first.world);
    const note = framesOf(first.world).find(({ id }) => id === frame)?.note ?? "";
    const words = `${note} Thick: thrust; thin: coast; dotted: realizations; orange: outages. ${sampled(Math.ceil(n / step), n, "samples")}`;
    const layout = { ...sceneLayout(frame, proportions(traces), this.figure.plot.clientWidth, first.world), showlegend: true };
    this.waiting.hidden = true;
    await this.figure.show(traces, layout, words);
    Object.assign(this.figure.plot.dataset, { frame, sides: sides.length, realizations: hasRealizations });
  }
}

/**
 * Return the main body, which is at rest in the rotating frame.
 * @param {Flight} flight
 */
function moon(flight) {
  const { main } = flight.world;
  const label = { mode: "markers+text", text: [main], textposition: "top center", textfont: { color: colour("muted"), size: 12 } };
  const marker = { color: colour("moon"), size: 7 };
  return { type: "scatter3d", name: main, ...columns([pointsOf(flight.moon, "rotating")[0]]), ...label, marker, hovertemplate: `${main}<extra></extra>` };
}

/**
 * @param {Side} side
 * @param {boolean} hasRealizations
 */
function shownTrajectories(side, hasRealizations) {
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

/** Samples of the mass of one trajectory. */
const OF_MASS = 120;
/** Height of the bars of one solution as a share of the figure. */
const LANE = 0.03;

export class Profiles {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Throttle and mass against time", { tall: true });
  }

  /**
   * @param {Side[]} sides those that have been flown
   * @param {boolean} hasRealizations
   */
  async show(sides, hasRealizations) {
    const isNarrow = this.figure.plot.clientWidth < 500;
    const traces = sides.flatMap((side, place) => {
      const all = side.flight?.trajectories ?? [];
      return (hasRealizations ? all : all.slice(0, 1)).flatMap((trajectory, i) => lines(trajectory, i, nameOf(side, place, isNarrow), lookOf(place).color));
    });
    const words = `Time since the departure of each solution.${hasRealizations ? " Realizations are dotted." : ""} Bars above: outages, in the colour of the solution that survives them.`;
    await this.figure.show(traces, layout(sides), words);
    this.figure.plot.dataset.sides = String(sides.length);
  }
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index 0 is the reference
 * @param {string} name
 * @param {string} color
 */
function lines(trajectory, index, name, color) {
  const style = { type: "scatter", mode: "lines", name, legendgroup: name, line: { color, width: index === 0 ? 2 : 1.2, dash: index === 0 ? "solid" : "dot" } };
  const arcs = trajectory.arcs.filter(({ first, stop }) => stop > first);
  const throttle = {
    x: arcs.flatMap(({ first, stop }) => [trajectory.days[first], trajectory.days[stop - 1]]),
    y: arcs.flatMap((arc) => [arc.throttle, arc.throttle]),
  };
  const step = Math.max(1, Math.ceil(trajectory.days.length / OF_MASS));
  const places = trajectory.days.map((_, i) => i).filter((i) => i % step === 0 || i === trajectory.days.length - 1);
  const mass = { x: places.map((i) => trajectory.days[i]), y: places.map((i) => trajectory.mass_kg[i]) };
  const extra = `<extra>${name}${index ? `, realization ${index}` : ""}</extra>`;
  return [
    { ...style, ...throttle, showlegend: index === 0, hovertemplate: `%{y:.2f}${extra}` },
    { ...style, ...mass, yaxis: "y2", showlegend: false, hovertemplate: `%{y:.1f} kg${extra}` },
  ];
}

/** @param {Side[]} sides */
function layout(sides) {
  return {
    showlegend: true,
    hovermode: "closest",
    xaxis: { ...axis("days after departure"), anchor: "y2" },
    yaxis: axis("throttle [–]", { domain: [0.5, 0.86], range: [-0.03, 1.06], tickvals: [0, 0.5, 1], fixedrange: true }),
    yaxis2: axis("mass [kg]", { domain: [0, 0.4], tickformat: ",.0f", nticks: 5, fixedrange: true }),
    shapes: sides.flatMap((side, place) => (side.flight?.trajectories ?? []).flatMap((trajectory) => band(trajectory, place))),
  };
}

/**
 * @param {Trajectory} trajectory
 * @param {number} place
 */
function band(trajectory, place) {
  const outage = outageOf(trajectory);
  if (!outage) return [];
  const color = lookOf(place).color;
  const across = { xref: "x", yref: "paper", x0: outage.from, x1: outage.from + outage.days };
  // A row of its own for each, so that equal ones do not hide each other.
  const top = 1 - place * LANE;
  return [{ type: "rect", ...across, y0: top - 0.8 * LANE, y1: top, fillcolor: color, line: { color, width: 1 } }];
}
