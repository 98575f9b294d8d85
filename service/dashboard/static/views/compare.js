/** A comparison: up to four solutions side by side, named by the address. */

import { ApiError, find, get } from "../api.js";
import { lookOf, Overlay, Profiles } from "../compare_figures.js";
import { byId, el, fill } from "../dom.js";
import { FRAMES } from "../flight.js";
import { date, epoch, number, outages, shortId, small } from "../format.js";
import { boundsOf, LEVELS } from "../looks.js";
import { Page, parameter, setParameters, showEmpty, showTitle } from "../page.js";
import { idsOfAddress, MOST } from "../solutions/tables.js";

/**
 * @import { Side } from "../compare_figures.js"
 * @import { Child } from "../dom.js"
 * @import { Frame } from "../flight.js"
 * @import { ProblemView, RecordInFull, WorldView } from "../../types"
 */

/** @typedef {{ title: string, unit?: string, value?: (r: RecordInFull) => number, most?: boolean, digits?: number, text?: (r: RecordInFull, world: WorldView) => Child }} Row */

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
  { title: "Verified to", text: verifiedTo },
  { title: "Largest position defect", unit: "km", text: (r) => small(defect(r)) },
  { title: "Insertion", text: (r) => epoch(r.insertion_epoch) },
  { title: "Arrival", text: (r) => epoch(r.arrival_epoch) },
  { title: "CPU time", unit: "s", value: (r) => r.cpu_seconds, digits: 1 },
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
  const cells = sides.map(({ record, world }, i) => {
    if (row.text) return el("td", {}, row.text(record, world));
    const isBest = differs && values[i] === best;
    const gap = values[i] - best;
    const more = differs && !isBest && el("small", { class: "muted" }, ` ${gap > 0 ? "+" : "−"}${number(Math.abs(gap), row.digits ?? 0)}`);
    return el("td", { class: isBest ? "best" : null }, number(values[i], row.digits ?? 0), isBest && el("span", { class: "star", title: "the best of these" }, " ★"), more);
  });
  return el("tr", {}, el("th", { scope: "row" }, row.title, row.unit && el("small", {}, ` ${row.unit}`)), cells);
}

/**
 * @param {RecordInFull} record
 * @param {WorldView} world
 */
function verifiedTo({ strict, paper }, world) {
  if (!strict && !paper) return "–";
  const [name, bounds] = strict ? [LEVELS.strict, world.strict] : [LEVELS.paper, world.loose];
  return `${name} tolerance: ${boundsOf(bounds)}`;
}

/**
 * Return the largest position defect of the verification [km].
 * @param {RecordInFull} record
 */
function defect(record) {
  return Math.max(...record.defects_verified.map((/** @type {(number | null)[]} */ [x, y, z]) => Math.hypot(x ?? NaN, y ?? NaN, z ?? NaN)));
}

const overlay = new Overlay(byId("overlay"), (frame) => change({ frame }), (isShown) => change({ realizations: isShown || null }));
const profiles = new Profiles(byId("profiles"));
/** What has been read, by id. @type {Map<string, Side>} */
const known = new Map();
/** Drawings in sequence: a second one must not overtake the first. */
let drawing = Promise.resolve();

async function refresh() {
  const ids = idsOfAddress("ids");
  const found = await Promise.all(ids.map(side));
  const sides = found.filter((one) => one !== null);
  showTitle(sides.length ? `Comparison of ${sides.length}` : "Comparison", [["Archive", "/archive"]]);
  fill(byId("actions"), el("a", { class: "button", id: "choose", href: `/archive${sides.length ? `?chosen=${sides.map(({ id }) => id).join(",")}` : ""}` }, "Choose in the archive"));
  if (sides.length === 0) return showEmpty(...none(ids.length > 0));
  showEmpty();
  if (sides.length < ids.length) refuse(`${ids.length - sides.length} of the solutions in the address are not in this archive.`);
  byId("add").hidden = sides.length >= MOST;
  showNumbers(sides, (id) => choose(ids.filter((one) => one !== id)));
  drawing = drawing.then(() => loadFlights(sides)).then(draw);
}

/** @param {boolean} areUnknown */
function none(areUnknown) {
  return [
    el("h2", {}, areUnknown ? "No such solutions" : "Nothing to compare yet"),
    el("p", {}, "Choose two to four solutions by the boxes in the table of the archive."),
    el("p", {}, el("a", { class: "button primary", href: "/archive" }, "Go to the archive")),
  ];
}

/**
 * @param {string} id
 * @returns {Promise<Side | null>}
 */
async function side(id) {
  const mine = known.get(id);
  if (mine) return mine;
  /** @type {RecordInFull | null} */
  const record = await find(`/solutions/${id}`);
  if (!record) return null;
  /** @type {ProblemView} */
  const { world } = await get(`/problems/${record.problem_hash}`);
  const read = { id, record, world, flight: null };
  known.set(id, read);
  return read;
}

/** @param {Side[]} sides */
async function loadFlights(sides) {
  const missing = sides.filter(({ flight }) => flight === null);
  overlay.waiting.hidden = missing.length === 0;
  const failed = [];
  for (const one of missing) {
    try {
      one.flight = await get(`/solutions/${one.id}/trajectory`);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      failed.push(error.message);
    }
  }
  if (failed.length) refuse(`Not drawn: ${failed.join("; ")}`);
}

async function draw() {
  const sides = idsOfAddress("ids").flatMap((id) => known.get(id) ?? []);
  const flown = sides.filter(({ flight }) => flight !== null);
  overlay.waiting.hidden = true;
  if (flown.length === 0) return;
  const given = parameter("frame");
  const frame = /** @type {Frame} */ (FRAMES.some(({ id }) => id === given) ? given : "rotating");
  const hasRealizations = parameter("realizations") === "true";
  await overlay.show(sides, frame, hasRealizations);
  await profiles.show(sides, hasRealizations);
}

/** @param {Record<string, string | boolean | null>} values */
function change(values) {
  setParameters(values);
  drawing = drawing.then(draw);
}

/** @param {string[]} ids */
function choose(ids) {
  byId("refused").hidden = true;
  setParameters({ ids: ids.join(",") || null });
  return page.reload();
}

/** @param {string} words */
function refuse(words) {
  byId("refused").hidden = false;
  fill(byId("refused"), words);
}

byId("add").addEventListener("submit", async (event) => {
  event.preventDefault();
  const field = /** @type {HTMLInputElement} */ (byId("another"));
  const id = /[0-9a-f]{32}/.exec(field.value)?.[0];
  const ids = idsOfAddress("ids");
  if (!id) return refuse("Solution: expected its id of 32 digits or the address of its page.");
  if (ids.includes(id)) return refuse("This solution is already in the comparison.");
  if (!(await side(id))) return refuse(`No solution of this archive has the id ${id}.`);
  field.value = "";
  await choose([...ids, id]);
});

const page = new Page({ events: null, refresh, redraw: () => page.reload() });
window.addEventListener("popstate", () => page.reload());
page.start();
