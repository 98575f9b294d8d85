/** A campaign as a file: taken away from its page, and brought to the list of all. */

import { address, ApiError, upload } from "./api.js";
import { confirm } from "./dialog.js";
import { el } from "./dom.js";

/**
 * Return what takes a campaign away.  A link and no request of ours: the file may be larger than a page's memory.
 * @param {import("./campaign.js").Campaign} campaign
 */
export function exportLink(campaign) {
  const isAtWork = campaign.state === "active" || campaign.searches.some((search) => search.jobs.running > 0);
  return isAtWork
    ? el("button", { type: "button", disabled: true, title: "Pause it first, and wait until its jobs have ended" }, "Export campaign")
    : el("a", { class: "button", href: address(`/campaigns/${campaign.id}/export`), title: "One file for another installation, with the campaigns that seed it" }, "Export campaign");
}

/** Ask for the file of a campaign, send it, and go to the campaign. */
export function askImport() {
  const file = /** @type {HTMLInputElement} */ (el("input", { id: "portable", type: "file", accept: ".zip,application/zip", required: true }));
  const words = [
    el("p", {}, "A file that “Export campaign” or ", el("code", {}, "coastarc campaigns export"), " made. All of it is taken in, or nothing; what is here already stays as it is."),
    el("p", { class: "field" }, el("label", { for: "portable" }, "File"), file),
  ];
  confirm("Import a campaign?", words, "Import the campaign", async () => {
    const [chosen] = file.files ?? [];
    if (!chosen) throw new ApiError(0, "Choose a file first.");
    const { campaign_id } = await upload("/campaigns/import", chosen, "application/zip");
    window.location.assign(`/campaigns/${campaign_id}`);
  });
}
