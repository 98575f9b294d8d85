/** Tables of solutions: all of them page by page, the distinct ones, and those chosen for comparison. */

import { get } from "../api.js";
import { byId, el, fill } from "../dom.js";
import { counted, date, number, shortId } from "../format.js";
import { compareStrategies, lookOf } from "../looks.js";
import { parameter, setParameters } from "../page.js";
import { Table } from "../table.js";

/**
 * @import { Query } from "../api.js"
 * @import { Column } from "../table.js"
 * @import { ClusterPage, ClusterView, RecordPage, SolutionRecord } from "../../types"
 */

export const MOST = 4;
const ID = /^[0-9a-f]{32}$/;

/**
 * Return the ids in a parameter of the address, each once.
 * @param {string} name
 */
export function idsOfAddress(name) {
  const given = (parameter(name) ?? "").split(",").filter((id) => ID.test(id));
  return [...new Set(given)].slice(0, MOST);
}

/**
 * Return the address of a comparison.
 * @param {string[]} ids
 */
function comparison(ids) {
  return `/compare?ids=${ids.join(",")}`;
}

export class Choice {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
  }

  get ids() {
    return idsOfAddress("chosen");
  }

  /**
   * @param {string} id
   * @param {boolean} isChosen
   */
  set(id, isChosen) {
    const others = this.ids.filter((one) => one !== id);
    const ids = isChosen ? [...others, id].slice(0, MOST) : others;
    setParameters({ chosen: ids.join(",") || null });
    this.onChange();
  }

  /** @param {string} id */
  box(id) {
    const { ids } = this;
    const isFull = ids.length >= MOST && !ids.includes(id);
    const input = el("input", {
      type: "checkbox",
      checked: ids.includes(id),
      disabled: isFull,
      "aria-label": `Compare ${shortId(id)}`,
      title: isFull ? "At most four can be compared" : "Compare",
      onchange: (/** @type {Event} */ event) => this.set(id, /** @type {HTMLInputElement} */ (event.target).checked),
    });
    return el("label", { class: "box" }, input);
  }

  /** Show the chosen solutions at the bottom of the window. */
  show() {
    const { ids } = this;
    byId("choice").hidden = ids.length === 0;
    const chips = ids.map((id) =>
      el("span", { class: "chip" }, el("a", { href: `/solutions/${id}` }, shortId(id)), el("button", { type: "button", class: "quiet", "aria-label": `Do not compare ${shortId(id)}`, onclick: () => this.set(id, false) }, "×")),
    );
    const words = ids.length === 1 ? "1 of 4 chosen; choose another" : `${ids.length} of 4 chosen`;
    const go = ids.length > 1 && el("a", { class: "button primary", id: "compare", href: comparison(ids) }, `Compare ${ids.length} solutions`);
    fill(byId("choice"), el("span", { class: "muted" }, words), ...chips, go);
  }
}

/** The default order. */
const SORT = "delta_v_km_s";
/** Rows of a page. */
const PAGE = 25;
/** The column that is sorted in descending order by default. */
const NEWEST = "created_at";

export class Listing {
  /**
   * @param {Choice} choice
   * @param {() => void} onChange called when the address names another page
   */
  constructor(choice, onChange) {
    this.choice = choice;
    this.onChange = onChange;
    /** Marks of the pages before this one. @type {(string | null)[]} */
    this.before = [];
    const how = { id: (/** @type {SolutionRecord} */ r) => r.id, href: (/** @type {SolutionRecord} */ r) => `/solutions/${r.id}`, onSort: (/** @type {string} */ key, /** @type {boolean} */ isDown) => this.sortBy(key, isDown) };
    this.table = new Table(byId("solutions"), "Solutions; a box chooses one for comparison", columns(choice), how);
    byId("first").addEventListener("click", () => this.go(null, []));
    byId("next").addEventListener("click", () => this.go(this.following, [...this.before, parameter("after")]));
    byId("previous").addEventListener("click", () => this.go(this.before.at(-1) ?? null, this.before.slice(0, -1)));
    byId("jump").addEventListener("submit", (event) => this.jump(event));
  }

  get order() {
    const sort = parameter("sort") ?? SORT;
    const given = parameter("descending");
    return { sort, descending: given === null ? sort === NEWEST : given === "true" };
  }

  /** @param {Query} filter */
  async load(filter) {
    const [after, begin] = [parameter("after"), parameter("begin")];
    /** @type {RecordPage} */
    const page = await get("/solutions", { ...filter, ...this.order, after, begin, limit: PAGE });
    return () => this.show(page);
  }

