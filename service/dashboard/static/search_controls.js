/** How a search is steered; each change is asked about first. */

import { post } from "./api.js";
import { askWeight } from "./campaign.js";
import { confirm } from "./dialog.js";
import { el } from "./dom.js";

/** What each verb does, said before it is done. */
const VERBS = {
  pause: ["Pause", "Jobs that run finish; no more are handed out until it is resumed. Other searches go on."],
  resume: ["Resume", "Its jobs are handed out again."],
  cancel: ["Cancel", "It ends for good: running jobs are stopped, waiting ones are dropped. All results are kept, and searches that take its seeds go on with what it has found."],
};

/**
 * Return the buttons that steer a search, as far as its state admits.
 * @param {import("./views/search.js").Detail} search
 * @param {() => Promise<void>} onChanged
 */
export function searchControls(search, onChanged) {
  if (["done", "cancelled"].includes(search.state)) return [];
  const verb = search.state === "paused" ? "resume" : "pause";
  const share = () => askWeight(/** @type {any} */ ({ id: search.campaign_id }), /** @type {any} */ (search), onChanged);
  return [
    el("button", { type: "button", "data-does": "share", onclick: share }, "Weight and priority"),
    ...[verb, "cancel"].map((name) => {
      const does = /** @type {keyof typeof VERBS} */ (name);
      return el("button", { type: "button", "data-does": name, onclick: () => ask(search, does, onChanged) }, VERBS[does][0]);
    }),
  ];
}

/**
 * @param {import("./views/search.js").Detail} search
 * @param {keyof typeof VERBS} verb
 * @param {() => Promise<void>} onChanged
 */
function ask(search, verb, onChanged) {
  const [word, words] = VERBS[verb];
  const act = async () => {
    await post(`/campaigns/${search.campaign_id}/searches/${encodeURIComponent(search.name)}/${verb}`);
    await onChanged();
  };
  confirm(`${word} search “${search.name}”?`, [el("p", {}, words)], `${word} the search`, act, { isDangerous: verb === "cancel" });
}
