/** How campaigns and searches are controlled, exported and imported: each change is confirmed first. */

import { address, ApiError, get, post, upload } from "./api.js";
import { el, fill } from "./dom.js";

/**
 * @import { Child } from "./dom.js"
 * @import { CampaignView, JobView, SearchDetail, SearchView, SessionView, ImportView } from "../types"
 */

/**
 * Ask before doing something; an error of the service is shown in the dialog, which then stays open.
 * @param {string} title a question
 * @param {Child[]} words what will happen
 * @param {string} verb on the button that does it
 * @param {(form: HTMLFormElement) => Promise<unknown>} action
 * @param {{ isDangerous?: boolean }} [how]
 */
export function confirm(title, words, verb, action, how = {}) {
  const fault = el("p", { class: "notice", role: "alert", hidden: true });
  const go = el("button", { type: "submit", class: how.isDangerous ? "danger" : "primary" }, verb);
  const leave = el("button", { type: "button", onclick: () => dialog.close() }, "Keep as it is");
  const form = /** @type {HTMLFormElement} */ (
    el("form", { method: "dialog" }, el("h2", { id: "dialog-title" }, title), words, fault, el("div", { class: "buttons" }, leave, go))
  );
  const dialog = /** @type {HTMLDialogElement} */ (el("dialog", { "aria-labelledby": "dialog-title" }, form));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    go.toggleAttribute("disabled", true);
    try {
      await action(form);
      dialog.close();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      fault.hidden = false;
      fill(fault, error.message);
      go.toggleAttribute("disabled", false);
    }
  });
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}

/**
 * Return who uses the page; null if the service does not say.
 * @returns {Promise<SessionView | null>}
 */
export function session() {
  return get("/session").catch(() => null);
}

/**
 * Return whether somebody may control campaigns, searches and jobs.
 * @param {SessionView | null} who
 */
export function mayControl(who) {
  return who !== null && (who.role === "submitter" || who.role === "admin");
}

/** What each verb does to a campaign; a search has words of its own where they differ. */
const VERBS = {
  pause: ["Pause", "Running jobs finish; no more are handed out until it is resumed.", " Other searches continue."],
  resume: ["Resume", "Its jobs are handed out again.", ""],
  cancel: ["Cancel", "This is final: running jobs are stopped, waiting ones are dropped. All results are kept.", " Searches that use its seeds continue with what it has found."],
};

/**
 * Return the buttons that control a campaign, as far as its state permits.
 * @param {CampaignView} campaign
 * @param {() => Promise<void>} onChanged
 */
export function campaignControls(campaign, onChanged) {
  const ask = (/** @type {keyof typeof VERBS} */ verb) => {
    const [word, words] = VERBS[verb];
    return askVerb(verb, `/campaigns/${campaign.id}`, `${word} “${campaign.name}”?`, words, `${word} the campaign`, onChanged);
  };
  return buttons(campaign.state, button("priority", "Priority", () => askPriority(campaign, onChanged)), ask);
}

/**
 * Return the buttons that control a search, as far as its state permits.
 * @param {SearchDetail} search
 * @param {() => Promise<void>} onChanged
 */
export function searchControls(search, onChanged) {
  const ask = (/** @type {keyof typeof VERBS} */ verb) => {
    const [word, words, more] = VERBS[verb];
    return askVerb(verb, pathOf(search.campaign_id, search.name), `${word} search “${search.name}”?`, words + more, `${word} the search`, onChanged);
  };
  return buttons(search.state, button("share", "Weight and priority", () => askWeight(search.campaign_id, search, onChanged)), ask);
}

/**
 * @param {string} state
 * @param {HTMLElement} first
 * @param {(verb: keyof typeof VERBS) => void} ask
 */
function buttons(state, first, ask) {
  if (state === "done" || state === "cancelled") return [];
  const verb = state === "paused" ? "resume" : "pause";
  return [first, button(verb, VERBS[verb][0], () => ask(verb)), button("cancel", "Cancel", () => ask("cancel"))];
}

/**
 * @param {string} does
 * @param {string} words
 * @param {() => void} press
 */
