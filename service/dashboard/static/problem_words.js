/** What a problem is, in words and numbers. */

import { epoch, number } from "./format.js";

/** @typedef {[string, string]} Fact */

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function spacecraftFacts({ spacecraft }) {
  return [
    ["Wet mass", number(spacecraft.wet_mass_kg, 0, "kg")],
    ["Dry mass", number(spacecraft.dry_mass_kg, 0, "kg")],
    ["Largest thrust", number(spacecraft.max_thrust_n, 3, "N")],
    ["Specific impulse", number(spacecraft.isp_s, 0, "s")],
  ];
}

/**
 * @param {any} definition
 * @param {{ departure_epoch: string, departure_mass_kg: number }} structure
 * @returns {Fact[]}
 */
export function departureFacts({ departure }, structure) {
  const common = /** @type {Fact[]} */ ([
    ["Transfer begins", epoch(structure.departure_epoch)],
    ["Mass then", number(structure.departure_mass_kg, 1, "kg")],
  ]);
  if (departure.kind === "spiral") {
    const end = departure.jacobi === null ? `after ${number(departure.duration_days, 1, "d")}` : `at Jacobi value ${number(departure.jacobi, 3)}`;
    return [
      ["From", "a spiral at full thrust"],
      ["Spiral begins", epoch(departure.epoch)],
      ["Perigee, apogee", `${number(departure.perigee_radius_km, 0)} × ${number(departure.apogee_radius_km, 0, "km")}`],
      ["Inclination", number(departure.inclination_deg, 2, "°")],
      ["Spiral ends", end],
      ...common,
    ];
  }
  const vector = (/** @type {number[]} */ v, /** @type {number} */ digits, /** @type {string} */ unit) => `(${v.map((value) => number(value, digits)).join(", ")}) ${unit}`;
  return [
    ["From", "a state, geocentric J2000"],
    ...common,
    ["Position", vector(departure.position_km, 0, "km")],
    ["Velocity", vector(departure.velocity_km_s, 4, "km/s")],
  ];
}

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function targetFacts({ target }) {
  if (target.kind === "spk") return [["To", "an orbit of a kernel"], ["File", target.path], ["NAIF id", String(target.naif_id)]];
  return [
    ["To", "the near-rectilinear halo orbit (NRHO) of the Moon"],
    ["Period", number(target.period_days, 4, "d")],
    ["Perilune near", epoch(target.perilune_epoch)],
  ];
}

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function boundFacts({ bounds, n_segments: n, segmentation }) {
  const range = (/** @type {number[]} */ [low, high], /** @type {number} */ digits, /** @type {string} */ unit) =>
    `${number(low, digits)} to ${number(high, digits, unit)}`;
  return [
    ["Segments", `${n}, of equal length`],
    ["Segments of realizations", segmentation === "adaptive" ? "those left after the missed one" : `${n} each`],
    ["Shooting time", range(bounds.shooting_days, 3, "d")],
    ["Initial coast", range(bounds.initial_coast_days, 1, "d")],
    ["Final coast", range(bounds.final_coast_days, 1, "d")],
    ["Throttle", range(bounds.throttle, 2, "")],
    ["In-plane angle", "−180 to 180\u00a0°"],
    ["Out-of-plane angle", "−90 to 90\u00a0°"],
    ["Least final mass", number(bounds.min_final_mass_kg, 0, "kg")],
  ];
}
