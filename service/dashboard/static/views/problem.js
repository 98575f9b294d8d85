/** One problem: what is solved, under which outages, how it looks to the solver, and what was found. */

import { find, get } from "../api.js";
import { ChanceFigures } from "../chances.js";
import { byId, el, fill } from "../dom.js";
import { counted, number, outages, shortId } from "../format.js";
import { OutageFigure } from "../outage_line.js";
import { Page, facts, pathPart, showEmpty, showFacts, showTitle } from "../page.js";
import { boundFacts, departureFacts, spacecraftFacts, targetFacts } from "../problem_words.js";
import { SparsityFigure } from "../sparsity.js";
import { Table } from "../table.js";

const hash = pathPart(1);
const timeline = new OutageFigure(byId("outages"));
const sparsity = new SparsityFigure(byId("sparsity"));
const chances = new ChanceFigures(byId("counts"), byId("durations"));
const best = new Table(byId("best"), "Best solutions of this problem", bestColumns(), {
  id: (row) => row.id,
  href: (row) => `/solutions/${row.id}`,
});
const fewer = relatives(byId("fewer"), "Problems with one outage less", "Without");
const more = relatives(byId("more"), "Problems with one outage more", "With");
/** @type {any} */
let problem;
/** @type {any} */
let structure;
/** @type {any} */
let family;

/**
 * @param {import("../live.js").Event_[]} events
 * @param {boolean} isAll
 */
async function refresh(events, isAll) {
  if (!problem) {
    problem = await find(`/problems/${hash}`);
    if (!problem) return showEmpty(...unknown());
    showProblem();
    // Its counts take a moment the first time; the words do not wait for them.
    structure = await get(`/problems/${hash}/structure`);
    showStructure();
  } else if (!isAll && !events.some(({ kind }) => kind === "solution")) return;
  const known = family?.best[0]?.id;
  family = await get(`/problems/${hash}/family`);
  showFamily();
  performance.mark("problem-shown");
  if (!known || known !== family.best[0]?.id) drawing = drawing.then(draw);
}

let drawing = Promise.resolve();

async function draw() {
  const first = family.best[0];
  const arc = first ? first.initial_coast_days + first.shooting_days : null;
  await chances.show(structure, arc, problem.outages.map((/** @type {any} */ outage) => outage.duration_days));
}

function unknown() {
  return [
    el("h2", {}, "No such problem"),
    el("p", {}, "No campaign of this archive is about a problem ", el("code", {}, hash), ". A problem comes with the first ", el("a", { href: "/campaigns/new" }, "campaign"), " about it."),
  ];
}

function showProblem() {
  const { definition } = problem;
  const words = problem.k === 0 ? "Reference problem" : `Problem with ${counted(problem.k, "outage")}`;
  showTitle(words, [["Archive", "/archive"]]);
  fill(byId("hash"), el("code", { title: hash }, shortId(hash)));
  showSizes();
  fill(byId("goal"), goal());
  fill(byId("spacecraft"), facts(spacecraftFacts(definition)));
  fill(byId("target"), facts(targetFacts(definition)));
  fill(byId("bounds"), facts(boundFacts(definition)));
}

function showSizes() {
  /** @type {[string, string][]} */
  const own = [["Outages k", String(problem.k)], ["Segments N", number(problem.n_segments, 0)]];
  if (problem.k > 0 && problem.k < 3) own.push(["Outages", outages(problem.outages)]);
  if (structure) {
    own.push(["Variables", number(structure.n_variables, 0)], ["Defects", number(structure.n_defects, 0)]);
    own.push(["Non-zeros of the Jacobian", number(structure.n_nonzeros, 0)]);
  }
  showFacts(own);
}

function showStructure() {
  const { definition } = problem;
  showSizes();
  fill(byId("departure"), facts(departureFacts(definition, structure)));
  timeline.show(structure.trajectories, problem.n_segments, definition.segmentation);
  sparsity.show(structure);
}

function goal() {
  const survive = ["It need survive no outage.", "From the start of the outage a realization leaves it and reaches the target too; both are solved together."][problem.k]
    ?? `From the start of each outage a realization leaves it and reaches the target too; all ${problem.k} are solved together with it.`;
  return `The reference goes from the departure to the target with the greatest final mass. ${survive}`;
}

function showFamily() {
  byId("best-none").hidden = family.n_solutions > 0;
  byId("best").hidden = family.n_solutions === 0;
  best.show(family.best);
  const all = byId("all");
  all.hidden = family.n_solutions === 0;
  all.setAttribute("href", `/archive?problem=${hash}`);
  all.textContent = family.n_solutions === 1 ? "Open it in the archive" : `All ${number(family.n_solutions, 0)} in the archive`;
  showRelatives("fewer", fewer, family.fewer, family.n_fewer);
  showRelatives("more", more, family.more, family.n_more);
}

/**
 * @param {string} name
 * @param {Table<any>} table
 * @param {any[]} rows
 * @param {number} all
 */
function showRelatives(name, table, rows, all) {
  byId(name).hidden = all === 0;
  byId(`${name}-none`).hidden = all > 0;
  byId(`${name}-count`).textContent = rows.length < all ? `${rows.length} of ${number(all, 0)} are listed.` : "";
  table.show(rows);
}

/** @returns {import("../table.js").Column<any>[]} */
function bestColumns() {
  return [
    { key: "id", title: "Solution", cell: (row) => [shortId(row.id), !row.strict && el("span", { class: "tag" }, "paper")] },
    { key: "strategy", title: "Strategy", cell: (row) => row.strategy },
    { key: "delta_v", title: "Δv", unit: "km/s", numeric: true, cell: (row) => number(row.delta_v_km_s, 4) },
    { key: "propellant", title: "Propellant", unit: "kg", numeric: true, minor: true, cell: (row) => number(row.propellant_kg, 1) },
    { key: "days", title: "Flight", unit: "d", numeric: true, cell: (row) => number(row.time_of_flight_days, 1) },
    { key: "campaign", title: "Campaign", numeric: true, minor: true, cell: (row) => el("a", { href: `/campaigns/${row.campaign_id}` }, row.campaign_id) },
  ];
}

/**
 * @param {HTMLElement} place
 * @param {string} caption
 * @param {string} which
 */
function relatives(place, caption, which) {
  /** @type {import("../table.js").Column<any>[]} */
  const columns = [
    { key: "outage", title: which, cell: (row) => outages([row.outage]) },
    { key: "hash", title: "Problem", minor: true, cell: (row) => shortId(row.hash) },
    { key: "n", title: "Solutions", numeric: true, cell: (row) => number(row.n_solutions, 0) },
    { key: "delta_v", title: "Best Δv", unit: "km/s", numeric: true, cell: (row) => number(row.best_delta_v_km_s, 4) },
  ];
  return new Table(place, caption, columns, { id: (row) => row.hash, href: (row) => `/problems/${row.hash}` });
}

function redraw() {
  timeline.figure.draw();
  sparsity.figure.draw();
  drawing = drawing.then(draw);
}

new Page({ events: "/events/stream", refresh, redraw }).start();
