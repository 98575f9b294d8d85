/** A solution in space: all arcs in one of three frames, and markers that move with time. */

import { Figure, plotly, sampled } from "./figures.js";
import { distance, framesOf, LIT, lookOf, nameOf, NOWHERE, placeAt, pointsOf, spacecraftAt } from "./flight.js";
import { number } from "./format.js";
import { bodies, columns, inUnits, line, proportions, sceneLayout } from "./scene.js";
import { colour } from "./theme.js";

/** @import { Flight, Frame, Point, Trajectory, World } from "./flight.js" */

export class TrajectoryFigure {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Trajectory", { tall: true });
    this.plot = this.figure.plot;
    /** @type {Flight | undefined} */
    this.flight = undefined;
    /** @type {Frame} */
    this.frame = "rotating";
    /** @type {Set<number>} */
    this.hidden = new Set();
    this.isMoving = false;
  }

  /**
   * @param {Flight} flight
   * @param {Frame} frame
   * @param {Set<number>} hidden trajectories that are switched off
   * @param {number} day
   */
  async show(flight, frame, hidden, day) {
    [this.flight, this.frame, this.hidden] = [flight, frame, hidden];
    const traces = inUnits([
      ...bodies(flight, frame),
      line("Target orbit", pointsOf(flight.target, frame), { color: colour("target"), width: 4 }),
      ...flight.trajectories.flatMap((trajectory, index) => (hidden.has(index) ? [] : arcTraces(trajectory, index, frame, flight.world))),
      ...this.moving(day),
    ], flight.world);
    const n = flight.trajectories.reduce((sum, { days }) => sum + days.length, 0);
    const note = framesOf(flight.world).find(({ id }) => id === frame)?.note ?? "";
    const layout = sceneLayout(frame, proportions(traces), this.plot.clientWidth, flight.world);
    await this.figure.show(traces, layout, `${note} ${sampled(n, flight.n_samples, "samples")}`);
    this.plot.dataset.frame = frame;
  }

  /**
   * Return the traces that move: the Moon, and the spacecraft on every trajectory that is shown.
   * @param {number} day
   */
  moving(day) {
    const places = this.places(day);
    const shown = this.shown();
    const { main } = /** @type {Flight} */ (this.flight).world;
    const moon = {
      type: "scatter3d",
      mode: "markers+text",
      name: main,
      ...columns([places.moon]),
      text: [main],
      textposition: "top center",
      textfont: { color: colour("muted"), size: 12 },
      marker: { color: colour("moon"), size: this.frame === "moon" ? 0.1 : 7 },
      hovertemplate: `${main}<extra></extra>`,
    };
    const craft = {
      type: "scatter3d",
      mode: "markers+text",
      name: "Spacecraft",
      ...columns(places.craft),
      text: shown.map((index) => (index === 0 ? "" : String(index))),
      textposition: "middle right",
      textfont: { color: colour("text"), size: 13 },
      marker: {
        color: shown.map((index) => lookOf(index).color),
        size: 7,
        symbol: "diamond",
        line: { color: colour("text"), width: 1.5 },
      },
      hovertemplate: shown.map((index) => `${nameOf(index)}<extra></extra>`),
    };
    return [moon, craft];
  }

  /** @param {number} day */
  places(day) {
    const flight = /** @type {Flight} */ (this.flight);
    const moon = this.frame === "moon" ? NOWHERE : placeAt(flight.moon, Math.min(day, /** @type {number} */ (flight.moon.days.at(-1))), this.frame);
    return { moon, craft: this.shown().map((index) => spacecraftAt(flight, index, day, this.frame)) };
  }

  shown() {
    const flight = /** @type {Flight} */ (this.flight);
    return flight.trajectories.map((_, index) => index).filter((index) => !this.hidden.has(index));
  }

  /**
   * Move the markers to a day; one move at a time, so a slow machine skips days instead of falling behind.
   * @param {number} day
   */
  async move(day) {
    if (this.isMoving || !this.flight || !this.plot.dataset.drawn) return false;
    this.isMoving = true;
    const { moon, craft } = this.places(day);
    const [first, second] = inUnits([columns([moon]), columns(craft)], this.flight.world);
    const n = /** @type {any} */ (this.plot).data.length;
    const change = { x: [first.x, second.x], y: [first.y, second.y], z: [first.z, second.z] };
    await (await plotly()).restyle(this.plot, change, [n - 2, n - 1]);
    this.plot.dataset.day = day.toFixed(2);
    this.isMoving = false;
    return true;
  }
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index
 * @param {Frame} frame
 * @param {World} world
 */
function arcTraces(trajectory, index, frame, { center, main }) {
  const name = nameOf(index);
  const points = pointsOf(trajectory, frame);
  const labels = trajectory.days.map(
    (day, i) =>
      `${name}, ${number(day, 2, "d")}<br>${number(trajectory.mass_kg[i], 1, "kg")}, ` +
      `${number(trajectory.speed_km_s[i], 3, "km/s")}<br>${center} ${number(distance(trajectory.inertial_km[i]), 0, "km")}, ` +
      `${main} ${number(distance(trajectory.inertial_km[i], trajectory.moon_km[i]), 0, "km")}`,
  );
  const { color, dash } = lookOf(index);
  const styles = {
    thrust: { color, dash, width: 6 },
    coast: { color: index === 0 ? colour("coast") : color, dash, width: 2 },
    outage: { color: colour("outage"), width: 9 },
  };
  return /** @type {const} */ (["coast", "thrust", "outage"]).map((kind) => {
    const [chosen, texts] = arcsOf(trajectory, kind, points, labels);
    return { ...line(`${name}, ${kind}`, chosen, styles[kind]), text: texts, hoverinfo: "text", hovertemplate: "%{text}<extra></extra>" };
  });
}

/**
 * Return the points of all arcs of a kind, with gaps between them.
 * @param {Trajectory} trajectory
 * @param {"coast" | "thrust" | "outage"} kind
 * @param {Point[]} points
 * @param {string[]} labels
 * @returns {[Point[], string[]]}
 */
function arcsOf(trajectory, kind, points, labels) {
  /** @type {Point[]} */
  const chosen = [];
  /** @type {string[]} */
  const texts = [];
  for (const arc of trajectory.arcs) {
    const drawn = arc.kind === "thrust" && arc.throttle < LIT ? "coast" : arc.kind;
    if (drawn !== kind) continue;
    chosen.push(...points.slice(arc.first, arc.stop), NOWHERE);
    texts.push(...labels.slice(arc.first, arc.stop), "");
  }
  return [chosen, texts];
}
