/** Positions in the other frames, computed from the inertial ones so that they need not be sent. */

/** @import { Flight, Track } from "./flight.js" */

/** @typedef {[number[], number[]]} State  position [km] and velocity [km/d] */

/** Twelve times the derivative at the first, the middle and the last of five points of a polynomial. */
const WEIGHTS = { 0: [-25, 48, -36, 16, -3], 2: [1, -8, 0, 8, -1], 4: [3, -16, 36, -48, 25] };
const LEAST_STEP_DAYS = 0.4;

/**
 * Return a flight with the Moon and the rotating frame at every sample.
 * @param {Flight} flight with positions in the inertial frame alone
 */
export function withAllFrames(flight) {
  const { length_km } = flight.world;
  for (const track of [...flight.trajectories, flight.moon]) complete(track, flight.moon.days, flight.moon.inertial_km, length_km);
  complete(flight.target, flight.target.days, flight.target.moon_km, length_km);
  return flight;
}

/**
 * @param {Track} track
 * @param {number[]} days
 * @param {number[][]} places of the main body
 * @param {number} lengthKm its distance in the rotating frame
 */
function complete(track, days, places, lengthKm) {
  const velocities = places.map((_, i) => slope(days, places, i));
  const states = track.days.map((day) => moonAt(day, days, places, velocities));
  track.moon_km = states.map(([place]) => place);
  track.rotating_km = track.inertial_km.map((place, i) => rotated(place, ...states[i], lengthKm));
  track.length_km = lengthKm;
}

/**
 * Return a velocity, from five evenly spaced samples around the i-th, or to one side of it near an end.
 * @param {number[]} days
 * @param {number[][]} places
 * @param {number} i
 */
function slope(days, places, i) {
  const n = places.length;
  const h = (days[n - 1] - days[0]) / (n - 1);
  // Positions are rounded: differences over short times would be noise.
  const q = Math.max(1, Math.min(Math.round(LEAST_STEP_DAYS / h), Math.floor((n - 1) / 6)));
  const side = i < 2 * q ? 0 : i > n - 1 - 2 * q ? 4 : 2;
  const first = i - side * q;
  return [0, 1, 2].map((axis) => WEIGHTS[side].reduce((sum, weight, j) => sum + weight * places[first + j * q][axis], 0) / (12 * q * h));
}

/**
 * Return the Moon's state by cubic interpolation, accurate to a kilometre.
 * @param {number} day
 * @param {number[]} days evenly spaced
 * @param {number[][]} places
 * @param {number[][]} velocities
 * @returns {State}
 */
function moonAt(day, days, places, velocities) {
  const last = days.length - 1;
  const h = (days[last] - days[0]) / last;
  const i = Math.min(last - 1, Math.max(0, Math.floor((day - days[0]) / h)));
  const s = Math.min(1, Math.max(0, (day - days[i]) / h));
  const [a, b, c, d] = [(1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)];
  const place = places[i].map((p, k) => a * p + b * h * velocities[i][k] + c * places[i + 1][k] + d * h * velocities[i + 1][k]);
  const velocity = velocities[i].map((v, k) => (1 - s) * v + s * velocities[i + 1][k]);
  return [place, velocity];
}

/**
 * Return a position in the rotating frame: x to the main body, z along its angular momentum, scaled to its mean distance.
 * @param {number[]} place
 * @param {number[]} moon the main body
 * @param {number[]} velocity of the main body
 * @param {number} lengthKm
 */
function rotated(place, moon, velocity, lengthKm) {
  const far = Math.hypot(...moon);
  const x = moon.map((value) => value / far);
  const momentum = cross(moon, velocity);
  const size = Math.hypot(...momentum);
  const z = momentum.map((value) => value / size);
  const scale = lengthKm / far;
  return [x, cross(z, x), z].map((axis) => scale * (axis[0] * place[0] + axis[1] * place[1] + axis[2] * place[2]));
}

/**
 * @param {number[]} a
 * @param {number[]} b
 */
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
