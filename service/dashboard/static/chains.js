/** The matrix k' -> k: what seeds of one problem gave for another, shaded by yield. */

import { el, fill } from "./dom.js";
import { NONE, number, percent } from "./format.js";

/**
 * @typedef {{
 *   seed_k: number | null, k: number, n_seeds: number, n_solves: number, n_strict: number,
 *   strict_ratio: { value: number | null, low: number, high: number }, core_seconds_per_strict: number | null,
 * }} Chain
 */

/**
 * @param {HTMLElement} place
 * @param {Chain[]} chains
 */
export function showChains(place, chains) {
  if (chains.length === 0) {
    fill(place, el("p", { class: "empty" }, "No guess has been solved yet; the matrix fills as solves come in."));
    return;
  }
  const columns = [...new Set(chains.map(({ k }) => k))].sort((a, b) => a - b);
  const rows = [...new Set(chains.map(({ seed_k }) => seed_k))].sort((a, b) => (a ?? -1) - (b ?? -1));
  const cellOf = (/** @type {number | null} */ seedK, /** @type {number} */ k) => chains.find((one) => one.seed_k === seedK && one.k === k);
  fill(
    place,
    el(
      "table",
      { class: "chains" },
      el("caption", { class: "visually-hidden" }, "Yield of strict solutions by number of outages of seed and of problem"),
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Guesses from"), columns.map((k) => el("th", { scope: "col" }, `for k = ${k}`)))),
      el("tbody", {}, rows.map((seedK) => el("tr", {}, el("th", { scope: "row" }, seedK === null ? "drawn" : `seeds of k′ = ${seedK}`), columns.map((k) => cell(cellOf(seedK, k)))))),
    ),
  );
}

/** @param {Chain | undefined} chain */
function cell(chain) {
  if (!chain) return el("td", { class: "none" }, el("span", { class: "muted" }, NONE));
  const share = chain.strict_ratio.value ?? 0;
  const used = chain.seed_k === null ? `${number(chain.n_solves, 0)} drawn` : `${number(chain.n_seeds, 0)} seeds, ${number(chain.n_solves, 0)} solves`;
  const cost = chain.core_seconds_per_strict;
  const title = `95 % interval ${percent(chain.strict_ratio.low)} to ${percent(chain.strict_ratio.high)}`;
  return el(
    "td",
    { style: `--shade:${Math.round(45 * share)}%`, "data-chain": `${chain.seed_k ?? "drawn"}-${chain.k}`, title },
    el("strong", {}, percent(share)),
    el("span", {}, used),
    el("span", {}, cost === null ? "no solution yet" : `${number(cost, cost < 100 ? 1 : 0, "core-s")} a solution`),
  );
}
