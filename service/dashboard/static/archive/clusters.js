/** Distinct solutions: each with how often it was found again, and how far apart those are. */

import { byId, el } from "../dom.js";
import { counted, number, shortId } from "../format.js";
import { compareStrategies, lookOf } from "../strategies.js";
import { Table } from "../table.js";

/** @typedef {Record<string, any>} Cluster */

/** @type {import("../table.js").Column<Cluster>[]} */
const COLUMNS = [
  { key: "best", title: "Best", cell: (c) => el("code", {}, shortId(c.best_id)) },
  { key: "delta_v", title: "Δv", unit: "km/s", numeric: true, value: (c) => c.min_delta_v_km_s, cell: (c) => number(c.min_delta_v_km_s, 4) },
  { key: "size", title: "Found", numeric: true, value: (c) => c.size, cell: (c) => `${c.size}×` },
  { key: "strategies", title: "By", cell: (c) => marks(c.strategies) },
  { key: "flight", title: "Flight", unit: "d", numeric: true, value: (c) => c.min_time_of_flight_days, cell: (c) => span(c.min_time_of_flight_days, c.max_time_of_flight_days, 1) },
  { key: "spread", title: "Spread", numeric: true, value: (c) => c.max_distance, cell: (c) => (c.size > 1 ? `${number(c.mean_distance, 3)} · ${number(c.max_distance, 3)}` : "–") },
];

export class Clusters {
  constructor() {
    this.table = new Table(byId("clusters"), "Distinct solutions, the least delta-v first", COLUMNS, {
      id: (cluster) => cluster.best_id,
      href: (cluster) => `/solutions/${cluster.best_id}`,
      sort: "delta_v",
    });
  }

  /** @param {any} page as `GET /solutions/clusters` gives it */
  show(page) {
    this.table.show(page.items);
    const among = page.n_compared < page.n ? `the ${number(page.n_compared, 0)} with the least Δv of ${counted(page.n, "solution")}` : counted(page.n, "solution");
    const listed = page.items.length < page.n_clusters ? `; the best ${page.items.length} are listed` : "";
    byId("clusters-caption").textContent =
      `${counted(page.n_clusters, "distinct reference")} among ${among}${listed}. ` +
      "Spread: mean and greatest distance from the best one, where 0.05 is one segment of fifty throttled by a third more.";
    byId("clusters-card").dataset.clusters = String(page.n_clusters);
  }
}

/** @param {Record<string, number>} strategies */
function marks(strategies) {
  const names = Object.keys(strategies).sort(compareStrategies);
  const words = names.map((name) => `${name} ${strategies[name]}×`).join(", ");
  const dots = names.map((name) => el("i", { class: "dot", style: `--tint:${lookOf(name).color}` }));
  return el("span", { class: "dots", title: words, role: "img", "aria-label": words }, dots);
}

/**
 * @param {number} least
 * @param {number} most
 * @param {number} digits
 */
function span(least, most, digits) {
  const [a, b] = [number(least, digits), number(most, digits)];
  return a === b ? a : `${a}–${b}`;
}

/** @param {() => void} onChange */
export function watchDistance(onChange) {
  byId("distance").addEventListener("change", onChange);
}

export function distance() {
  return Number(/** @type {HTMLSelectElement} */ (byId("distance")).value);
}
