// @ts-check
/** The table of solutions: sorted by any column, chosen by pointer or keyboard. */

import { byId, el, fill } from "./dom.js";
import { number, outages, small } from "./format.js";

/**
 * @typedef {import("./api.js").Record_} Record_
 * @typedef {{ key: string, title: string, unit?: string, numeric?: boolean, minor?: boolean,
 *   value: (record: Record_) => number | string, text: (record: Record_) => string }} Column
 */

/** @type {Column[]} */
const COLUMNS = [
  { key: "strategy", title: "Strategy", value: (r) => `${r.k} ${r.strategy}`, text: (r) => r.strategy },
  { key: "delta_v", title: "Δv", unit: "km/s", numeric: true, value: (r) => r.delta_v_km_s, text: (r) => number(r.delta_v_km_s, 4) },
  { key: "propellant", title: "Propellant", unit: "kg", numeric: true, value: (r) => r.propellant_kg, text: (r) => number(r.propellant_kg, 1) },
  { key: "flight", title: "Flight", unit: "d", numeric: true, value: (r) => r.time_of_flight_days, text: (r) => number(r.time_of_flight_days, 1) },
  { key: "outages", title: "Outages", minor: true, value: (r) => outages(r.outages), text: (r) => outageText(r) },
  { key: "defect", title: "Defect", unit: "km", numeric: true, minor: true, value: worst, text: (r) => small(worst(r)) },
  { key: "cpu", title: "CPU", unit: "s", numeric: true, minor: true, value: (r) => r.cpu_seconds, text: (r) => number(r.cpu_seconds, 1) },
];

/** @param {Record_} record */
function outageText(record) {
  return record.outages.map((o) => `${o.segment} · ${number(o.duration_days, 1, "d")}`).join(", ") || "none";
}

/**
 * Return the largest position defect that the independent flight found [km].
 * @param {Record_} record
 */
function worst(record) {
  return Math.max(...record.defects_verified.map(([x, y, z]) => Math.hypot(x ?? NaN, y ?? NaN, z ?? NaN)));
}

export class SolutionTable {
  /** @param {(id: string) => void} onChoose */
  constructor(onChoose) {
    this.onChoose = onChoose;
    this.sort = { key: "delta_v", descending: false };
    /** @type {Record_[]} */
    this.records = [];
    this.total = 0;
    /** @type {string | null} */
    this.chosen = null;
    byId("strict-only").addEventListener("change", () => this.draw());
    byId("search-filter").addEventListener("change", () => this.draw());
    byId("solutions").addEventListener("keydown", (event) => this.move(/** @type {KeyboardEvent} */ (event)));
  }

  /**
   * @param {Record_[]} records
   * @param {import("./api.js").Campaign} campaign
   */
  show(records, campaign) {
    this.records = records;
    this.campaign = campaign;
    this.total = campaign.n_solutions;
    this.offerSearches(campaign.searches.map((search) => [search.name, `${search.strategy} ${search.name}`]));
    this.draw();
  }

  /** @param {string | null} id */
  choose(id) {
    if (id === this.chosen) return;
    this.chosen = id;
    this.draw();
  }

  /** @param {[string, string][]} names */
  offerSearches(names) {
    const select = /** @type {HTMLSelectElement} */ (byId("search-filter"));
    if (select.options.length === names.length + 1) return;
    fill(select, el("option", { value: "" }, "all searches"), names.map(([value, text]) => el("option", { value }, text)));
  }

  visible() {
    const strictOnly = /** @type {HTMLInputElement} */ (byId("strict-only")).checked;
    const search = /** @type {HTMLSelectElement} */ (byId("search-filter")).value;
    const column = COLUMNS.find(({ key }) => key === this.sort.key) ?? COLUMNS[1];
    const sign = this.sort.descending ? -1 : 1;
    return this.records
      .filter((record) => (record.strict || !strictOnly) && (!search || record.search === search))
      .sort((a, b) => sign * compare(column.value(a), column.value(b)) || compare(a.id, b.id));
  }

