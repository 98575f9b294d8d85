/** One search: its chains or seeds, their solves, and its laws. */

import { ApiError, get } from "../api.js";
import { mayControl, searchControls, session } from "../controls.js";
import { byId, el, fill } from "../dom.js";
import { sampled } from "../figures.js";
import { duration, NONE, number, outages, percent, shortId } from "../format.js";
import { HopGrid } from "../hop_grid.js";
import { lawFacts, ReachFigure } from "../hop_laws.js";
import { ofPlanned, outcomeBar, outcomeList, tellTolerancesOf } from "../looks.js";
import { facts, Page, pathPart, showEmpty, showFacts, showTitle } from "../page.js";
import { ChainTable, SeedTable, YieldFigure, yieldsOf } from "../seeds_and_chains.js";
import { DeltaVFigure, TimeFigure, ViolationFigure } from "../solve_figures.js";
import { outcomeOf, Solves } from "../solves.js";

/**
 * @import { Child } from "../dom.js"
 * @import { Solve } from "../solves.js"
 * @import { EventView, SearchDetail, SeedRules } from "../../types"
 */

/** Cases that are linked one by one. */
const MOST_CASES = 24;

const campaign = pathPart(1);
const name = pathPart(3);
const path = `/campaigns/${encodeURIComponent(campaign)}/searches/${encodeURIComponent(name)}`;
const solves = new Solves(`${path}/hops`);
/** @type {SearchDetail | undefined} */
let shown;
let mayChange = false;

const grid = new HopGrid(byId("hops"));
const violation = new ViolationFigure(byId("violation"), "Violation");
const deltaV = new DeltaVFigure(byId("delta-v"), "Δv of feasible solves");
const time = new TimeFigure(byId("time"), "Time per solve");
/** @type {ReachFigure | YieldFigure | undefined} */
let reachOrYield;
/** @type {ChainTable | SeedTable | undefined} */
let rows;
/** The data that the figures show. */
let drawn = "";

const page = new Page({ events: `/campaigns/${encodeURIComponent(campaign)}/events`, refresh, redraw });
page.start();

/**
 * @param {EventView[]} events
 * @param {boolean} isAll
 */
async function refresh(events, isAll) {
  if (!isAll && !events.some(({ kind, data }) => kind === "campaign" || data.search === name)) return;
  // Not awaited yet: for a large search they take longer than the rest of the page.
  const asked = solves.refresh(isAll);
  asked.catch(() => {});
  /** @type {SearchDetail} */
  let search;
  try {
    [search, mayChange] = await Promise.all([get(path), isAll ? session().then(mayControl) : mayChange]);
  } catch (error) {
    if (!(error instanceof ApiError) || ![404, 422].includes(error.status)) throw error;
    return showMissing(error.message);
  }
  if (!shown) await tellTolerancesOf(search.cases);
  shown = search;
  showHead(search);
  await asked;
  if (search.n_solves === 0 && search.state === "waiting") return showWaiting(search);
  showEmpty();
  // Figures are expensive: they are redrawn only when their data has changed.
  const data = JSON.stringify([search, solves.last, solves.byId.size]);
  if (data !== drawn) await redraw();
  drawn = data;
}

/** @param {string} words */
function showMissing(words) {
  showTitle("Search not found", [["Campaigns", "/"]]);
  showEmpty(el("h2", {}, "No such search"), el("p", {}, words), el("p", {}, el("a", { href: "/" }, "All campaigns")));
}

/** @param {SearchDetail} search */
function showWaiting(search) {
  showEmpty(
    el("h2", {}, "Waiting for seeds"),
    el("p", {}, "Its seeds come from ", search.seeds && sourceLink(search, search.seeds), ", which has to finish first: they are chosen from all that it finds."),
    el("p", {}, "This page updates by itself."),
  );
}

/** @param {SearchDetail} search */
function showHead(search) {
  const about = `/campaigns/${search.campaign_id}`;
  showTitle(`${search.strategy} · ${search.name}`, [["Campaigns", "/"], [search.campaign, about]]);
  byId("state").hidden = false;
  byId("state").dataset.state = search.state;
  byId("state").textContent = search.campaign_state === "paused" && search.state === "active" ? "active, but its campaign is paused" : search.state;
  fill(byId("actions"), mayChange && ["active", "paused"].includes(search.campaign_state) ? searchControls(search, () => page.reload()) : []);
  const best = search.best_solution_id;
  showFacts([
    ["Best Δv", best ? el("a", { href: `/solutions/${best}` }, number(search.best_delta_v_km_s, 4, "km/s")) : NONE],
    ["Guesses", ofPlanned(search.n_solves, search.n_guesses_planned)],
    ["Feasible, strict", search.n_solves ? `${number(search.n_strict, 0)} (${percent(search.n_strict / search.n_solves)})` : NONE],
    ["Feasible, loose", search.n_solves ? `${number(search.n_paper, 0)} (${percent(search.n_paper / search.n_solves)})` : NONE],
    ["CPU", duration(search.cpu_seconds)],
    ["CPU per strict solution", search.n_strict ? number(search.cpu_seconds / search.n_strict, 1, "s") : NONE],
    ["Weight, priority", `${number(search.weight, 2).replace(/\.?0+$/, "")}, ${search.priority}`],
  ]);
}

async function redraw() {
  if (!shown) return;
  const search = shown;
  const all = solves.all;
  const caption = sampled(all.length, solves.nAll, "solves");
  const hops = search.seeds ? 1 : search.hops;
  showProgress(search, all);
  grid.show(all, { isMapped: search.seeds !== null, hops }, caption);
  const drawing = showReachOrYield(search, all, caption);
  showRules(search);
  if (all.length === 0) {
    for (const figure of [violation, deltaV, time]) figure.empty("No solve yet. The first one appears here when its job is done.");
    return drawing;
  }
  await Promise.all([drawing, violation.draw(all, hops, caption), deltaV.draw(all, hops, caption), time.draw(all, caption)]);
  for (const figure of [violation, deltaV, reachOrYield]) figure?.linkMarks();
}

