/** One solution: its flight, defects, certificate and lineage, and how to reproduce it. */

import { address, find, get } from "../api.js";
import { showCertificate } from "../certificate.js";
import { DefectFigure, showDefectTable } from "../defects.js";
import { byId, el, fill } from "../dom.js";
import { dateOf } from "../flight.js";
import { FlightView } from "../flight_view.js";
import { epoch, number, outages, shortId } from "../format.js";
import { LineageFigure } from "../lineage.js";
import { tellTolerances } from "../looks.js";
import { MissedThrustFigure } from "../missed_thrust.js";
import { facts, Page, pathPart, showEmpty, showFacts, showTitle } from "../page.js";

/**
 * @import { Child } from "../dom.js"
 * @import { CertificateDocument, EventView, LineageGraph, MissedThrustPage, ProblemView, RecordInFull, WorldView } from "../../types"
 */

/** How long a button confirms that it has copied [ms]. */
const THANKS_MS = 2000;

/**
 * @param {HTMLElement} place
 * @param {RecordInFull} record
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
      "Runs the same job again: same problem, seed, laws, settings and random key. It reports whether the decision vector is identical bit by bit, " +
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
    // Without https, browsers refuse to copy by script.
    window.getSelection()?.selectAllChildren(text);
    button.textContent = "Press Ctrl C";
  }
  window.setTimeout(() => (button.textContent = "Copy"), THANKS_MS);
}

/**
 * @param {HTMLElement} place
 * @param {RecordInFull} record
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

const id = pathPart(1);
const flight = new FlightView();
const lineage = new LineageFigure(byId("lineage"));
const defects = new DefectFigure(byId("defect-figure"));
const outagesTaken = new MissedThrustFigure(byId("missed-thrust"));
/** @type {RecordInFull} */
let record;
/** @type {Promise<void>} */
let flying = Promise.resolve();

/**
 * @param {EventView[]} events
 * @param {boolean} isAll
 */
async function refresh(events, isAll) {
  if (!record) {
    /** @type {RecordInFull | null} */
    const found = await find(`/solutions/${id}`);
    if (!found) return showEmpty(...unknown());
    /** @type {[ProblemView, LineageGraph, MissedThrustPage]} */
    const [problem, known, analyses] = await Promise.all([
      get(`/problems/${found.problem_hash}`),
      get(`/solutions/${id}/lineage`),
      get(`/solutions/${id}/missed-thrust`),
    ]);
    record = found;
    showRecord(problem.world);
    lineage.show(known);
    showReproduction(byId("reproduction"), record, known.command);
    /** @type {CertificateDocument | null} */
    const certificate = record.certificate_hash ? await find(`/solutions/${id}/certificate`) : null;
    showCertificate(byId("certificate"), certificate, id);
    outagesTaken.show(analyses.items[0]);
    performance.mark("solution-shown");
    // Propagating it takes seconds on a slow machine; the rest of the page does not wait for it.
    flying = flight.load(id, (day) => dateOf(record, day));
  } else if (isAll || events.some(({ kind }) => kind === "solution")) {
    lineage.show(await get(`/solutions/${id}/lineage`));
  }
}

function unknown() {
  return [
    el("h2", {}, "No such solution"),
    el("p", {}, "No solution of this archive has the id ", el("code", {}, id), ". All solutions are listed in the ", el("a", { href: "/archive" }, "archive"), "."),
  ];
}

/** @param {WorldView} world */
function showRecord(world) {
  const { strategy } = record;
  showTitle(`${strategy}, ${outages(record.outages)}`, [["Archive", "/archive"], [`Campaign ${record.campaign_id}`, `/campaigns/${record.campaign_id}`]]);
  fill(byId("verdict"), ...verdict());
  tellTolerances(world);
  showFacts([
    ["Δv of the transfer", number(record.delta_v_km_s, 4, "km/s")],
    ["Δv with the spiral", number(record.delta_v_total_km_s, 4, "km/s")],
    ["Propellant", number(record.propellant_kg, 1, "kg")],
    ["Final mass", number(record.objective_kg, 1, "kg")],
    ["Time of flight", number(record.time_of_flight_days, 2, "d")],
    ["Coast, thrust, coast", `${[record.initial_coast_days, record.shooting_days, record.final_coast_days].map((d) => number(d, 1)).join(" + ")}\u00a0d`],
    lowest(world),
    ["Insertion", epoch(record.insertion_epoch)],
    ["Arrival", epoch(record.arrival_epoch)],
  ]);
  fill(byId("origin"), facts(origin()));
  showDefectTable(byId("defect-table"), record, world);
  defects.show(record, world);
  showDownloads(byId("downloads"), record);
}

function verdict() {
  const [kind, level] = record.strict ? ["strict", "strict"] : record.paper ? ["paper", "loose only"] : ["none", "not verified"];
  const words = record.is_marginal ? `${level}, marginal` : level;
  return [el("span", { class: "pill", "data-verdict": kind }, words), el("code", { id: "solution-id", title: record.id }, shortId(record.id))];
}

/**
 * @param {WorldView} world
 * @returns {[string, string]}
 */
function lowest({ center, bodies }) {
  // Solutions of earlier versions have no altitudes.
  const known = /** @type {Record<string, number> | undefined} */ (record.verification.lowest_km);
  const names = known ? Object.keys(known) : [center, ...bodies.slice(0, 1)];
  return [`Lowest above ${names.join(", ")}`, names.map((name) => (known ? number(known[name], 0, "km") : "–")).join(", ")];
}

/** @returns {[string, Child][]} */
function origin() {
  const search = `/campaigns/${record.campaign_id}/searches/${encodeURIComponent(record.search)}`;
  return [
    ["Problem", el("a", { href: `/problems/${record.problem_hash}` }, `P${subscript(record.k)} ${shortId(record.problem_hash)}`)],
    ["Search", el("a", { href: search }, record.search)],
    ["Seed", record.seed_id ? el("a", { href: `/solutions/${record.seed_id}` }, shortId(record.seed_id)) : "none: drawn at random"],
    ["Mapping", record.mapping ?? "–"],
    ["Solver", record.status.toLowerCase().replaceAll("_", " ")],
    ["Iterations", number(record.n_iterations, 0)],
    ["Evaluations", number(record.n_evaluations, 0)],
    ["CPU time", number(record.cpu_seconds, 1, "s")],
    ["Verifier", String(record.verification.integrator ?? "–").replace("scipy.integrate.", "SciPy, ")],
    ["Random key", el("code", {}, record.rng_key)],
    ["Code", el("code", {}, record.code_version)],
    ["Host", record.host],
  ];
}

/** @param {number} k */
function subscript(k) {
  return String(k).replace(/\d/g, (digit) => "₀₁₂₃₄₅₆₇₈₉"[Number(digit)]);
}

function redraw() {
  lineage.figure.draw();
  defects.figure.draw();
  outagesTaken.draw();
  flying = flying.then(() => flight.draw());
}

new Page({ events: "/events/stream", refresh, redraw }).start();
