/** All campaigns: progress, results, time left. */

import { get } from "../api.js";
import { askImport, mayControl, session } from "../controls.js";
import { byId, el, fill, svg } from "../dom.js";
import { date, duration, NONE, number } from "../format.js";
import { ofPlanned, outcomeBar, outcomeList } from "../looks.js";
import { facts, Page, showEmpty } from "../page.js";

/** @import { CampaignCard, CampaignCards } from "../../types" */

const [WIDTH, HEIGHT, EDGE] = [180, 40, 3];

/**
 * Return a step line through values evenly spaced in time; null where there is none yet.
 * @param {(number | null)[]} values
 * @param {string} words read out
 */
export function sparkline(values, words) {
  const known = values.filter((value) => value !== null);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const x = (/** @type {number} */ i) => EDGE + (i / Math.max(1, values.length - 1)) * (WIDTH - 2 * EDGE);
  const y = (/** @type {number} */ value) => HEIGHT - EDGE - (high > low ? (value - low) / (high - low) : 0) * (HEIGHT - 2 * EDGE);
  /** @type {string[]} */
  const path = [];
  values.forEach((value, i) => {
    if (value !== null) path.push(path.length ? `H${x(i).toFixed(1)}V${y(value).toFixed(1)}` : `M${x(i).toFixed(1)} ${y(value).toFixed(1)}`);
  });
  const last = values[values.length - 1];
  return svg(
    "svg",
    { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "sparkline", role: "img", "aria-label": words, preserveAspectRatio: "none" },
    svg("path", { d: path.join(""), fill: "none", "vector-effect": "non-scaling-stroke" }),
    // This point stays round although the line is stretched.
    typeof last === "number" && svg("path", { class: "now", d: `M${x(values.length - 1)} ${y(last)}h0`, "vector-effect": "non-scaling-stroke" }),
  );
}

/** After a start the service reads a large archive in pieces; meanwhile the page polls this often [ms]. */
const READ_ON_MS = 250;

const page = new Page({ events: "/events/stream", refresh });
page.start();
showActions();

async function showActions() {
  const mayImport = mayControl(await session());
  fill(
    byId("actions"),
    mayImport && el("button", { type: "button", "data-does": "import", onclick: askImport }, "Import campaign"),
    el("a", { class: "button primary", href: "/campaigns/new" }, "New campaign"),
  );
}

async function refresh() {
  /** @type {CampaignCards} */
  const { items } = await get("/campaigns");
  if (items.length === 0) return showEmpty(...welcome());
  showEmpty();
  fill(byId("campaigns"), items.map(row));
  if (items.some((item) => item.n_read < item.n_solves)) window.setTimeout(() => page.receive(null), READ_ON_MS);
}

function welcome() {
  return [
    el("h2", {}, "No campaign yet"),
    el("p", {}, "A campaign is a search that you describe in a file. Write one here, or start one in a terminal:"),
    el("p", {}, el("a", { class: "button primary", href: "/campaigns/new" }, "New campaign")),
    el("pre", {}, "coastarc run examples/quick.toml"),
  ];
}

/** @param {CampaignCard} card */
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

/** @param {CampaignCard} card */
function progress(card) {
  return el(
    "div",
    { class: "progress" },
    outcomeBar(card.outcomes, card.n_guesses_planned, `${card.name}: guesses solved`),
    el("ul", { class: "outcomes" }, el("li", { class: "total" }, ofPlanned(card.n_solves, card.n_guesses_planned)), outcomeList(card.outcomes)),
  );
}

/** @param {CampaignCard} card */
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
 * @param {CampaignCard} card
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
