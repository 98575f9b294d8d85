/** A solution in samples, as `GET /solutions/{id}/trajectory` gives it: names, frames and positions. */

import { number } from "./format.js";
import { colour } from "./theme.js";

/** @import { OutageView } from "../types" */

/**
 * @typedef {{ kind: "coast" | "thrust" | "outage", segment: number, first: number, stop: number, throttle: number,
 *   in_plane_rad: number, out_of_plane_rad: number }} Arc
 * @typedef {{ days: number[], inertial_km: number[][], rotating_km: number[][], moon_km: number[][], length_km?: number }} Track
 * @typedef {Track & { outage: OutageView | null, arcs: Arc[], matchpoint: number, speed_km_s: number[], mass_kg: number[] }} Trajectory
 * @typedef {{ center: string, main: string, length_km: number, main_radius_km: number }} World  names, the main body's mean
 *   distance and radius; `moon` and `moon_km` of the data are the main body's
 * @typedef {{ trajectories: Trajectory[], moon: Track, target: Track, n_samples: number, world: World }} Flight
 * @typedef {"rotating" | "inertial" | "moon"} Frame
 * @typedef {[number | null, number | null, number | null]} Point
 */

/** Distance of the Moon, and the reach of the frame about it that is drawn [km]; other worlds in proportion. */
const [MOON_KM, MOON_REACH_KM] = [384_400, 1e5];

/**
 * Return the frames of a world.
 * @param {World} world
 * @returns {{ id: Frame, title: string, note: string }[]}
 */
export function framesOf({ center, main, length_km, main_radius_km }) {
  const [name, scale] = [main === "target" ? "target" : main, number(length_km, 0, "km")];
  const the = name === "Moon" || name === "target" ? `the ${name}` : name;
  const title = name[0].toUpperCase() + name.slice(1);
  const sized = main_radius_km > 0 ? `, ${the} to scale` : "";
  return [
    {
      id: "rotating",
      title: `${center}–${name} rotating`,
      note: `x along ${the}, z along its angular momentum; lengths scaled so that ${the} stays at ${scale}.`,
    },
    { id: "inertial", title: "Inertial", note: `${center === "Earth" ? "Geocentric" : "Heliocentric"}, J2000 axes.` },
    { id: "moon", title: `${title}-centred`, note: `${title}-centred, J2000 axes; drawn within ${number(reach(length_km), 0, "km")}${sized}.` },
  ];
}

/** @param {number} lengthKm of a world */
function reach(lengthKm) {
  return (MOON_REACH_KM * lengthKm) / MOON_KM;
}

/** What they are called until a flight tells what they are about. @type {{ id: Frame, title: string }[]} */
export const FRAMES = [
  { id: "rotating", title: "Rotating" },
  { id: "inertial", title: "Inertial" },
  { id: "moon", title: "Near the target" },
];

/** Below this throttle a segment is drawn as a coast. */
export const LIT = 0.02;
/** @type {Point} */
export const NOWHERE = [null, null, null];
const COLOURS = ["realization", "realization-2", "realization-3", "realization-4", "realization-5"];
const DASHES = ["solid", "dash", "dot"];
const DAY_MS = 86_400_000;

/** @param {number} index 0 is the reference */
export function nameOf(index) {
  return index === 0 ? "reference" : `realization ${index}`;
}

/**
 * Return colour and dash of a trajectory, distinguishable with any colour vision; trajectories of one colour differ in dash.
 * @param {number} index
 */
export function lookOf(index) {
  if (index === 0) return { color: colour("reference"), dash: "solid" };
  const place = index - 1;
  return { color: colour(COLOURS[place % COLOURS.length]), dash: DASHES[Math.floor(place / COLOURS.length) % DASHES.length] };
}

/** @param {Flight} flight */
export function lastDay(flight) {
  return Math.max(...flight.trajectories.map(({ days }) => days[days.length - 1]));
}

