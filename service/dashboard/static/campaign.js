/** What the service says about a campaign, and how one is steered: each change is asked about first. */

import { post } from "./api.js";
import { confirm } from "./dialog.js";
import { el } from "./dom.js";

/**
 * @typedef {{ segment: number, duration_days: number }} Outage
 * @typedef {{
 *   id: number, name: string, strategy: string, state: string, priority: number, weight: number, k: number,
 *   cases: { problem_hash: string, outages: Outage[] }[], mapping: string | null, seeds_from: string | null, hops: number,
 *   jobs: { queued: number, running: number, done: number, dead: number, cancelled: number },
 *   n_guesses_planned: number | null, n_solves: number, n_paper: number, n_strict: number, n_solutions: number,
 *   endings: Record<string, number>, best_solution_id: string | null, best_delta_v_km_s: number | null, cpu_seconds: number,
 * }} Search
 * @typedef {{
 *   id: number, name: string, state: string, priority: number, created_at: string, rng_seed: number, n_solves: number,
 *   n_solutions: number, best_delta_v_km_s: number | null, searches: Search[], rate_per_min: number,
 *   eta_seconds: number | null, elapsed_seconds: number, cpu_seconds: number,
 * }} Campaign
 */

/** Roles that may change something. */
export const STEERING = ["submitter", "admin"];

/** What each verb does, said before it is done. */
const VERBS = {
  pause: ["Pause", "Jobs that run finish; no more are handed out until it is resumed."],
  resume: ["Resume", "Its jobs are handed out again."],
  cancel: ["Cancel", "It ends for good: running jobs are stopped, waiting ones are dropped. All results are kept."],
};

/**
 * Return the buttons that steer a campaign, as far as its state admits.
 * @param {Campaign} campaign
 * @param {() => Promise<void>} onChanged
 */
export function controls(campaign, onChanged) {
  if (campaign.state === "done" || campaign.state === "cancelled") return [];
  const verb = campaign.state === "paused" ? "resume" : "pause";
  return [
    button("Priority", () => askPriority(campaign, onChanged)),
    button(VERBS[verb][0], () => ask(campaign, verb, onChanged)),
    button("Cancel", () => ask(campaign, "cancel", onChanged)),
  ];
}

/**
 * @param {string} words
 * @param {() => void} press
 */
function button(words, press) {
  return el("button", { type: "button", "data-does": words.toLowerCase(), onclick: press }, words);
}

/**
 * @param {Campaign} campaign
 * @param {"pause" | "resume" | "cancel"} verb
 * @param {() => Promise<void>} onChanged
 */
function ask(campaign, verb, onChanged) {
  const [word, words] = VERBS[verb];
  const act = async () => {
    await post(`/campaigns/${campaign.id}/${verb}`);
    await onChanged();
  };
  confirm(`${word} “${campaign.name}”?`, [el("p", {}, words)], `${word} the campaign`, act, { isDangerous: verb === "cancel" });
}

/**
 * @param {Campaign} campaign
 * @param {() => Promise<void>} onChanged
 */
function askPriority(campaign, onChanged) {
  const words = [
    el("p", {}, "Campaigns of a lower number go first; 0 is usual."),
    field("priority", "Priority", campaign.priority, { step: 1, min: -1_000_000, max: 1_000_000 }),
  ];
  confirm(`Change the priority of “${campaign.name}”?`, words, "Change the priority", async (form) => {
    await post(`/campaigns/${campaign.id}/priority`, { priority: valueOf(form, "priority") });
    await onChanged();
  });
}

/**
 * Ask for another weight and another priority of a search.
 * @param {Campaign} campaign
 * @param {Search} search
 * @param {() => Promise<void>} onChanged
 */
export function askWeight(campaign, search, onChanged) {
  const words = [
    el("p", {}, "A search of weight 2 gets twice the processor time of one of weight 1, among searches of equal priority. Lower priorities go first."),
    field("weight", "Weight", search.weight, { step: "any", min: 0.001, max: 1_000_000 }),
    field("priority", "Priority", search.priority, { step: 1, min: -1_000_000, max: 1_000_000 }),
  ];
  confirm(`Change the share of “${search.name}”?`, words, "Change the share", async (form) => {
    const path = `/campaigns/${campaign.id}/searches/${encodeURIComponent(search.name)}`;
    if (valueOf(form, "weight") !== search.weight) await post(`${path}/weight`, { weight: valueOf(form, "weight") });
    if (valueOf(form, "priority") !== search.priority) await post(`${path}/priority`, { priority: valueOf(form, "priority") });
    await onChanged();
  });
}

/**
 * @param {string} name
 * @param {string} words
 * @param {number} value
 * @param {Record<string, string | number>} bounds
 */
function field(name, words, value, bounds) {
  const input = el("input", { id: `new-${name}`, name, type: "number", value, required: true, ...bounds });
  return el("p", { class: "field" }, el("label", { for: `new-${name}` }, words), input);
}

/**
 * @param {HTMLFormElement} form
 * @param {string} name
 */
function valueOf(form, name) {
  return Number(/** @type {HTMLInputElement} */ (form.elements.namedItem(name)).value);
}
