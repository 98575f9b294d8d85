/** Controls, mass and distances of a solution against time: outages shaded, the chosen moment marked. */

import { el } from "./dom.js";
import { Figure, sampled } from "./figures.js";
import { distance, LIT, lookOf, nameOf, outageOf } from "./flight.js";
import { colour } from "./theme.js";

/** @import { Arc, Flight, Trajectory, World } from "./flight.js" */

/** @typedef {{ title: string, from: number, to: number, axis?: object, of: (trajectory: Trajectory) => { x: (number | null)[], y: (number | null)[] } }} Row */

/** Most points of one figure, all rows together. */
const MOST_POINTS = 5000;
const DEGREES = 180 / Math.PI;

/** @type {Row[]} */
const CONTROLS = [
  {
    title: "throttle [–]",
    from: 0.7,
    to: 1,
    axis: { range: [-0.03, 1.06], tickvals: [0, 0.5, 1] },
    of: (trajectory) => steps(trajectory, (arc) => arc.throttle),
  },
  {
    title: "in-plane [°]",
    from: 0.35,
    to: 0.65,
    axis: { range: [-190, 190], tickvals: [-180, -90, 0, 90, 180] },
    of: (trajectory) => steps(trajectory, (arc) => (arc.throttle < LIT ? null : arc.in_plane_rad * DEGREES)),
  },
  {
    title: "out-of-plane [°]",
    from: 0,
    to: 0.3,
    axis: { range: [-95, 95], tickvals: [-90, -45, 0, 45, 90] },
    of: (trajectory) => steps(trajectory, (arc) => (arc.throttle < LIT ? null : arc.out_of_plane_rad * DEGREES)),
  },
];

/**
 * @param {number} step
 * @param {World} world
 * @returns {Row[]}
 */
function state(step, { center, main, length_km: length }) {
  const [unit, km] = length > 1e6 ? ["10⁶ km", 1e6] : ["10³ km", 1e3];
  const log = { type: "log", tickvals: [1, 3, 10, 30, 100, 300, 1000] };
  return [
    { title: "mass [kg]", from: 0.7, to: 1, axis: { tickformat: ",.0f", nticks: 4 }, of: (t) => every(t, step, (i) => t.mass_kg[i]) },
    { title: `to ${center} [${unit}]`, from: 0.35, to: 0.65, axis: { rangemode: "tozero", nticks: 5 }, of: (t) => every(t, step, (i) => distance(t.inertial_km[i]) / km) },
    { title: `to ${main} [${unit}]`, from: 0, to: 0.3, axis: log, of: (t) => every(t, step, (i) => distance(t.inertial_km[i], t.moon_km[i]) / km) },
  ];
}

export class ProfileFigures {
  /**
   * @param {HTMLElement} controls
   * @param {HTMLElement} states
   */
  constructor(controls, states) {
    this.controls = new Timed(controls, "Controls against time");
    this.states = new Timed(states, "Mass and distances against time");
  }

  /**
   * @param {Flight} flight
   * @param {Set<number>} hidden
   */
  async show(flight, hidden) {
    const shown = flight.trajectories.map((_, i) => i).filter((i) => !hidden.has(i));
    const n = shown.reduce((sum, i) => sum + 3 * flight.trajectories[i].days.length, 0);
    const step = Math.max(1, Math.ceil(n / (MOST_POINTS - 200 * shown.length)));
    const angles = "Angles: azimuth and elevation in J2000 axes, where the thruster burns.";
    await this.controls.show(flight, shown, CONTROLS, angles);
    await this.states.show(flight, shown, state(step, flight.world), `${sampled(Math.ceil(n / step), n)}Distances from the centres of the bodies.`);
  }

  /** @param {number} day */
  mark(day) {
    this.controls.mark(day);
    this.states.mark(day);
  }
}

/** A figure against time, with a line at the chosen day. */
class Timed {
  /**
   * @param {HTMLElement} place
   * @param {string} title
   */
  constructor(place, title) {
    this.figure = new Figure(place, title, { tall: true });
    this.now = el("div", { class: "now", hidden: true, "aria-hidden": "true" });
    const holder = el("div", { class: "holder" });
    this.figure.plot.replaceWith(holder);
    holder.append(this.figure.plot, this.now);
    this.day = 0;
  }

