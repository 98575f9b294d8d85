/** Progress of every search of a campaign: guesses by outcome, feasibility, cost and best, one row each. */

import { byId, el, fill } from "./dom.js";
import { NONE, number, outages, percent } from "./format.js";
import { lookOf, ofPlanned, outcomeBar, OUTCOMES } from "./looks.js";

/** @import { SearchView } from "../types" */

const HEAD = [
  ["Search", ""],
  ["Guesses", "wide"],
  ["Feasible, strict", ""],
  ["Best Δv", "number"],
  ["CPU per solution", "number minor"],
  ["Weight", "number minor"],
];

/**
 * @param {number} campaign
 * @param {SearchView[]} searches
 * @param {((search: SearchView) => void) | null} onChange asks for another weight; null where one may not
 */
export function showSearches(campaign, searches, onChange) {
  const focused = document.activeElement?.getAttribute("data-weight-of");
  fill(
    byId("searches"),
    el(
      "table",
      { class: "search-table" },
      el("caption", { class: "visually-hidden" }, "Searches and their progress"),
      el("thead", {}, el("tr", {}, HEAD.map(([title, kind]) => el("th", { scope: "col", class: kind || null }, title)))),
      el("tbody", {}, searches.map((search) => line(campaign, search, onChange))),
    ),
  );
  fill(byId("outcomes"), OUTCOMES.map(({ key, words }) => el("li", {}, el("i", { class: key }), words)));
  // Keyboard focus survives the rewriting of the rows.
  if (focused) /** @type {HTMLElement | null} */ (document.querySelector(`[data-weight-of="${CSS.escape(focused)}"]`))?.focus();
}

/**
 * @param {number} campaign
 * @param {SearchView} search
 * @param {((search: SearchView) => void) | null} onChange
 */
function line(campaign, search, onChange) {
  const href = `/campaigns/${campaign}/searches/${encodeURIComponent(search.name)}`;
  const perSolution = search.n_strict > 0 ? search.cpu_seconds / search.n_strict : null;
  return el(
    "tr",
    { "data-search": search.name, "data-solves": search.n_solves },
    el(
      "th",
      { scope: "row" },
      el("i", { class: "swatch", style: `background:${lookOf(search.strategy).color}` }),
      el("a", { href }, search.strategy),
      el("span", { class: "muted name" }, ` ${search.name} `),
      search.state !== "active" && el("span", { class: "pill", "data-state": search.state }, search.state),
      el("span", { class: "muted about" }, about(search)),
    ),
    el("td", { class: "wide" }, outcomeBar(outcomesOf(search), search.n_guesses_planned, `${search.name}: guesses solved`), el("span", { class: "muted" }, count(search))),
    el("td", {}, ratio(search)),
    el("td", { class: "number" }, best(search)),
    el("td", { class: "number minor" }, number(perSolution, perSolution !== null && perSolution < 100 ? 1 : 0, "s")),
    el("td", { class: "number minor" }, weight(search, onChange)),
  );
}

/** @param {SearchView} search */
function about(search) {
  if (search.state === "waiting" && search.seeds_from) return `waiting for seeds from ${search.seeds_from}`;
  const first = search.cases[0] ? outages(search.cases[0].outages) : "";
  const where = search.cases.length > 1 ? `${number(search.cases.length, 0)} cases, first: ${first}` : first;
  const source = search.seeds_from ? `seeds of ${search.seeds_from}, ${search.mapping}; ` : "";
  return `${source}${where}`;
}

/**
 * Return the guesses by outcome, each once.
 * @param {SearchView} search
 */
function outcomesOf(search) {
  const timeout = search.endings.timeout ?? 0;
  const numerical = search.endings.numerical ?? 0;
  const infeasible = Math.max(0, search.n_solves - search.n_paper - timeout - numerical);
  return { strict: search.n_strict, paper: search.n_paper - search.n_strict, infeasible, timeout, numerical };
}

/** @param {SearchView} search */
function count(search) {
  const { running, dead } = search.jobs;
  const jobs = [running ? `${number(running, 0)} running` : "", dead ? `${number(dead, 0)} dead` : ""].filter(Boolean);
  if (search.n_guesses_planned === 0) return "no seeds yet";
  return [ofPlanned(search.n_solves, search.n_guesses_planned), ...jobs].join(" · ");
}

/** @param {SearchView} search */
function ratio(search) {
  const { value: share, low, high } = search.strict_ratio;
  if (share === null) return el("span", { class: "muted" }, NONE);
  return el(
    "span",
    { class: "ratio", title: "Verified independently to the strict tolerance; 95 % Wilson interval" },
    el("strong", {}, percent(share)),
    el(
      "span",
      { class: "interval", "aria-hidden": "true" },
      el("span", { class: "band strict", style: `left:${100 * low}%;right:${100 - 100 * high}%` }),
      el("span", { class: "dot", style: `left:${100 * share}%` }),
    ),
    el("span", { class: "muted range" }, `${percent(low)} to ${percent(high)}`),
  );
}

/** @param {SearchView} search */
function best(search) {
  const words = number(search.best_delta_v_km_s, 4, "km/s");
  return search.best_solution_id ? el("a", { href: `/solutions/${search.best_solution_id}` }, words) : words;
}

/**
 * @param {SearchView} search
 * @param {((search: SearchView) => void) | null} onChange
 */
function weight(search, onChange) {
  const words = String(Number(search.weight.toPrecision(3)));
  if (!onChange || search.state === "done" || search.state === "cancelled") return words;
  const name = `Change weight and priority of ${search.name}; its weight is ${words}`;
  return el("button", { type: "button", "data-weight-of": search.name, "aria-label": name, title: name, onclick: () => onChange(search) }, words);
}
