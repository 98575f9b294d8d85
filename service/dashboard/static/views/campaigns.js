/** All campaigns: how far, how well, how long still. */

import { get } from "../api.js";
import { STEERING } from "../campaign.js";
import { byId, el, fill } from "../dom.js";
import { date, duration, NONE, number } from "../format.js";
import { ofPlanned, outcomeBar, outcomeList } from "../outcomes.js";
import { facts, Page, showEmpty } from "../page.js";
import { askImport } from "../portable.js";
import { sparkline } from "../sparkline.js";

/** After a start a large archive is read in pieces; until it is read, they are asked for at once [ms]. */
const READ_ON_MS = 250;

/**
 * @typedef {{
 *   id: number, name: string, state: string, created_at: string, n_solves: number, n_solutions: number, n_read: number,
 *   best_delta_v_km_s: number | null, outcomes: Record<import("../outcomes.js").Outcome, number>,
 *   n_guesses_planned: number | null, n_searches: number, strategies: string[], rate_per_min: number,
 *   eta_seconds: number | null, elapsed_seconds: number, cpu_seconds: number, sparkline_km_s: (number | null)[],
 * }} Card
 */

const page = new Page({ events: "/events/stream", refresh });
page.start();
offerMore();

async function offerMore() {
  const who = await get("/session").catch(() => null);
  const mayImport = who !== null && STEERING.includes(who.role);
  fill(
    byId("actions"),
    mayImport && el("button", { type: "button", "data-does": "import", onclick: askImport }, "Import campaign"),
    el("a", { class: "button primary", href: "/campaigns/new" }, "New campaign"),
  );
}

async function refresh() {
  const { items } = /** @type {{ items: Card[] }} */ (await get("/campaigns"));
  if (items.length === 0) return showEmpty(...welcome());
  showEmpty();
  fill(byId("campaigns"), items.map(row));
  if (items.some((item) => item.n_read < item.n_solves)) window.setTimeout(() => page.take(null), READ_ON_MS);
}

function welcome() {
  return [
    el("h2", {}, "No campaign yet"),
    el("p", {}, "A campaign is a search that you describe in a file. Write one here, or start one in a terminal:"),
    el("p", {}, el("a", { class: "button primary", href: "/campaigns/new" }, "New campaign")),
    el("pre", {}, "coastarc run examples/quick.toml"),
  ];
}

/** @param {Card} card */
function row(card) {
  return el(
    "li",
    { class: "card campaign", "data-campaign": card.id, "data-solves": card.n_solves },
    el(
      "div",
      { class: "what" },
      el("h2", {}, el("a", { href: `/campaigns/${card.id}` }, card.name), " ", el("span", { class: "pill", "data-state": card.state }, card.state)),
      el("p", { class: "muted" }, `Campaign ${card.id}, ${date(card.created_at)}`),
      el("p", { class: "muted strategies", title: card.strategies.join(", ") }, shortened(card.strategies)),
    ),
    progress(card),
    improvement(card),
    el("dl", { class: "facts" }, facts(numbers(card))),
    el("p", { class: "more" }, el("a", { href: `/campaigns/new?clone=${card.id}`, "aria-label": `Clone ${card.name}` }, "Clone")),
  );
}

/** @param {string[]} strategies */
function shortened(strategies) {
  return strategies.length > 6 ? `${strategies.slice(0, 5).join(", ")} and ${strategies.length - 5} more` : strategies.join(", ");
}

/** @param {Card} card */
function progress(card) {
  return el(
    "div",
    { class: "progress" },
    outcomeBar(card.outcomes, card.n_guesses_planned, `${card.name}: guesses solved`),
    el("ul", { class: "outcomes" }, el("li", { class: "total" }, ofPlanned(card.n_solves, card.n_guesses_planned)), outcomeList(card.outcomes)),
  );
}

/** @param {Card} card */
function improvement(card) {
  const best = number(card.best_delta_v_km_s, 4, "km/s");
  const isFound = card.best_delta_v_km_s !== null;
  const nothing = card.n_solves > 0 ? "no strict solution yet" : card.state === "active" ? "waiting for a first guess" : NONE;
  return el(
    "div",
    { class: "improvement" },
    el("p", {}, el("span", { class: "muted" }, "Best Δv "), el("strong", {}, isFound ? best : nothing)),
    isFound && sparkline(card.sparkline_km_s, `Best delta-v against time, ${best} now`),
  );
}

/**
 * @param {Card} card
 * @returns {[string, string][]}
 */
function numbers(card) {
  const isOver = card.state === "done" || card.state === "cancelled";
  return [
    ["Rate", isOver ? NONE : number(card.rate_per_min, 1, "/min")],
    isOver ? ["Took", duration(card.elapsed_seconds)] : ["Remaining", duration(card.eta_seconds)],
    ["Solutions", number(card.n_solutions, 0)],
    ["CPU", duration(card.cpu_seconds)],
  ];
}
