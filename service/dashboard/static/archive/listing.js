/** The table of solutions: sorted and cut into pages by the service. */

import { get } from "../api.js";
import { byId, el } from "../dom.js";
import { date, number, shortId } from "../format.js";
import { parameter, setParameters } from "../page.js";
import { lookOf } from "../strategies.js";
import { Table } from "../table.js";

/**
 * @typedef {Record<string, any>} Record_
 * @typedef {import("../table.js").Column<Record_>} Column
 */

/** What is sorted by where the address says nothing. */
const SORT = "delta_v_km_s";
/** Rows of a page. */
const PAGE = 25;
/** Sorted by this, the greatest come first. */
const NEWEST = "created_at";

export class Listing {
  /**
   * @param {import("./choice.js").Choice} choice
   * @param {() => void} onChange called when the address names another page
   */
  constructor(choice, onChange) {
    this.choice = choice;
    this.onChange = onChange;
    /** Marks of the pages before this one. @type {(string | null)[]} */
    this.before = [];
    const how = { id: (/** @type {Record_} */ r) => r.id, href: (/** @type {Record_} */ r) => `/solutions/${r.id}`, onSort: (/** @type {string} */ key, /** @type {boolean} */ isDown) => this.sortBy(key, isDown) };
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

  /** @param {import("../api.js").Query} filter */
  async load(filter) {
    const [after, begin] = [parameter("after"), parameter("begin")];
    const page = await get("/solutions", { ...filter, ...this.order, after, begin, limit: PAGE });
    return () => this.show(page);
  }

  /** @param {{ items: Record_[], next: string | null }} page */
  show(page) {
    const { sort, descending } = this.order;
    this.table.sort = { key: sort, descending };
    this.following = page.next;
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
    // A first press on the time shows the newest, as one on a number shows the least.
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
 * @param {import("./choice.js").Choice} choice
 * @returns {Column[]}
 */
function columns(choice) {
  const value = () => null;
  return [
    { key: "id", title: "Solution", cell: (r) => el("span", { class: "named" }, el("span", {}, el("i", { class: "dot", style: `--tint:${lookOf(r.strategy).color}` }), r.strategy), el("code", {}, shortId(r.id)), tag(r)) },
    { key: "delta_v_km_s", title: "Δv", unit: "km/s", numeric: true, value, cell: (r) => number(r.delta_v_km_s, 4) },
    { key: "time_of_flight_days", title: "Flight", unit: "d", numeric: true, value, cell: (r) => number(r.time_of_flight_days, 1) },
    { key: "propellant_kg", title: "Propellant", unit: "kg", numeric: true, minor: true, value, cell: (r) => number(r.propellant_kg, 1) },
    { key: "moon_altitude_km", title: "Lowest over Moon", unit: "km", numeric: true, minor: true, cell: (r) => (r.moon_altitude_km === null ? "–" : number(r.moon_altitude_km, 0)) },
    { key: "k", title: "k", numeric: true, minor: true, value, cell: (r) => String(r.k) },
    { key: "outages", title: "Outages", unit: "segment · d", minor: true, cell: (r) => outages(r) },
    { key: "search", title: "Search", minor: true, cell: (r) => el("a", { href: `/campaigns/${r.campaign_id}/searches/${encodeURIComponent(r.search)}` }, r.search) },
    { key: "cpu_seconds", title: "CPU", unit: "s", numeric: true, minor: true, value, cell: (r) => number(r.cpu_seconds, 1) },
    { key: "created_at", title: "Found", minor: true, value, cell: (r) => date(r.created_at) },
    { key: "compare", title: "Compare", cell: (r) => choice.box(r.id) },
  ];
}

/** @param {Record_} record */
function outages(record) {
  const all = record.outages.map((/** @type {any} */ o) => `${o.segment} · ${number(o.duration_days, 1)}`);
  return all.join(", ") || "none";
}

/** @param {Record_} record */
function tag(record) {
  if (record.strict) return null;
  const level = record.paper ? "paper only" : "not verified";
  return el("small", { class: "tag" }, record.is_marginal ? `${level}, marginal` : level);
}
