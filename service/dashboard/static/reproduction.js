/** How to find a solution again, and what of it can be taken away. */

import { address } from "./api.js";
import { el, fill } from "./dom.js";
import { shortId } from "./format.js";

/** For so long a button says that it has copied [ms]. */
const THANKS_MS = 2000;

/**
 * @param {HTMLElement} place
 * @param {{ host: string, code_version: string }} record
 * @param {string} command
 */
export function showReproduction(place, record, command) {
  const full = `${command} --url ${window.location.origin}`;
  const text = el("code", { id: "command" }, full);
  const button = el("button", { type: "button", onclick: () => copy(button, text, full) }, "Copy");
  fill(
    place,
    el("div", { class: "command" }, el("pre", { tabindex: 0, "aria-label": "Command" }, text), button),
    el(
      "p",
      { class: "muted caption" },
      "Runs the very job again: the same problem, seed, laws, settings and random key. It says whether every bit of the vector is the same, " +
        `and which code, packages, kernels or host differ. Found with ${record.code_version} on ${record.host}.`,
    ),
  );
}

/**
 * @param {HTMLElement} button
 * @param {HTMLElement} text
 * @param {string} words
 */
async function copy(button, text, words) {
  try {
    await navigator.clipboard.writeText(words);
    button.textContent = "Copied";
  } catch {
    // Without https a browser lets only people copy.
    window.getSelection()?.selectAllChildren(text);
    button.textContent = "Press Ctrl C";
  }
  window.setTimeout(() => (button.textContent = "Copy"), THANKS_MS);
}

/**
 * @param {HTMLElement} place
 * @param {{ id: string, certificate_hash: string | null }} record
 */
export function showDownloads(place, record) {
  const own = `/solutions/${record.id}`;
  const name = `coastarc-${shortId(record.id)}`;
  /** @type {[string, string, string, string][]} */
  const files = [
    ["Record", "JSON", address(own), `${name}.json`],
    ["States and controls", "CSV", address(`${own}/export`, { format: "csv" }), `${name}-all.csv`],
    ["States and controls", "NDJSON", address(`${own}/export`, { format: "ndjson" }), `${name}-all.ndjson`],
    ["Trajectories", "SPICE SPK", address(`${own}/export`, { format: "spk" }), `${name}-all.bsp`],
    ["Trajectories", "CCSDS OEM, one each in a ZIP", address(`${own}/export`, { format: "oem" }), `${name}-all.zip`],
    ["Decision vector", "CSV", address(`${own}/export`, { format: "csv", what: "vector" }), `${name}-vector.csv`],
  ];
  if (record.certificate_hash) files.push(["Certificate", "JSON", address(`${own}/certificate`), `${name}-certificate.json`]);
  fill(
    place,
    files.map(([words, kind, href, download]) => el("li", {}, el("a", { href, download }, words), el("span", { class: "muted" }, ` ${kind}`))),
  );
}
