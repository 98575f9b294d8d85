// @ts-check
/** Progress of every search: guesses by outcome, feasibility with its interval, cost and best. */

import { byId, el, fill } from "./dom.js";
import { duration, NONE, number, outages, percent } from "./format.js";
import { wilson } from "./wilson.js";

/** @typedef {import("./api.js").Search} Search */

/**
 * @param {Search[]} searches
 */
export function showSearches(searches) {
  fill(byId("searches"), searches.map(card));
}

/** @param {Search} search */
function card(search) {
  return el(
    "article",
    { class: "card search", "data-search": search.name, "data-solves": search.n_solves },
    el(
      "header",
      {},
      el("h3", {}, search.strategy),
      el("span", { class: "muted" }, search.name),
      el("span", { class: "pill", "data-state": search.state }, search.state),
    ),
    el("p", { class: "muted about" }, about(search)),
    progress(search),
    el("div", { class: "ratios" }, ratio("strict", search.n_strict, search), ratio("paper", search.n_paper, search)),
    numbers(search),
  );
}

/** @param {Search} search */
function about(search) {
  const drawn = `Guesses drawn at random${search.hops > 1 ? ", improved by hops" : ""}`;
  if (search.k === 0) return `${drawn}; no outage to survive.`;
  const source = search.seeds_from ? `Seeds from ${search.seeds_from}, mapped “${search.mapping}”. ` : `${drawn}. `;
  const what = search.k === 1 ? "an outage" : `${search.k} outages`;
  if (search.cases.length === 1) return `${source}Survives ${what}: ${outages(search.cases[0].outages)}.`;
  return `${source}Survives ${what}, in ${search.cases.length} cases from ${outages(search.cases[0].outages)} on.`;
}

/**
 * Return the guesses by outcome, each once: the strict ones, those feasible for the paper only, the rest.
 * @param {Search} search
 * @returns {[string, number, string][]}
 */
function outcomes(search) {
  const timeout = search.endings.timeout ?? 0;
  const numerical = search.endings.numerical ?? 0;
  const infeasible = Math.max(0, search.n_solves - search.n_paper - timeout - numerical);
  /** @type {[string, number, string][]} */
  const all = [
    ["strict", search.n_strict, "feasible, strict"],
    ["paper", search.n_paper - search.n_strict, "feasible, paper only"],
    ["infeasible", infeasible, "infeasible"],
    ["timeout", timeout, "out of time"],
    ["numerical", numerical, "not finite"],
  ];
  return all;
}

/** @param {Search} search */
function progress(search) {
  const planned = Math.max(search.n_guesses_planned ?? search.n_solves, search.n_solves, 1);
  const all = outcomes(search);
  const bar = all.map(([kind, count]) =>
    el("span", { class: `share ${kind}`, style: `width:${(100 * count) / planned}%` }),
  );
  const said = `${number(search.n_solves, 0)} of ${search.n_guesses_planned === null ? "an open number of" : number(planned, 0)} guesses`;
  const shown = all.filter(([kind, count]) => count > 0 || kind === "strict");
  return el(
    "div",
    { class: "progress" },
    el(
      "div",
      {
        class: "bar",
        role: "progressbar",
        "aria-label": `${search.strategy}: guesses solved`,
        "aria-valuemin": 0,
        "aria-valuemax": planned,
        "aria-valuenow": search.n_solves,
      },
      bar,
    ),
    el(
      "ul",
      { class: "outcomes" },
      el("li", { class: "total" }, said, waiting(search)),
      shown.map(([kind, count, words]) => el("li", {}, el("i", { class: kind }), `${number(count, 0)} ${words}`)),
    ),
  );
}

/** @param {Search} search */
function waiting(search) {
  const { running, dead } = search.jobs;
  const parts = [running ? `${running} running` : "", dead ? `${dead} dead` : ""].filter(Boolean);
  return parts.length ? ` · ${parts.join(", ")}` : "";
}

/**
 * @param {"strict" | "paper"} level
 * @param {number} feasible
 * @param {Search} search
 */
function ratio(level, feasible, search) {
  const trials = search.n_solves;
  const [low, high] = wilson(feasible, trials);
  const title = { strict: "0.1 km, 0.1 m/s, 0.01 kg", paper: "1 km, 100 m/s, 1 kg" }[level];
  const text = trials === 0 ? NONE : `${percent(feasible / trials)}`;
  const range = trials === 0 ? "no guess yet" : `${percent(low)} to ${percent(high)}`;
  return el(
    "div",
    { class: "ratio", title: `Within ${title} in an independent flight; 95 % Wilson interval` },
    el("span", { class: "label" }, `Feasible, ${level}`),
    el("strong", {}, text),
    el(
      "span",
      { class: "interval", "aria-hidden": "true" },
      trials > 0 && el("span", { class: `band ${level}`, style: `left:${100 * low}%;right:${100 - 100 * high}%` }),
      trials > 0 && el("span", { class: "dot", style: `left:${(100 * feasible) / trials}%` }),
    ),
    el("span", { class: "muted range" }, range),
  );
}

/** @param {Search} search */
function numbers(search) {
  const perSolution = search.n_strict > 0 ? search.cpu_seconds / search.n_strict : null;
  /** @type {[string, string][]} */
  const facts = [
    ["Best Δv", number(search.best_delta_v_km_s, 4, "km/s")],
    ["Propellant", number(search.best_propellant_kg, 1, "kg")],
    ["CPU a solution", perSolution === null ? NONE : number(perSolution, perSolution < 100 ? 1 : 0, "s")],
    ["CPU in all", duration(search.cpu_seconds)],
  ];
  return el(
    "dl",
    { class: "facts" },
    facts.map(([name, value]) => el("div", { class: "fact" }, el("dt", {}, name), el("dd", {}, value))),
  );
}