  /** @param {RecordPage} page */
  show(page) {
    const { sort, descending } = this.order;
    this.table.sort = { key: sort, descending };
    this.following = page.next;
    // Far from the Moon there is nothing to tell of it.
    const isNear = page.items.some((record) => record.moon_altitude_km !== null);
    this.table.columns = columns(this.choice).filter(({ key }) => isNear || key !== "moon_altitude_km");
    this.table.show(page.items);
    const isFirst = !parameter("after") && !parameter("begin");
    byId("first").toggleAttribute("disabled", isFirst);
    byId("previous").toggleAttribute("disabled", this.before.length === 0);
    byId("next").toggleAttribute("disabled", page.next === null);
    const column = this.table.columns.find(({ key }) => key === sort);
    byId("jump").hidden = sort === NEWEST;
    byId("begin-what").textContent = column ? `${column.title}${column.unit ? `, ${column.unit}` : ""}` : sort;
    const field = /** @type {HTMLInputElement} */ (byId("begin"));
    if (document.activeElement !== field) field.value = parameter("begin") ?? "";
    byId("table-card").dataset.page = isFirst ? "first" : "further";
  }

  /**
   * @param {string} key
   * @param {boolean} isDown
   */
  sortBy(key, isDown) {
    // The first click on the time sorts the newest first, as one on a number sorts the lowest first.
    const descending = key === NEWEST && this.order.sort !== NEWEST ? true : isDown;
    setParameters({ sort: key, descending, after: null, begin: null });
    this.before = [];
    this.onChange();
  }

  /**
   * @param {string | null | undefined} after
   * @param {(string | null)[]} before
   */
  go(after, before) {
    const begin = after === null && before.length === 0 ? null : parameter("begin");
    setParameters({ after: after ?? null, begin });
    this.before = before;
    this.onChange();
  }

  /** @param {Event} event */
  jump(event) {
    event.preventDefault();
    setParameters({ begin: /** @type {HTMLInputElement} */ (byId("begin")).value || null, after: null });
    this.before = [];
    this.onChange();
  }
}

/**
 * @param {Choice} choice
 * @returns {Column<SolutionRecord>[]}
 */
function columns(choice) {
  const value = () => null;
  return [
    { key: "id", title: "Solution", cell: (r) => el("span", { class: "named" }, el("span", {}, el("i", { class: "dot", style: `--tint:${lookOf(r.strategy).color}` }), r.strategy), el("code", {}, shortId(r.id)), tag(r)) },
    { key: "delta_v_km_s", title: "Δv", unit: "km/s", numeric: true, value, cell: (r) => number(r.delta_v_km_s, 4) },
    { key: "time_of_flight_days", title: "Flight", unit: "d", numeric: true, value, cell: (r) => number(r.time_of_flight_days, 1) },
    { key: "propellant_kg", title: "Propellant", unit: "kg", numeric: true, minor: true, value, cell: (r) => number(r.propellant_kg, 1) },
    { key: "moon_altitude_km", title: "Lowest above Moon", unit: "km", numeric: true, minor: true, cell: (r) => (r.moon_altitude_km === null ? "–" : number(r.moon_altitude_km, 0)) },
    { key: "k", title: "k", numeric: true, minor: true, value, cell: (r) => String(r.k) },
    { key: "outages", title: "Outages", unit: "segment · d", minor: true, cell: (r) => outages(r) },
    { key: "search", title: "Search", minor: true, cell: (r) => el("a", { href: `/campaigns/${r.campaign_id}/searches/${encodeURIComponent(r.search)}` }, r.search) },
    { key: "cpu_seconds", title: "CPU", unit: "s", numeric: true, minor: true, value, cell: (r) => number(r.cpu_seconds, 1) },
    { key: "created_at", title: "Found", minor: true, value, cell: (r) => date(r.created_at) },
    { key: "compare", title: "Compare", cell: (r) => choice.box(r.id) },
  ];
}

/** @param {SolutionRecord} record */
function outages(record) {
  const all = record.outages.map((o) => `${o.segment} · ${number(o.duration_days, 1)}`);
  return all.join(", ") || "none";
}

/** @param {SolutionRecord} record */
function tag(record) {
  if (record.strict) return null;
  const level = record.paper ? "loose only" : "not verified";
  return el("small", { class: "tag" }, record.is_marginal ? `${level}, marginal` : level);
}

/** @type {Column<ClusterView>[]} */
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

  /** @param {ClusterPage} page */
  show(page) {
    this.table.show(page.items);
    const among = page.n_compared < page.n ? `the ${number(page.n_compared, 0)} with the least Δv of ${counted(page.n, "solution")}` : counted(page.n, "solution");
    const listed = page.items.length < page.n_clusters ? `; the best ${page.items.length} are listed` : "";
    byId("clusters-caption").textContent =
      `${counted(page.n_clusters, "distinct reference")} among ${among}${listed}. ` +
      "Spread: mean and greatest distance from the best one; 0.05 corresponds to one of fifty segments with a third more throttle.";
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