  /**
   * @param {Flight} flight
   * @param {number[]} shown
   * @param {Row[]} rows
   * @param {string} caption
   */
  async show(flight, shown, rows, caption) {
    const traces = rows.flatMap((row, place) => shown.map((i) => trace(flight.trajectories[i], i, row, place)));
    await this.figure.show(traces, layout(flight, shown, rows), caption);
    const plot = /** @type {any} */ (this.figure.plot);
    if (!this.isFollowing) plot.on("plotly_afterplot", () => this.mark(this.day));
    this.isFollowing = true;
    this.mark(this.day);
  }

  /**
   * Place the line, an element of its own: one of plotly's would redraw the whole figure.
   * @param {number} day
   */
  mark(day) {
    this.day = day;
    const full = /** @type {any} */ (this.figure.plot)._fullLayout;
    if (!full?.xaxis) return;
    const [left, width] = [full._size.l, full._size.w];
    const x = full.xaxis.d2p(day);
    this.now.hidden = x < 0 || x > width;
    this.now.style.left = `${left + x}px`;
    this.now.style.top = `${full._size.t}px`;
    this.now.style.height = `${full._size.h}px`;
    this.now.dataset.day = day.toFixed(2);
  }
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index
 * @param {Row} row
 * @param {number} place
 */
function trace(trajectory, index, row, place) {
  const { color, dash } = lookOf(index);
  const isFilled = index === 0 && row.title.startsWith("throttle");
  return {
    type: "scatter",
    mode: "lines",
    name: nameOf(index),
    ...row.of(trajectory),
    yaxis: place === 0 ? "y" : `y${place + 1}`,
    connectgaps: false,
    line: { color, dash, width: index === 0 ? 1.5 : 2 },
    fill: isFilled ? "tozeroy" : "none",
    fillcolor: colour("reference-fill"),
    hovertemplate: `%{y:.4~g}<extra>${nameOf(index)}</extra>`,
  };
}

/**
 * Return a quantity that is constant on each arc as a step line.
 * @param {Trajectory} trajectory
 * @param {(arc: Arc) => number | null} of
 */
function steps(trajectory, of) {
  const arcs = trajectory.arcs.filter((arc) => arc.stop > arc.first);
  return {
    x: arcs.flatMap((arc) => [trajectory.days[arc.first], trajectory.days[arc.stop - 1]]),
    y: arcs.flatMap((arc) => [of(arc), of(arc)]),
  };
}

/**
 * @param {Trajectory} trajectory
 * @param {number} step
 * @param {(i: number) => number} of
 */
function every(trajectory, step, of) {
  const last = trajectory.days.length - 1;
  const places = trajectory.days.map((_, i) => i).filter((i) => i % step === 0 || i === last);
  return { x: places.map((i) => trajectory.days[i]), y: places.map(of) };
}

/**
 * @param {Flight} flight
 * @param {number[]} shown
 * @param {Row[]} rows
 */
function layout(flight, shown, rows) {
  const axis = { gridcolor: colour("line"), linecolor: colour("line-strong"), zeroline: false };
  const axes = rows.map((row, place) => {
    const name = place === 0 ? "yaxis" : `yaxis${place + 1}`;
    return [name, { ...axis, fixedrange: true, domain: [row.from, row.to], title: { text: row.title, standoff: 6, font: { size: 11 } }, ...row.axis }];
  });
  return {
    margin: { l: 76, r: 10, t: 22, b: 42 },
    hovermode: "x unified",
    uirevision: "kept",
    xaxis: { ...axis, title: { text: "days after departure", standoff: 8 }, anchor: `y${rows.length}`, zeroline: false },
    ...Object.fromEntries(axes),
    ...outages(flight, shown),
  };
}

/**
 * @param {Flight} flight
 * @param {number[]} shown
 */
function outages(flight, shown) {
  const all = shown.flatMap((i) => {
    const outage = outageOf(flight.trajectories[i]);
    return outage ? [{ ...outage, i }] : [];
  });
  return {
    shapes: all.map(({ from, days }) => ({
      type: "rect",
      xref: "x",
      yref: "paper",
      x0: from,
      x1: from + days,
      y0: 0,
      y1: 1,
      fillcolor: colour("outage"),
      opacity: 0.28,
      line: { width: 0 },
      layer: "below",
    })),
    annotations: all.map(({ from, days, i }) => ({
      x: from + days / 2,
      y: 1,
      yref: "paper",
      yanchor: "bottom",
      showarrow: false,
      text: all.length < 5 ? `outage ${i}` : String(i),
      font: { color: colour("outage-text"), size: 11 },
    })),
  };
}