  draw() {
    const rows = this.visible();
    const focused = document.activeElement?.closest("tr[data-id]")?.getAttribute("data-id");
    byId("solutions-count").textContent = this.counted(rows.length);
    fill(byId("solutions"), rows.length ? this.table(rows) : this.nothing());
    if (focused) this.row(focused)?.focus();
  }

  /** @param {number} shown */
  counted(shown) {
    if (this.total > this.records.length) return `${shown} of the best ${this.records.length}; ${this.total} in all`;
    return shown === this.total ? `${shown}` : `${shown} of ${this.total}`;
  }

  /** @param {Record_[]} rows */
  table(rows) {
    const tabStop = rows.some(({ id }) => id === this.chosen) ? this.chosen : rows[0].id;
    return el(
      "table",
      {},
      el("caption", { class: "visually-hidden" }, "Solutions; arrow keys move, Enter chooses"),
      el("thead", {}, el("tr", {}, COLUMNS.map((column) => this.head(column)))),
      el("tbody", {}, rows.map((record) => this.line(record, tabStop))),
    );
  }

  /** @param {Column} column */
  head(column) {
    const sorted = column.key === this.sort.key;
    const direction = this.sort.descending ? "descending" : "ascending";
    const press = () => {
      this.sort = { key: column.key, descending: sorted ? !this.sort.descending : false };
      this.draw();
    };
    return el(
      "th",
      { scope: "col", class: classes(column), "aria-sort": sorted ? direction : "none" },
      el("button", { type: "button", onclick: press }, column.title, column.unit && el("small", {}, ` ${column.unit}`)),
    );
  }

  /**
   * @param {Record_} record
   * @param {string | null} tabStop
   */
  line(record, tabStop) {
    const chosen = record.id === this.chosen;
    return el(
      "tr",
      {
        "data-id": record.id,
        "data-strict": record.strict,
        tabindex: record.id === tabStop ? 0 : -1,
        "aria-selected": chosen,
        onclick: () => this.onChoose(record.id),
      },
      COLUMNS.map((column) => el("td", { class: classes(column) }, column.text(record), badge(column, record))),
    );
  }

  nothing() {
    if (this.records.length > 0) {
      return el("p", { class: "empty" }, "No solution matches: untick “strict only”, or choose all searches.");
    }
    const running = this.campaign?.state === "active";
    const guesses = number(this.campaign?.n_solves ?? 0, 0);
    return el(
      "p",
      { class: "empty" },
      running
        ? `No solution yet after ${guesses} guesses. The first usually takes a minute or two; it appears here by itself.`
        : `${guesses} guesses led to no solution. Give the search more guesses, or start from an easier problem.`,
    );
  }

  /** @param {KeyboardEvent} event */
  move(event) {
    const row = /** @type {HTMLElement} */ (event.target).closest("tr[data-id]");
    if (!row) return;
    const id = row.getAttribute("data-id") ?? "";
    if (event.key === "Enter" || event.key === " ") this.onChoose(id);
    else if (event.key === "ArrowDown") this.step(row.nextElementSibling);
    else if (event.key === "ArrowUp") this.step(row.previousElementSibling);
    else return;
    event.preventDefault();
  }

  /** @param {Element | null} row */
  step(row) {
    const id = row?.getAttribute("data-id");
    if (!id) return;
    this.onChoose(id);
    this.row(id)?.focus();
  }

  /** @param {string} id */
  row(id) {
    return /** @type {HTMLElement | null} */ (byId("solutions").querySelector(`tr[data-id="${CSS.escape(id)}"]`));
  }
}

/**
 * @param {number | string} a
 * @param {number | string} b
 */
function compare(a, b) {
  return a < b ? -1 : a > b ? 1 : 0;
}

/** @param {Column} column */
function classes(column) {
  return [column.numeric ? "number" : "", column.minor ? "minor" : ""].filter(Boolean).join(" ") || null;
}

/**
 * @param {Column} column
 * @param {Record_} record
 */
function badge(column, record) {
  if (column.key !== "strategy" || record.strict) return null;
  return el("small", { class: "tag" }, record.paper ? "paper only" : "not verified");
}
