// @ts-check
/** The head of the page: which campaign, how far, how long still, and whether the line is up. */

import { byId, el, fill } from "./dom.js";
import { clock, duration, NONE, number } from "./format.js";

/** @typedef {import("./api.js").Campaign} Campaign */

/** States in which numbers still move. */
const MOVING = new Set(["active"]);

const CONNECTIONS = {
  live: "live",
  connecting: "reconnecting",
  stopped: "offline",
};

/**
 * @param {import("./api.js").CampaignItem[]} items
 * @param {number} chosen
 */
export function showCampaignList(items, chosen) {
  const select = /** @type {HTMLSelectElement} */ (byId("campaigns"));
  const options = items.map((item) => el("option", { value: item.id }, `${item.name} · #${item.id}`));
  fill(select, options);
  select.value = String(chosen);
  byId("campaign-picker").hidden = items.length < 2;
}

/**
 * @param {Campaign} campaign
 * @param {number} fetchedAt milliseconds on the page's clock
 */
export function showCampaign(campaign, fetchedAt) {
  document.title = `${campaign.name} · coastarc`;
  byId("campaign-name").textContent = campaign.name;
  const state = byId("campaign-state");
  state.textContent = campaign.state;
  state.dataset.state = campaign.state;
  const since = MOVING.has(campaign.state) ? (performance.now() - fetchedAt) / 1000 : 0;
  const left = campaign.eta_seconds === null ? null : campaign.eta_seconds - since;
  fill(
    byId("campaign-numbers"),
    fact("Elapsed", duration(campaign.elapsed_seconds + since)),
    fact(...remaining(campaign, left)),
    fact("Guesses", `${number(campaign.n_solves, 0)}`),
    fact("Rate", MOVING.has(campaign.state) ? number(campaign.rate_per_min, 1, "/min") : NONE),
    fact("CPU", duration(campaign.cpu_seconds)),
    fact("Best Δv", number(campaign.best_delta_v_km_s, 4, "km/s")),
  );
}

/**
 * @param {Campaign} campaign
 * @param {number | null} left
 * @returns {[string, string]}
 */
function remaining(campaign, left) {
  if (campaign.state === "active") return ["Remaining", left === null ? "estimating" : `≈ ${duration(left)}`];
  if (campaign.state === "paused") return ["Remaining", "paused"];
  return ["Finished", campaign.finished_at ? clock(new Date(campaign.finished_at)) : NONE];
}

/**
 * @param {string} name
 * @param {string} value
 */
function fact(name, value) {
  return el("div", { class: "fact" }, el("dt", {}, name), el("dd", {}, value));
}

/**
 * @param {import("./live.js").Connection} connection
 * @param {Date} lastHeard
 */
export function showConnection(connection, lastHeard) {
  const dot = byId("connection");
  dot.dataset.connection = connection;
  dot.textContent = CONNECTIONS[connection];
  const notice = byId("notice");
  notice.hidden = connection !== "stopped";
  if (connection === "stopped") {
    fill(
      notice,
      el("strong", {}, "The coordinator has stopped, or cannot be reached."),
      ` Below is the last it said, at ${clock(lastHeard)}. Results are safe in its database; this page goes on `,
      "by itself once ",
      el("code", {}, "coastarc run"),
      " or ",
      el("code", {}, "coastarc serve"),
      " is running again.",
    );
  }
}
