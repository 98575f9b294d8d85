// @ts-check
/** The chosen solution in space, in one of three frames. */

import { byId, el, fill } from "./dom.js";
import { number } from "./format.js";
import { draw, realizationColour } from "./plots.js";
import { colour } from "./theme.js";

/**
 * @typedef {import("./api.js").Flight} Flight
 * @typedef {import("./api.js").Trajectory} Trajectory
 * @typedef {import("./api.js").Path} Path
 * @typedef {"rotating" | "inertial" | "moon"} Frame
 * @typedef {[number | null, number | null, number | null]} Point
 */

/** @type {{ id: Frame, title: string, note: string }[]} */
export const FRAMES = [
  {
    id: "rotating",
    title: "Earth–Moon rotating",
    note: "x along the Moon, z along its angular momentum; lengths scaled so that the Moon stays at 384 400 km.",
  },
  { id: "inertial", title: "Inertial", note: "Geocentric, J2000 axes." },
  { id: "moon", title: "Moon", note: "Moon-centred, J2000 axes; drawn within 100 000 km, the Moon to scale." },
];

/** Below this throttle a segment counts as a coast in pictures. */
export const LIT = 0.02;
/** How far from the Moon the Moon-centred picture reaches [km]. */
const MOON_REACH_KM = 1e5;
const MOON_RADIUS_KM = 1737.4;
const KM_PER_UNIT = 1000;

/**
 * @param {Flight} flight
 * @param {Frame} frame
 */