/**
 * Return all points of a track in a frame.
 * @param {Track} track
 * @param {Frame} frame
 * @returns {Point[]}
 */
export function pointsOf(track, frame) {
  return track.days.map((_, i) => pointOf(track, i, frame));
}

/**
 * @param {Track} track
 * @param {number} i
 * @param {Frame} frame
 * @returns {Point}
 */
function pointOf(track, i, frame) {
  if (frame === "rotating") return /** @type {Point} */ (track.rotating_km[i]);
  const [place, moon] = [track.inertial_km[i], track.moon_km[i]];
  if (frame === "inertial") return /** @type {Point} */ (place);
  if (!(distance(place, moon) < reach(track.length_km ?? MOON_KM))) return NOWHERE;
  return /** @type {Point} */ (place.map((value, axis) => value - moon[axis]));
}

/**
 * Return the interpolated position on a day; NOWHERE outside the samples.
 * @param {Track} track
 * @param {number} day
 * @param {Frame} frame
 * @returns {Point}
 */
export function placeAt(track, day, frame) {
  const { days } = track;
  const last = days.length - 1;
  if (day < days[0] - 1e-9 || day > days[last] + 1e-9) return NOWHERE;
  const i = Math.max(0, Math.min(last - 1, before(days, day)));
  const [a, b] = [pointOf(track, i, frame), pointOf(track, i + 1, frame)];
  const span = days[i + 1] - days[i];
  const share = span > 0 ? (day - days[i]) / span : 0;
  if (a[0] === null || b[0] === null) return NOWHERE;
  return /** @type {Point} */ (a.map((value, axis) => /** @type {number} */ (value) * (1 - share) + /** @type {number} */ (b[axis]) * share));
}

/**
 * Return the index of the last entry of a sorted list that is at most a value.
 * @param {number[]} sorted
 * @param {number} value
 */
function before(sorted, value) {
  let [low, high] = [0, sorted.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (sorted[middle] <= value) low = middle;
    else high = middle - 1;
  }
  return low;
}

/**
 * Return the spacecraft's position on a day: on its trajectory, after arrival on the target orbit.
 * @param {Flight} flight
 * @param {number} index
 * @param {number} day
 * @param {Frame} frame
 */
export function spacecraftAt(flight, index, day, frame) {
  const place = placeAt(flight.trajectories[index], day, frame);
  const { days } = flight.trajectories[index];
  return place[0] === null && day > days[days.length - 1] ? placeAt(flight.target, day, frame) : place;
}

/**
 * @param {number[]} place
 * @param {number[]} [from] the centre if left out
 */
export function distance(place, from = [0, 0, 0]) {
  return Math.hypot(place[0] - from[0], place[1] - from[1], place[2] - from[2]);
}

/**
 * Return when an outage begins [days past departure]; null for the reference.
 * @param {Trajectory} trajectory
 */
export function outageOf(trajectory) {
  const arc = trajectory.arcs.find(({ kind }) => kind === "outage");
  return arc && trajectory.outage ? { from: trajectory.days[arc.first], days: trajectory.outage.duration_days } : null;
}

/**
 * Return the date of a day past departure, in TDB: days have 86 400 s, as in no civil calendar.
 * @param {{ arrival_epoch: string, time_of_flight_days: number }} record
 * @param {number} day
 */
export function dateOf(record, day) {
  const arrival = Date.parse(`${record.arrival_epoch}Z`);
  const moment = new Date(arrival + (day - record.time_of_flight_days) * DAY_MS);
  return `${moment.toISOString().slice(0, 16).replace("T", " ")}\u00a0TDB`;
}

/**
 * Return the outage that a realization recovers from, in words.
 * @param {Trajectory} trajectory
 */
export function outageText(trajectory) {
  const { outage } = trajectory;
  return outage ? `segment ${outage.segment}, ${number(outage.duration_days, 1, "d")}` : "";
}
