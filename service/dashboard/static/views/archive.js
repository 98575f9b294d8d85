/** The archive: solutions of all campaigns, filtered by the address, as figures and as a table. */

import { get } from "../api.js";
import { byId, el, fill } from "../dom.js";
import { counted, number } from "../format.js";
import { Page, showEmpty, showFacts } from "../page.js";
import { Parallel, Scatter } from "../solutions/figures.js";
import { filterOfAddress, Filters, rangesOf, withoutRanges } from "../solutions/filters.js";
import { Choice, Clusters, distance, Listing, watchDistance } from "../solutions/tables.js";

/**
 * @import { Query } from "../api.js"
 * @import { AxisKey, Ranges } from "../solutions/filters.js"
 * @import { ChoicesView, ClusterPage, EventView, PointsView } from "../../types"
 */

/** @typedef {{ all: PointsView, chosen: PointsView, ranges: Ranges }} Seen  points of the filter without and with its ranges */

/** Of more solutions a sample is drawn: marks that can be distinguished, within a second. */
const MOST_DRAWN = 1500;
/** Samples and clusters cost the service more than a page of the table, so they are refreshed less often [ms]. */
const SLOW_MS = 10_000;

const filters = new Filters(byId("filters"), () => page.reload());
const choice = new Choice(() => {
  choice.show();
  listing.table.draw();
});
const listing = new Listing(choice, () => page.reload());
const scatter = new Scatter(byId("scatter"));
const parallel = new Parallel(byId("parallel"), (key, bounds) => filters.restrict(key, bounds));
const clusters = new Clusters();
let latestRequest = 0;
let drawnAt = -Infinity;
/** @type {Seen | undefined} */
let seen;
/** @type {number | undefined} */
let pending;

/**
 * @param {EventView[]} events
 * @param {boolean} isAll
 */
async function refresh(events, isAll) {
  if (!isAll && !events.some(({ kind }) => kind === "solution" || kind === "campaign")) return;
  const request = ++latestRequest;
  const filter = filterOfAddress();
  const isDue = isAll || performance.now() - drawnAt > SLOW_MS || (seen && seen.all.n === seen.all.id.length);
  // Requested together with the list, and shown after it.
  const points = isDue ? readPoints(filter) : null;
  points?.catch(() => {});
  /** @type {[ChoicesView, () => void]} */
  const [choices, list] = await Promise.all([get("/solutions/choices", { campaign: filter.campaign }), listing.load(filter)]);
  // Another filter was chosen meanwhile.
  if (request !== latestRequest) return;
  filters.show(choices);
  choice.show();
  list();
  if (points) await refreshPictures(filter, request, points);
  else refreshLater();
}

/** Refresh the figures later, when they are due. */
function refreshLater() {
  window.clearTimeout(pending);
  pending = window.setTimeout(() => page.reload(), SLOW_MS);
}

/**
 * @param {Query} filter
 * @param {number} request
 * @param {Promise<[PointsView, PointsView]>} points
 */
async function refreshPictures(filter, request, points) {
  drawnAt = performance.now();
  const [all, chosen] = await points;
  if (request !== latestRequest) return;
  seen = { all, chosen, ranges: rangesOf(filter) };
  show(filter, chosen);
  // Clusters take as long as all the rest; the figures do not wait for them.
  /** @type {[ClusterPage, void]} */
  const [found] = await Promise.all([get("/solutions/clusters", { ...filter, threshold: distance() }), draw()]);
  if (request === latestRequest) clusters.show(found);
}

/**
 * Read the points of a filter without and with its ranges: parallel coordinates show both.
 * @param {Query} filter
 * @returns {Promise<[PointsView, PointsView]>}
 */
function readPoints(filter) {
  const read = (/** @type {Query} */ some) => get("/solutions/points", { ...some, most: MOST_DRAWN });
  /** @type {Promise<PointsView>} */
  const all = read(withoutRanges(filter));
  return Promise.all([all, rangesOf(filter).size ? read(filter) : all]);
}

/**
 * @param {Query} filter
 * @param {PointsView} chosen
 */
function show(filter, chosen) {
  const { n } = chosen;
  const isFiltered = Object.keys(filter).length > 0;
  byId("shown").hidden = n === 0;
  byId("nothing").hidden = n > 0 || !isFiltered;
  if (n === 0 && !isFiltered) return showEmpty(...none());
  showEmpty();
  fill(
    byId("nothing"),
    el("h2", {}, "No solution matches the filter"),
    el("p", {}, "Widen a range, choose another strategy, or clear the filters."),
    el("button", { type: "button", class: "primary", onclick: () => filters.clear() }, "Clear all filters"),
  );
  byId("count").textContent = counted(n, "solution");
  showFacts(n ? facts(chosen) : []);
}

/**
 * @param {PointsView} chosen
 * @returns {[string, string][]}
 */
function facts(chosen) {
  const least = (/** @type {AxisKey} */ key) => chosen[key].reduce((a, b) => Math.min(a, b), Infinity);
  return [
    ["Solutions", number(chosen.n, 0)],
    ["Strategies", String(chosen.strategies.length)],
    ["Lowest Δv", number(least("delta_v_km_s"), 4, "km/s")],
    ["Lowest propellant", number(least("propellant_kg"), 1, "kg")],
    ["Shortest flight", number(least("time_of_flight_days"), 1, "d")],
  ];
}

function none() {
  return [
    el("h2", {}, "No solution yet"),
    el("p", {}, "Every verified solution of every campaign is kept here. The first usually comes within minutes of a campaign’s start; it appears by itself."),
    el("p", {}, el("a", { href: "/" }, "Look at the campaigns"), " or start one:"),
    el("pre", {}, "coastarc run examples/quick.toml"),
  ];
}

async function draw() {
  if (!seen || seen.chosen.n === 0) return;
  const { all, chosen, ranges } = seen;
  parallel.show(all, ranges, sample(all));
  await scatter.show(chosen, sample(chosen));
}

/** @param {PointsView} points */
function sample(points) {
  const shown = points.id.length;
  return shown < points.n ? `${number(shown, 0)} of ${number(points.n, 0)} solutions: all extremes, the whole Pareto front, and a random sample of the others.` : "";
}

watchDistance(() => page.reload());
const page = new Page({ events: "/events/stream", refresh, redraw: () => { listing.table.draw(); draw(); } });
window.addEventListener("popstate", () => page.reload());
page.start();
