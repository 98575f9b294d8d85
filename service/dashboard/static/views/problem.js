/** One problem: its definition, outages, structure and solutions. */

import { find, get } from "../api.js";
import { byId, el, fill } from "../dom.js";
import { counted, epoch, number, outages, shortId } from "../format.js";
import { boundsOf, tellTolerances } from "../looks.js";
import { facts, Page, pathPart, showEmpty, showFacts, showTitle } from "../page.js";
import { ChanceFigures, OutageFigure, SparsityFigure } from "../problem_figures.js";
import { Table } from "../table.js";

/**
 * @import { Column } from "../table.js"
 * @import { BestSolution, EventView, ProblemFamily, ProblemStructure, ProblemView, Relative, WorldView } from "../../types"
 */

/** @typedef {[string, string]} Fact */

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function spacecraftFacts({ spacecraft }) {
  return [
    ["Wet mass", number(spacecraft.wet_mass_kg, 0, "kg")],
    ["Dry mass", number(spacecraft.dry_mass_kg, 0, "kg")],
    ["Maximum thrust", number(spacecraft.max_thrust_n, 3, "N")],
    ["Specific impulse", number(spacecraft.isp_s, 0, "s")],
  ];
}

/**
 * @param {ProblemView} problem
 * @param {ProblemStructure} structure
 * @returns {Fact[]}
 */
export function departureFacts({ definition, world }, structure) {
  const departure = /** @type {any} */ (definition.departure);
  const common = /** @type {Fact[]} */ ([
    ["Transfer begins", epoch(structure.departure_epoch)],
    ["Mass at departure", number(structure.departure_mass_kg, 1, "kg")],
  ]);
  if (departure.kind === "spiral") {
    const end = departure.jacobi === null ? `after ${number(departure.duration_days, 1, "d")}` : `at Jacobi value ${number(departure.jacobi, 3)}`;
    return [
      ["From", "a spiral at full thrust"],
      ["Spiral begins", epoch(departure.epoch)],
      ["Perigee, apogee", `${number(departure.perigee_radius_km, 0)} × ${number(departure.apogee_radius_km, 0, "km")}`],
      ["Inclination", number(departure.inclination_deg, 2, "°")],
      ["Spiral ends", end],
      ...common,
    ];
  }
  const vector = (/** @type {number[]} */ v, /** @type {number} */ digits, /** @type {string} */ unit) => `(${v.map((value) => number(value, digits)).join(", ")}) ${unit}`;
  return [
    ["From", `a state, ${world.center === "Earth" ? "geocentric" : "heliocentric"} J2000`],
    ...common,
    ["Position", vector(departure.position_km, 0, "km")],
    ["Velocity", vector(departure.velocity_km_s, 4, "km/s")],
  ];
}

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function targetFacts({ target }) {
  if (target.kind === "spk") return [["To", "an orbit from an SPK kernel"], ["File", target.path], ["NAIF id", String(target.naif_id)]];
  return [
    ["To", "the near-rectilinear halo orbit (NRHO) of the Moon"],
    ["Period", number(target.period_days, 4, "d")],
    ["Perilune near", epoch(target.perilune_epoch)],
  ];
}

/**
 * @param {WorldView} world
 * @returns {Fact[]}
 */
export function worldFacts({ center, bodies, length_km, time_days, mass_kg, strict, loose }) {
  return [
    ["Centre", center],
    ["Other bodies that pull", bodies.join(", ") || "none"],
    ["Units of the numerics", `${number(length_km, 0, "km")}, ${number(time_days, 3, "d")}, ${number(mass_kg, 0, "kg")}`],
    ["Strict tolerance", boundsOf(strict)],
    ["Loose tolerance", boundsOf(loose)],
  ];
}

/**
 * @param {any} definition
 * @returns {Fact[]}
 */
export function boundFacts({ bounds, n_segments: n, segmentation }) {
  const range = (/** @type {number[]} */ [low, high], /** @type {number} */ digits, /** @type {string} */ unit) =>
    `${number(low, digits)} to ${number(high, digits, unit)}`;
  return [
    ["Segments", `${n}, of equal length`],
    ["Segments of realizations", segmentation === "adaptive" ? "those left after the missed one" : `${n} each`],
    ["Shooting time", range(bounds.shooting_days, 3, "d")],
    ["Initial coast", range(bounds.initial_coast_days, 1, "d")],
    ["Final coast", range(bounds.final_coast_days, 1, "d")],
    ["Throttle", range(bounds.throttle, 2, "")],
    ["In-plane angle", "−180 to 180\u00a0°"],
    ["Out-of-plane angle", "−90 to 90\u00a0°"],
    ["Minimum final mass", number(bounds.min_final_mass_kg, 0, "kg")],
  ];
}

const hash = pathPart(1);
const timeline = new OutageFigure(byId("outages"));
const sparsity = new SparsityFigure(byId("sparsity"));
const chances = new ChanceFigures(byId("counts"), byId("durations"));
const best = new Table(byId("best"), "Best solutions of this problem", bestColumns(), {
  id: (row) => row.id,
  href: (row) => `/solutions/${row.id}`,
});
const fewer = relatives(byId("fewer"), "Problems with one outage fewer", "Without");
const more = relatives(byId("more"), "Problems with one outage more", "With");
/** @type {ProblemView} */
let problem;
/** @type {ProblemStructure} */
let structure;
/** @type {ProblemFamily} */
let family;

/**
 * @param {EventView[]} events
 * @param {boolean} isAll
 */
async function refresh(events, isAll) {
  if (!problem) {
    /** @type {ProblemView | null} */
    const found = await find(`/problems/${hash}`);
    if (!found) return showEmpty(...unknown());
    problem = found;
    showProblem();
    // Its counts take a moment the first time; the rest does not wait for them.
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
  await chances.show(structure, arc, problem.outages.map((outage) => outage.duration_days));
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
  fill(byId("world"), facts(worldFacts(problem.world)));
  tellTolerances(problem.world);
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
  fill(byId("departure"), facts(departureFacts(problem, structure)));
  timeline.show(structure.trajectories, problem.n_segments, String(definition.segmentation));
  sparsity.show(structure);
}

function goal() {
  const survive = ["There is no outage to survive.", "At the start of the outage a realization branches off and also reaches the target; both are solved together."][problem.k]
    ?? `At the start of each outage a realization branches off and also reaches the target; all ${problem.k} are solved together with it.`;
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
 * @param {Table<Relative>} table
 * @param {Relative[]} rows
 * @param {number} all
 */
function showRelatives(name, table, rows, all) {
  byId(name).hidden = all === 0;
  byId(`${name}-none`).hidden = all > 0;
  byId(`${name}-count`).textContent = rows.length < all ? `${rows.length} of ${number(all, 0)} are listed.` : "";
  table.show(rows);
}

/** @returns {Column<BestSolution>[]} */
function bestColumns() {
  return [
    { key: "id", title: "Solution", cell: (row) => [shortId(row.id), !row.strict && el("span", { class: "tag" }, "loose")] },
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
  /** @type {Column<Relative>[]} */
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