export async function showTrajectory(flight, frame) {
  const traces = [
    ...bodies(flight, frame),
    line("Target orbit", pathPoints(flight.target, frame), { color: colour("target"), width: 4 }),
    ...flight.trajectories.flatMap((trajectory, index) => trajectoryTraces(trajectory, index, frame)),
  ];
  legend(flight, frame);
  byId("frame-note").textContent = FRAMES.find(({ id }) => id === frame)?.note ?? "";
  const place = byId("trajectory");
  place.dataset.frame = frame;
  const isNarrow = place.clientWidth < 500;
  await draw(place, traces, layout(frame, proportions(traces), isNarrow), "png");
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index
 * @param {Frame} frame
 */
function trajectoryTraces(trajectory, index, frame) {
  const name = index === 0 ? "reference" : `realization ${index}`;
  const points = placed(trajectory.inertial_km, trajectory.rotating_km, trajectory.moon_km, frame);
  const told = trajectory.days.map(
    (day, i) =>
      `${name}, ${number(day, 2, "d")}<br>${number(trajectory.mass_kg[i], 1, "kg")}, ` +
      `${number(trajectory.speed_km_s[i], 3, "km/s")}<br>Earth ${number(distance(trajectory.inertial_km[i]), 0, "km")}, ` +
      `Moon ${number(distance(trajectory.inertial_km[i], trajectory.moon_km[i]), 0, "km")}`,
  );
  const main = index === 0 ? colour("reference") : realizationColour(index);
  const faint = index === 0 ? colour("coast") : main;
  const styles = {
    thrust: { color: main, width: 6 },
    coast: { color: faint, width: 2 },
    outage: { color: colour("outage"), width: 9 },
  };
  return /** @type {const} */ (["coast", "thrust", "outage"]).map((kind) => {
    const [chosen, texts] = arcsOf(trajectory, kind, points, told);
    return { ...line(`${name}, ${kind}`, chosen, styles[kind]), text: texts, hovertemplate: "%{text}<extra></extra>" };
  });
}

/**
 * @param {number[]} place
 * @param {number[]} [from] the Earth's centre if left out
 */
function distance(place, from = [0, 0, 0]) {
  return Math.hypot(...place.map((value, axis) => value - from[axis]));
}

/**
 * Return the points of all arcs of a kind, with gaps between them.
 * @param {Trajectory} trajectory
 * @param {"coast" | "thrust" | "outage"} kind
 * @param {Point[]} points
 * @param {string[]} told
 * @returns {[Point[], string[]]}
 */
function arcsOf(trajectory, kind, points, told) {
  /** @type {Point[]} */
  const chosen = [];
  /** @type {string[]} */
  const texts = [];
  for (const arc of trajectory.arcs) {
    const drawn = arc.kind === "thrust" && arc.throttle < LIT ? "coast" : arc.kind;
    if (drawn !== kind) continue;
    chosen.push(...points.slice(arc.first, arc.stop), [null, null, null]);
    texts.push(...told.slice(arc.first, arc.stop), "");
  }
  return [chosen, texts];
}

/**
 * @param {number[][]} inertial
 * @param {number[][]} rotating
 * @param {number[][]} moon
 * @param {Frame} frame
 * @returns {Point[]}
 */
function placed(inertial, rotating, moon, frame) {
  if (frame === "rotating") return /** @type {Point[]} */ (rotating);
  if (frame === "inertial") return /** @type {Point[]} */ (inertial);
  return inertial.map((row, i) => {
    if (!(distance(row, moon[i]) < MOON_REACH_KM)) return [null, null, null];
    return /** @type {Point} */ (row.map((value, axis) => value - moon[i][axis]));
  });
}

/**
 * @param {Path} path
 * @param {Frame} frame
 */
function pathPoints(path, frame) {
  return placed(path.inertial_km, path.rotating_km, path.moon_km, frame);
}

/**
 * @param {string} name
 * @param {Point[]} points
 * @param {object} style
 */
function line(name, points, style) {
  return { type: "scatter3d", mode: "lines", name, hoverinfo: "skip", connectgaps: false, line: style, ...columns(points) };
}

/** @param {Point[]} points */
function columns(points) {
  const scaled = (/** @type {number} */ axis) =>
    points.map((point) => (point[axis] === null ? null : /** @type {number} */ (point[axis]) / KM_PER_UNIT));
  return { x: scaled(0), y: scaled(1), z: scaled(2) };
}

/**
 * @param {Flight} flight
 * @param {Frame} frame
 */
function bodies(flight, frame) {
  const [reference] = flight.trajectories;
  const start = placed(reference.inertial_km, reference.rotating_km, reference.moon_km, frame)[0];
  const markers = [marker("departure", start, colour("text"), 4, "circle-open")];
  if (frame === "moon") return [...markers, sphere(MOON_RADIUS_KM)];
  const end = pathPoints(flight.moon, frame).at(-1) ?? [null, null, null];
  markers.push(marker("Earth", [0, 0, 0], colour("earth"), 9, "circle"), marker("Moon", end, colour("moon"), 6, "circle"));
  const path = line("Moon’s path", pathPoints(flight.moon, frame), { color: colour("moon"), width: 1.5, dash: "dot" });
  return frame === "inertial" ? [path, ...markers] : markers;
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

/** @param {number} radiusKm */
function sphere(radiusKm) {
  const steps = Array.from({ length: 25 }, (_, i) => i / 24);
  const radius = radiusKm / KM_PER_UNIT;
  const grid = (/** @type {(u: number, v: number) => number} */ of) =>
    steps.map((v) => steps.map((u) => radius * of(2 * Math.PI * u, Math.PI * v)));
  return {
    type: "surface",
    name: "Moon",
    x: grid((u, v) => Math.cos(u) * Math.sin(v)),
    y: grid((u, v) => Math.sin(u) * Math.sin(v)),
    z: grid((_, v) => Math.cos(v)),
    colorscale: [[0, colour("moon")], [1, colour("moon")]],
    showscale: false,
    hovertemplate: "Moon<extra></extra>",
  };
}

/**
 * Return the sides of the box around all traces, the longest being 1.
 * @param {any[]} traces
 */
function proportions(traces) {
  const [x, y, z] = ["x", "y", "z"].map((axis) => {
    // Not spread into Math.min: a picture may have more points than a call may have arguments.
    const values = traces.flatMap((trace) => trace[axis].flat()).filter(Number.isFinite);
    return values.reduce((a, b) => Math.max(a, b), -Infinity) - values.reduce((a, b) => Math.min(a, b), Infinity);
  });
  const longest = Math.max(x, y, z);
  return { x: x / longest, y: y / longest, z: z / longest };
}

/**
 * @param {Frame} frame
 * @param {{ x: number, y: number, z: number }} aspectratio
 * @param {boolean} isNarrow
 */
function layout(frame, aspectratio, isNarrow) {
  const axis = (/** @type {string} */ title, ticks = 6) => ({
    nticks: ticks,
    title: { text: `${title} [10³ km]`, font: { size: 11 } },
    tickfont: { size: 10 },
    gridcolor: colour("line"),
    zeroline: false,
    showbackground: false,
    showspikes: false,
  });
  const eyes = { rotating: [0.1, -1.02, 0.8], inertial: [0.36, -0.76, 1.06], moon: [1.0, -1.05, 0.33] };
  // A narrow picture shows all of the scene from further away.
  const [x, y, z] = eyes[frame].map((value) => value * (isNarrow ? 1.3 : 1));
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

/**
 * @param {Flight} flight
 * @param {Frame} frame
 */
function legend(flight, frame) {
  const realizations = flight.trajectories.slice(1);
  /** @type {[string, string, string][]} */
  const entries = [["thick", colour("reference"), "reference, thrust"], ["thin", colour("coast"), "reference, coast"]];
  if (realizations.length > 0) entries.push(["thick", colour("outage"), "outage"]);
  realizations.forEach((_, i) => {
    const which = realizations.length > 1 ? `realization ${i + 1}` : "realization";
    entries.push(["thick", realizationColour(i + 1), `${which}, thrust`], ["thin", realizationColour(i + 1), `${which}, coast`]);
  });
  entries.push(["medium", colour("target"), "target orbit"]);
  if (frame === "inertial") entries.push(["dotted", colour("moon"), "Moon’s path"]);
  fill(
    byId("legend"),
    entries.map(([kind, tint, words]) => el("li", {}, el("i", { class: kind, style: `--tint:${tint}` }), words)),
  );
}
