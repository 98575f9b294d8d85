/** Solutions side by side in numbers, the best of each row marked. */

import { byId, el, fill } from "../dom.js";
import { date, epoch, number, outages, shortId, small } from "../format.js";
import { lookOf } from "./sides.js";

/**
 * @typedef {import("./sides.js").Record_} Record_
 * @typedef {import("./sides.js").Side} Side
 * @typedef {{ title: string, unit?: string, value?: (r: Record_) => number, most?: boolean, digits?: number, text?: (r: Record_) => import("../dom.js").Child }} Row
 */

/** @type {Row[]} With `value` the least is the best, or with `most` the most. */
const ROWS = [
  { title: "Δv of the transfer", unit: "km/s", value: (r) => r.delta_v_km_s, digits: 4 },
  { title: "Δv with the spiral", unit: "km/s", value: (r) => r.delta_v_total_km_s, digits: 4 },
  { title: "Propellant", unit: "kg", value: (r) => r.propellant_kg, digits: 1 },
  { title: "Final mass", unit: "kg", value: (r) => r.objective_kg, digits: 1, most: true },
  { title: "Time of flight", unit: "d", value: (r) => r.time_of_flight_days, digits: 2 },
  { title: "Initial coast", unit: "d", text: (r) => number(r.initial_coast_days, 2) },
  { title: "Shooting time", unit: "d", text: (r) => number(r.shooting_days, 2) },
  { title: "Final coast", unit: "d", text: (r) => number(r.final_coast_days, 2) },
  { title: "Outages survived", value: (r) => r.k, digits: 0, most: true },
  { title: "Outages", text: (r) => outages(r.outages) },
  { title: "Verified to", text: (r) => (r.strict ? "strict tolerance" : r.paper ? "paper’s tolerance" : "–") },
  { title: "Largest position defect", unit: "km", text: (r) => small(defect(r)) },
  { title: "Insertion", text: (r) => epoch(r.insertion_epoch) },
  { title: "Arrival", text: (r) => epoch(r.arrival_epoch) },
  { title: "Processor time", unit: "s", value: (r) => r.cpu_seconds, digits: 1 },
  { title: "Search", text: (r) => el("a", { href: `/campaigns/${r.campaign_id}/searches/${encodeURIComponent(r.search)}` }, r.search) },
  { title: "Found", text: (r) => date(r.created_at) },
];

/**
 * @param {Side[]} sides
 * @param {(id: string) => void} onRemove
 */
export function showNumbers(sides, onRemove) {
  const heads = sides.map((side, place) => head(side, place, onRemove));
  const table = el(
    "table",
    { class: "numbers" },
    el("caption", { class: "visually-hidden" }, "Solutions side by side; a star marks the best of a row"),
    el("thead", {}, el("tr", {}, el("td", {}), heads)),
    el("tbody", {}, ROWS.map((row) => line(row, sides))),
  );
  fill(byId("numbers"), table);
}

/**
 * @param {Side} side
 * @param {number} place
 * @param {(id: string) => void} onRemove
 */
function head(side, place, onRemove) {
  const { color, letter } = lookOf(place);
  const remove = el("button", { type: "button", class: "quiet", "aria-label": `Remove ${letter} ${shortId(side.id)}`, onclick: () => onRemove(side.id) }, "Remove");
  return el("th", { scope: "col", "data-side": side.id }, el("i", { class: "swatch", style: `background:${color}` }), `${letter} `, el("a", { href: `/solutions/${side.id}` }, `${side.record.strategy} ${shortId(side.id)}`), " ", remove);
}

/**
 * @param {Row} row
 * @param {Side[]} sides
 */
function line(row, sides) {
  const { value } = row;
  const values = value ? sides.map(({ record }) => value(record)) : [];
  const best = row.most ? Math.max(...values) : Math.min(...values);
  const differs = values.some((one) => one !== values[0]);
  const cells = sides.map(({ record }, i) => {
    if (row.text) return el("td", {}, row.text(record));
    const isBest = differs && values[i] === best;
    const gap = values[i] - best;
    const more = differs && !isBest && el("small", { class: "muted" }, ` ${gap > 0 ? "+" : "−"}${number(Math.abs(gap), row.digits ?? 0)}`);
    return el("td", { class: isBest ? "best" : null }, number(values[i], row.digits ?? 0), isBest && el("span", { class: "star", title: "the best of these" }, " ★"), more);
  });
  return el("tr", {}, el("th", { scope: "row" }, row.title, row.unit && el("small", {}, ` ${row.unit}`)), cells);
}

/**
 * Return the largest position defect that the independent flight found [km].
 * @param {Record_} record
 */
function defect(record) {
  return Math.max(...record.defects_verified.map((/** @type {(number | null)[]} */ [x, y, z]) => Math.hypot(x ?? NaN, y ?? NaN, z ?? NaN)));
}
