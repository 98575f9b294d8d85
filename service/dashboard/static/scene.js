/** The scene of a trajectory: bodies, the Moon's path, axes and proportions. */

import { pointsOf } from "./flight.js";
import { colour } from "./theme.js";

/** @import { Flight, Frame, Point, World } from "./flight.js" */

const KM_PER_UNIT = 1000;

/**
 * @param {string} name
 * @param {Point[]} points
 * @param {object} style
 */
export function line(name, points, style) {
  return { type: "scatter3d", mode: "lines", name, hoverinfo: "skip", connectgaps: false, line: style, ...columns(points) };
}

/** @param {Point[]} points */
export function columns(points) {
  const scaled = (/** @type {number} */ axis) =>
    points.map((point) => (point[axis] === null ? null : /** @type {number} */ (point[axis]) / KM_PER_UNIT));
  return { x: scaled(0), y: scaled(1), z: scaled(2) };
}

/**
 * Return what does not move: the centre, the departure, the main body's path or, in its own frame, the main body.
 * @param {Flight} flight
 * @param {Frame} frame
 */
export function bodies(flight, frame) {
  const start = pointsOf(flight.trajectories[0], frame)[0];
  const departure = marker("departure", start, colour("text"), 4, "circle-open");
  const { center, main, main_radius_km: radius } = flight.world;
  if (frame === "moon") return [departure, radius > 0 ? sphere(main, radius) : marker(main, [0, 0, 0], colour("moon"), 7, "circle")];
  const earth = marker(center, [0, 0, 0], colour("earth"), 9, "circle");
  if (frame === "rotating") return [earth, departure];
  return [line(`${main}’s path`, pointsOf(flight.moon, frame), { color: colour("moon"), width: 1.5, dash: "dot" }), earth, departure];
}

/**
 * @param {string} name
 * @param {Point} point
 * @param {string} tint
 * @param {number} size
 * @param {string} symbol
 */
function marker(name, point, tint, size, symbol) {
  return {
    type: "scatter3d",
    mode: "markers+text",
    name,
    ...columns([point]),
    text: [name],
    textposition: "top center",
    textfont: { color: colour("muted"), size: 12 },
    marker: { color: tint, size, symbol },
    hovertemplate: `${name}<extra></extra>`,
  };
}

/**
 * @param {string} name
 * @param {number} radiusKm
 */
function sphere(name, radiusKm) {
  const steps = Array.from({ length: 25 }, (_, i) => i / 24);
  const radius = radiusKm / KM_PER_UNIT;
  const grid = (/** @type {(u: number, v: number) => number} */ of) =>
    steps.map((v) => steps.map((u) => radius * of(2 * Math.PI * u, Math.PI * v)));
  return {
    type: "surface",
    name: `${name}, to scale`,
    x: grid((u, v) => Math.cos(u) * Math.sin(v)),
    y: grid((u, v) => Math.sin(u) * Math.sin(v)),
    z: grid((_, v) => Math.cos(v)),
    colorscale: [[0, colour("moon")], [1, colour("moon")]],
    showscale: false,
    hovertemplate: `${name}<extra></extra>`,
  };
}

/**
 * Return the sides of the box around all traces, the longest being 1.
 * @param {any[]} traces
 */
export function proportions(traces) {
  const [x, y, z] = ["x", "y", "z"].map((axis) => {
    // Not spread into Math.min: a figure may have more points than a call may have arguments.
    const values = traces.flatMap((trace) => trace[axis].flat()).filter(Number.isFinite);
    return values.reduce((a, b) => Math.max(a, b), -Infinity) - values.reduce((a, b) => Math.min(a, b), Infinity);
  });
  const longest = Math.max(x, y, z);
  return { x: x / longest, y: y / longest, z: z / longest };
}

/** @param {World} world */
function isWide({ length_km: length }) {
  return length > 1e6;
}

/**
 * Return traces in the unit of the axes: thousands of kilometres, about the Sun millions.
 * @template {{ x: any, y: any, z: any }} T
 * @param {T[]} traces
 * @param {World} world
 */
export function inUnits(traces, world) {
  if (!isWide(world)) return traces;
  const less = (/** @type {(number | null)[]} */ values) => values.map((value) => (value === null ? null : value / 1000));
  return traces.map((trace) => ({ ...trace, x: less(trace.x), y: less(trace.y), z: less(trace.z) }));
}

/**
 * @param {Frame} frame
 * @param {{ x: number, y: number, z: number }} aspectratio
 * @param {number} width of the figure [px]
 * @param {World} world
 */
export function sceneLayout(frame, aspectratio, width, world) {
  const axis = (/** @type {string} */ title, ticks = 6) => ({
    nticks: ticks,
    title: { text: `${title} [${isWide(world) ? "10⁶" : "10³"} km]`, font: { size: 11 } },
    tickfont: { size: 10 },
    gridcolor: colour("line"),
    zeroline: false,
    showbackground: false,
    showspikes: false,
  });
  const eyes = { rotating: [0.1, -1.02, 0.8], inertial: [0.36, -0.76, 1.06], moon: [1.0, -1.05, 0.33] };
  // The camera is further away in a narrow figure, closer in a wide one.
  const nearness = width < 500 ? 1.3 : frame === "moon" ? 1.12 : width > 900 ? 0.85 : 1;
  const [x, y, z] = eyes[frame].map((value) => value * nearness);
  return {
    margin: { l: 0, r: 0, t: 0, b: 0 },
    // A revision per frame keeps the reader's own view while the data changes.
    uirevision: frame,
    scene: {
      aspectmode: "manual",
      aspectratio,
      xaxis: axis("x"),
      yaxis: axis("y"),
      zaxis: axis("z", frame === "moon" ? 6 : 3),
      camera: { eye: { x, y, z }, center: { x: 0, y: 0, z: frame === "rotating" ? -0.08 : -0.04 } },
      uirevision: frame,
    },
  };
}