function button(does, words, press) {
  return el("button", { type: "button", "data-does": does, onclick: press }, words);
}

/**
 * @param {keyof typeof VERBS} verb
 * @param {string} path of what it is done to
 * @param {string} question
 * @param {string} words
 * @param {string} answer
 * @param {() => Promise<void>} onChanged
 */
function askVerb(verb, path, question, words, answer, onChanged) {
  const act = async () => {
    await post(`${path}/${verb}`);
    await onChanged();
  };
  confirm(question, [el("p", {}, words)], answer, act, { isDangerous: verb === "cancel" });
}

/**
 * Return the path of a search below the root of the API.
 * @param {number} campaign
 * @param {string} search
 */
function pathOf(campaign, search) {
  return `/campaigns/${campaign}/searches/${encodeURIComponent(search)}`;
}

/**
 * @param {JobView} job
 * @param {() => Promise<void>} onChanged
 */
export function askRequeue(job, onChanged) {
  const words = "It gets another attempt, and its failures are forgotten. A job that failed with an error in the program fails again, unless the code has changed.";
  confirm(`Requeue job ${job.id}?`, [el("p", {}, words)], "Requeue the job", async () => {
    await post(`/jobs/${job.id}/requeue`);
    await onChanged();
  });
}

/**
 * @param {CampaignView} campaign
 * @param {() => Promise<void>} onChanged
 */
function askPriority(campaign, onChanged) {
  const words = [
    el("p", {}, "Campaigns with a lower number go first; the default is 0."),
    field("priority", "Priority", campaign.priority, { step: 1, min: -1_000_000, max: 1_000_000 }),
  ];
  confirm(`Change the priority of “${campaign.name}”?`, words, "Change the priority", async (form) => {
    await post(`/campaigns/${campaign.id}/priority`, { priority: valueOf(form, "priority") });
    await onChanged();
  });
}

/**
 * Ask for a new weight and priority of a search.
 * @param {number} campaign
 * @param {Pick<SearchView, "name" | "weight" | "priority">} search
 * @param {() => Promise<void>} onChanged
 */
export function askWeight(campaign, search, onChanged) {
  const words = [
    el("p", {}, "Among searches of equal priority, one of weight 2 gets twice the CPU time of one of weight 1. Lower priorities go first."),
    field("weight", "Weight", search.weight, { step: "any", min: 0.001, max: 1_000_000 }),
    field("priority", "Priority", search.priority, { step: 1, min: -1_000_000, max: 1_000_000 }),
  ];
  confirm(`Change the share of “${search.name}”?`, words, "Change the share", async (form) => {
    const path = pathOf(campaign, search.name);
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

/**
 * Return the link that exports a campaign: a link and not a request, since the file may be larger than the page's memory.
 * @param {CampaignView} campaign
 */
export function exportLink(campaign) {
  const isRunning = campaign.state === "active" || campaign.searches.some((search) => search.jobs.running > 0);
  return isRunning
    ? el("button", { type: "button", disabled: true, title: "Pause it first, and wait until its jobs have ended" }, "Export campaign")
    : el("a", { class: "button", href: address(`/campaigns/${campaign.id}/export`), title: "One file for another installation, with the campaigns that seed it" }, "Export campaign");
}

/** Ask for the file of a campaign, send it, and go to the campaign. */
export function askImport() {
  const file = /** @type {HTMLInputElement} */ (el("input", { id: "portable", type: "file", accept: ".zip,application/zip", required: true }));
  const words = [
    el("p", {}, "A file that “Export campaign” or ", el("code", {}, "coastarc campaigns export"), " has made. It is imported whole or not at all; what is here already does not change."),
    el("p", { class: "field" }, el("label", { for: "portable" }, "File"), file),
  ];
  confirm("Import a campaign?", words, "Import the campaign", async () => {
    const [chosen] = file.files ?? [];
    if (!chosen) throw new ApiError(0, "Choose a file first.");
    /** @type {ImportView} */
    const { campaign_id } = await upload("/campaigns/import", chosen, "application/zip");
    window.location.assign(`/campaigns/${campaign_id}`);
  });
}