/**
 * @param {SearchDetail} search
 * @param {Solve[]} all
 */
function showProgress(search, all) {
  // The other outcomes are estimated from the solves shown, a fair sample of all.
  const rest = search.n_solves - search.n_paper;
  const failed = all.filter(({ verdict }) => verdict === null);
  const part = (/** @type {string} */ ending) => (failed.length ? Math.round((rest * failed.filter((solve) => outcomeOf(solve) === ending).length) / failed.length) : 0);
  const [timeout, numerical] = [part("timeout"), part("numerical")];
  const counts = { strict: search.n_strict, paper: search.n_paper - search.n_strict, infeasible: Math.max(0, rest - timeout - numerical), timeout, numerical };
  fill(byId("progress"), outcomeBar(counts, search.n_guesses_planned, `${search.strategy}: guesses solved`), el("ul", { class: "outcomes" }, el("li", { class: "total" }, ofPlanned(search.n_solves, search.n_guesses_planned)), outcomeList(counts)));
}

/**
 * @param {SearchDetail} search
 * @param {Solve[]} all
 * @param {string} caption
 */
async function showReachOrYield(search, all, caption) {
  if (search.seeds) {
    reachOrYield ??= new YieldFigure(byId("reach"), "Yield by seed");
    rows ??= new SeedTable(byId("rows"));
    const yields = yieldsOf(solves);
    const n = /** @type {SeedTable} */ (rows).show(yields);
    byId("rows-title").textContent = "Seeds";
    byId("rows-note").textContent = n < yields.length ? `the ${n} most productive of ${number(yields.length, 0)}` : "";
    await /** @type {YieldFigure} */ (reachOrYield).draw(yields, caption);
  } else if (search.laws) {
    reachOrYield ??= new ReachFigure(byId("reach"), search.laws.adaptive ? "Step size" : "Reach of a hop");
    rows ??= new ChainTable(byId("rows"));
    const [n, of] = /** @type {ChainTable} */ (rows).show(all);
    byId("rows-note").textContent = n < of ? `the best ${n} of ${number(of, 0)}` : "";
    await /** @type {ReachFigure} */ (reachOrYield).draw(all, search.laws, search.hops, caption);
  }
}

/** @param {SearchDetail} search */
function showRules(search) {
  const { budget, jobs } = search;
  const budgets = [
    budget.guesses === null ? "" : number(budget.guesses, 0, "guesses"),
    budget.core_seconds === null ? "" : `${duration(budget.core_seconds)} of CPU`,
    budget.solutions === null ? "" : number(budget.solutions, 0, "solutions"),
  ].filter(Boolean);
  const caps = `${number(search.solve_cpu_seconds * (1 + search.k), 0, "s")} of CPU${search.max_iterations === null ? "" : `, ${number(search.max_iterations, 0, "iterations")}`}`;
  fill(
    byId("laws"),
    facts([
      ...(search.laws ? lawFacts(search.laws, search.hops) : seedFacts(search)),
      ["Budget", budgets.join(" or ") || "all of its seeds"],
      ["Limit per solve", caps],
    ]),
  );
  fill(byId("jobs"), facts([["Waiting", number(jobs.queued, 0)], ["Running", number(jobs.running, 0)], ["Done", number(jobs.done, 0)], ["Dead", jobs.dead ? el("a", { href: `/workers?campaign=${search.campaign_id}&state=dead` }, number(jobs.dead, 0)) : "0"], ["Cancelled", number(jobs.cancelled, 0)]]));
  byId("jobs-link").setAttribute("href", `/workers?campaign=${search.campaign_id}`);
  const links = search.cases.slice(0, MOST_CASES).map((one, i) => el("a", { href: `/problems/${one.problem_hash}` }, `${i + 1}: ${outages(one.outages)}`));
  const more = search.cases.length - links.length;
  fill(byId("cases"), links, more > 0 && el("span", { class: "muted" }, `and ${number(more, 0)} more`));
}

/**
 * Return a link to where seeds come from: a search of this or another campaign, or one solution.
 * @param {SearchDetail} search
 * @param {SeedRules} rules
 */
function sourceLink(search, rules) {
  if (rules.solution !== null) return el("a", { href: `/solutions/${rules.solution}` }, `solution ${shortId(rules.solution)}`);
  const source = rules.source ?? "";
  if (rules.campaign) return el("a", { href: "/" }, `${rules.campaign}/${source}`);
  return el("a", { href: `/campaigns/${search.campaign_id}/searches/${encodeURIComponent(source)}` }, source);
}

/**
 * @param {SearchDetail} search
 * @returns {[string, Child][]}
 */
function seedFacts(search) {
  const rules = /** @type {SeedRules} */ (search.seeds);
  const limit = rules.limit === null ? "all of them" : `at most ${number(rules.limit, 0)}`;
  return [
    ["Seeds from", sourceLink(search, rules)],
    ["Mapping", rules.mapping.join(", ")],
    ["Which seeds", rules.order ? `${limit}, in order of ${rules.order.replaceAll("_", " ")}` : limit],
    ["For which cases", { every: "every seed for every case", "round-robin": "each seed for one case in turn", contained: "the cases that contain its outages" }[rules.pairing] ?? rules.pairing],
    ["Tolerance of the seeds", rules.tolerance === "paper" ? "loose" : rules.tolerance],
    ["Other outage durations", rules.any_duration ? "allowed" : "not allowed"],
  ];
}
