/** The numbers of a solution that filters restrict and axes show. */

/**
 * @typedef {{ key: string, title: string, unit: string, digits: number }} Axis
 * @typedef {import("../api.js").Query} Query
 * @typedef {Record<string, any>} Points as `GET /solutions/points` gives them
 */

/** @type {Axis[]} */
export const AXES = [
  { key: "delta_v_km_s", title: "Δv", unit: "km/s", digits: 3 },
  { key: "time_of_flight_days", title: "Time of flight", unit: "d", digits: 1 },
  { key: "initial_coast_days", title: "Initial coast", unit: "d", digits: 1 },
  { key: "shooting_days", title: "Shooting time", unit: "d", digits: 1 },
  { key: "final_coast_days", title: "Final coast", unit: "d", digits: 1 },
  { key: "propellant_kg", title: "Propellant", unit: "kg", digits: 1 },
  { key: "k", title: "k", unit: "outages", digits: 0 },
  { key: "cpu_seconds", title: "CPU", unit: "s", digits: 1 },
];

/**
 * Return the bounds of a filter, by axis; what is not bounded is infinite.
 * @param {Query} filter
 * @returns {Map<string, [number, number]>}
 */
export function rangesOf(filter) {
  const all = AXES.filter(({ key }) => filter[`min_${key}`] || filter[`max_${key}`]).map(({ key }) => {
    const [least, most] = [filter[`min_${key}`], filter[`max_${key}`]];
    return /** @type {[string, [number, number]]} */ ([key, [least ? Number(least) : -Infinity, most ? Number(most) : Infinity]]);
  });
  return new Map(all);
}

/**
 * Return a filter without its bounds.
 * @param {Query} filter
 */
export function withoutRanges(filter) {
  return Object.fromEntries(Object.entries(filter).filter(([name]) => !/^(min|max)_/.test(name)));
}

/**
 * Return the places of the points within all ranges.
 * @param {Points} points
 * @param {Map<string, [number, number]>} ranges
 * @returns {number[]}
 */
export function within(points, ranges) {
  const all = [...ranges];
  return points.id
    .map((/** @type {string} */ _, /** @type {number} */ i) => i)
    .filter((/** @type {number} */ i) => all.every(([key, [least, most]]) => points[key][i] >= least && points[key][i] <= most));
}
