/** The filter of the solutions, kept in the address of the page. */

import { address } from "../api.js";
import { el, fill } from "../dom.js";
import { number } from "../format.js";
import { compareStrategies, LEVELS } from "../looks.js";
import { parameter, setParameters } from "../page.js";

/**
 * @import { Query } from "../api.js"
 * @import { ChoicesView, PointsView } from "../../types"
 */

/**
 * @typedef {Exclude<keyof PointsView, "n" | "front" | "strategies" | "id" | "strategy" | "strict">} AxisKey
 * @typedef {{ key: AxisKey, title: string, unit: string, digits: number }} Axis
 * @typedef {Map<AxisKey, [number, number]>} Ranges
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
 * @returns {Ranges}
 */
export function rangesOf(filter) {
  const all = AXES.filter(({ key }) => filter[`min_${key}`] || filter[`max_${key}`]).map(({ key }) => {
    const [least, most] = [filter[`min_${key}`], filter[`max_${key}`]];
    return /** @type {[AxisKey, [number, number]]} */ ([key, [least ? Number(least) : -Infinity, most ? Number(most) : Infinity]]);
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
 * Return the indices of the points within all ranges.
 * @param {PointsView} points
 * @param {Ranges} ranges
 * @returns {number[]}
 */
export function within(points, ranges) {
  const all = [...ranges];
  return points.id
    .map((_, i) => i)
    .filter((i) => all.every(([key, [least, most]]) => points[key][i] >= least && points[key][i] <= most));
}

/** Names of the filter, the same in the address of the page and in the API. */
const CHOICES = ["campaign", "search", "strategy", "k", "segment", "duration_days", "tolerance"];
const BOUNDS = AXES.flatMap(({ key }) => [`min_${key}`, `max_${key}`]);
const NAMES = [...CHOICES, ...BOUNDS];
/** Parameters that a change of the filter resets. */
const RESET = { after: null, begin: null };
/** Axes whose fields are always visible. */
const MAIN = ["delta_v_km_s", "time_of_flight_days"];

/** @returns {Query} */
export function filterOfAddress() {
  return Object.fromEntries(NAMES.map((name) => [name, parameter(name)]).filter(([, value]) => value));
}

export class Filters {
  /**
   * @param {HTMLElement} form
   * @param {() => void} onChange called when the address names another filter
   */
  constructor(form, onChange) {
    this.form = /** @type {HTMLFormElement} */ (form);
    this.onChange = onChange;
    this.form.addEventListener("submit", (event) => event.preventDefault());
    this.form.addEventListener("change", (event) => this.changed(/** @type {HTMLInputElement} */ (event.target)));
    this.shown = "";
    /** @type {Query} what the fields were filled with */
    this.filter = {};
  }

  /**
   * Show the options and the current choice.
   * @param {ChoicesView} choices
   */
  show(choices) {
    const filter = filterOfAddress();
    const seen = JSON.stringify([choices, filter]);
    const field = /** @type {HTMLInputElement | null} */ (this.form.querySelector("input:focus, select:focus"));
    const focused = field?.name;
    // A field that is being edited is left alone; its change comes back here.
    if (seen === this.shown || (focused && field.value !== String(this.filter[focused] ?? ""))) return;
    this.shown = seen;
    this.filter = filter;
    const isOpen = this.form.querySelector("details")?.open || BOUNDS.slice(2 * MAIN.length).some((name) => filter[name]);
    const others = AXES.filter(({ key }) => !MAIN.includes(key));
    fill(
      this.form,
      el("div", { class: "fields" }, this.selects(choices, filter), MAIN.map((key) => range(key, filter))),
      el("details", { open: isOpen }, el("summary", {}, "More ranges"), el("div", { class: "fields" }, others.map(({ key }) => range(key, filter)))),
      this.buttons(filter),
    );
    if (focused) /** @type {HTMLElement | null} */ (this.form.elements.namedItem(focused))?.focus();
  }

  /**
   * @param {ChoicesView} choices
   * @param {Query} filter
   */
  selects(choices, filter) {
    const plain = (/** @type {(string | number)[]} */ values) => values.map((value) => [String(value), String(value)]);
    const days = choices.durations_days.map((value) => [String(value), number(value, 2, "d")]);
    return [
      select("campaign", "Campaign", choices.campaigns.map((c) => [String(c.id), `${c.id} ${c.name}`]), filter),
      select("strategy", "Strategy", plain(choices.strategies.toSorted(compareStrategies)), filter),
      select("search", "Search", plain(choices.searches), filter),
      select("k", "k, outages survived", plain(choices.k), filter),
      select("segment", "Outage at segment", plain(choices.segments), filter),
      select("duration_days", "Outage lasts", days, filter),
      select("tolerance", "Verified to", Object.entries(LEVELS), filter),
    ];
  }

  /** @param {Query} filter */
  buttons(filter) {
    const clear = el("button", { type: "button", id: "clear", hidden: Object.keys(filter).length === 0, onclick: () => this.clear() }, "Clear all filters");
    const link = (/** @type {string} */ format, /** @type {string} */ words) =>
      el("a", { class: "button", id: `export-${format}`, href: address("/solutions", { ...filter, format }), download: `solutions.${format}` }, words);
    return el("div", { class: "filter-ends" }, clear, el("span", { class: "muted" }, "Download the filtered solutions:"), link("csv", "CSV"), link("ndjson", "NDJSON"));
  }

  clear() {
    setParameters({ ...Object.fromEntries(NAMES.map((name) => [name, null])), ...RESET });
    this.onChange();
  }

  /** @param {HTMLInputElement} field */
  changed(field) {
    if (!NAMES.includes(field.name)) return;
    if (!field.checkValidity()) return field.reportValidity();
    // Another campaign has other searches and outages.
    /** @type {Record<string, null>} */
    const others = field.name === "campaign" ? { search: null, segment: null, duration_days: null } : {};
    setParameters({ ...others, [field.name]: field.value || null, ...RESET });
    this.onChange();
  }

  /**
   * Restrict an axis, as a brush does; null frees it.
   * @param {string} key
   * @param {[number, number] | null} bounds
   */
  restrict(key, bounds) {
    const [least, most] = bounds ?? [null, null];
    setParameters({ [`min_${key}`]: least, [`max_${key}`]: most, ...RESET });
    this.onChange();
  }
}

/**
 * @param {string} name
 * @param {string} title
 * @param {string[][]} options values and words
 * @param {Query} filter
 */
function select(name, title, options, filter) {
  const chosen = filter[name] === undefined ? "" : String(filter[name]);
  // The address may name a value that is not among the options.
  const all = chosen && !options.some(([value]) => value === chosen) ? [...options, [chosen, chosen]] : options;
  const entries = [["", "all"], ...all].map(([value, words]) => el("option", { value, selected: value === chosen }, words));
  return el("label", { class: "filter" }, el("span", {}, title), el("select", { name }, entries));
}

/**
 * @param {string} key
 * @param {Query} filter
 */
function range(key, filter) {
  const { title, unit } = /** @type {Axis} */ (AXES.find((axis) => axis.key === key));
  const field = (/** @type {"min" | "max"} */ end, /** @type {string} */ words) => {
    const name = `${end}_${key}`;
    const how = { type: "number", step: "any", min: 0, name, value: filter[name] ?? "", placeholder: words };
    return el("input", { ...how, "aria-label": `${title} [${unit}], ${words}` });
  };
  return el("div", { class: "filter", role: "group", "aria-label": title }, el("span", {}, title, el("small", {}, ` ${unit}`)), el("span", { class: "range" }, field("min", "min"), "–", field("max", "max")));
}
