// @ts-check
/** The chosen solution in numbers: times, masses, origin, and its defects as solved and as verified. */

import { byId, el, fill } from "./dom.js";
import { epoch, number, outages, shortId, small } from "./format.js";

/** @typedef {import("./api.js").Record_} Record_ */

/** Tolerances of docs/method.md: position [km], velocity [km/s], mass [kg]. */
const STRICT = [0.1, 1e-4, 0.01];
const PAPER = [1, 0.1, 1];
const UNITS = ["km", "km/s", "kg"];
/** Of the columns of the table of defects. */
const HEAD_CLASSES = [null, null, "number", "number", "number minor", "number minor"];

/**
 * @param {Record_} record
 * @param {(id: string) => void} onSeed
 */
export function showRecord(record, onSeed) {
  byId("chosen-what").textContent = `${record.strategy}, ${outages(record.outages)}`;
  byId("record").hidden = false;
  fill(
    byId("record"),
    el("h2", {}, "Solution ", el("code", {}, shortId(record.id)), " ", verdict(record)),
    facts(record, onSeed),
    el("h3", {}, "Defects at the matchpoints"),
    defects(record),
    el("p", { class: "muted caption" }, "Norms of forward minus backward state. Solved: compiled DOP853. Verified: flown again by SciPy and SPICE."),
    el("p", { class: "muted caption" }, "In the terminal: ", el("code", {}, `coastarc solutions show ${record.id}`)),
  );
}

/** @param {Record_} record */
function verdict(record) {
  const [kind, words] = record.strict ? ["strict", "strict"] : record.paper ? ["paper", "paper only"] : ["none", "not verified"];
  return el("span", { class: "pill", "data-verdict": kind }, words);
}

/**
 * @param {Record_} record
 * @param {(id: string) => void} onSeed
 */
function facts(record, onSeed) {
  const seed = record.seed_id;
  /** @type {[string, import("./dom.js").Child][]} */
  const all = [
    ["Δv of the transfer", number(record.delta_v_km_s, 4, "km/s")],
    ["Δv with the spiral", number(record.delta_v_total_km_s, 4, "km/s")],
    ["Propellant", number(record.propellant_kg, 1, "kg")],
    ["Final mass", number(record.objective_kg, 1, "kg")],
    ["Coast, thrust, coast", [record.initial_coast_days, record.shooting_days, record.final_coast_days].map((d) => number(d, 1)).join(" + ") + "\u00a0d"],
    ["Insertion", epoch(record.insertion_epoch)],
    ["Arrival", epoch(record.arrival_epoch)],
    ["Solved in", `${number(record.cpu_seconds, 1, "CPU s")}, ${number(record.n_iterations, 0)} iterations`],
    ["Solver", record.status.toLowerCase().replaceAll("_", " ")],
    ["Seed", seed ? el("button", { type: "button", class: "link", onclick: () => onSeed(seed) }, shortId(seed)) : "none: drawn at random"],
  ];
  return el(
    "dl",
    { class: "facts wide" },
    all.map(([name, value]) => el("div", { class: "fact" }, el("dt", {}, name), el("dd", {}, value))),
  );
}

/** @param {Record_} record */
function defects(record) {
  const names = ["reference", ...record.outages.map((_, i) => `realization ${i + 1}`)];
  const head = ["Trajectory", "Part", "Solved", "Verified", "Strict", "Paper"];
  const rows = names.flatMap((name, i) => {
    const solved = norms(record.defects_solved[i]);
    const verified = norms(record.defects_verified[i]);
    return ["position", "velocity", "mass"].map((part, j) =>
      el(
        "tr",
        {},
        j === 0 && el("th", { scope: "rowgroup", rowspan: 3 }, name),
        el("td", {}, part),
        el("td", { class: "number" }, small(solved[j], UNITS[j])),
        el("td", { class: "number", "data-within": within(verified[j], j) }, small(verified[j], UNITS[j])),
        el("td", { class: "number muted minor" }, `≤ ${small(STRICT[j])}`),
        el("td", { class: "number muted minor" }, `≤ ${small(PAPER[j])}`),
      ),
    );
  });
  return el(
    "div",
    { class: "scroll" },
    el(
      "table",
      { class: "defects" },
      el("thead", {}, el("tr", {}, head.map((words, i) => el("th", { scope: "col", class: HEAD_CLASSES[i] }, words)))),
      el("tbody", {}, rows),
    ),
  );
}

/**
 * Return the norms of position, velocity and mass; NaN where a defect is not finite.
 * @param {(number | null)[]} row
 */
function norms(row) {
  const finite = row.map((value) => value ?? NaN);
  return [Math.hypot(...finite.slice(0, 3)), Math.hypot(...finite.slice(3, 6)), Math.abs(finite[6])];
}

/**
 * @param {number} value
 * @param {number} part
 */
function within(value, part) {
  if (value <= STRICT[part]) return "strict";
  return value <= PAPER[part] ? "paper" : "none";
}
