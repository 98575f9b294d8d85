/** A new campaign: its specification is written or uploaded, checked while typing, and submitted. */

import { ApiError, get, post } from "../api.js";
import { byId, el, fill } from "../dom.js";
import { duration, NONE, number } from "../format.js";
import { facts, Page, parameter, showEmpty, showTitle } from "../page.js";

/** @import { CampaignView, FaultView, SpecCheck, SpecPlan, SpecTemplates, SpecText } from "../../types" */

/** As in style.css [px]. */
const LINE = 20;

export class Editor {
  /** @param {(text: string) => void} onChange */
  constructor(onChange) {
    this.area = /** @type {HTMLTextAreaElement} */ (byId("spec"));
    /** @type {FaultView[]} */
    this.faults = [];
    this.area.addEventListener("input", () => {
      this.draw();
      onChange(this.area.value);
    });
    this.area.addEventListener("scroll", () => this.scroll());
    this.draw();
  }

  get text() {
    return this.area.value;
  }

  /** @param {string} text */
  write(text) {
    this.area.value = text;
    this.area.scrollTop = 0;
    this.draw();
  }

  /** @param {FaultView[]} faults */
  mark(faults) {
    this.faults = faults;
    this.area.setAttribute("aria-invalid", String(faults.length > 0));
    this.draw();
  }

  /**
   * Put the caret on a line.
   * @param {number} line from 1
   */
  goTo(line) {
    const begin = this.area.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    const end = this.area.value.indexOf("\n", begin);
    this.area.focus();
    this.area.setSelectionRange(begin, end < 0 ? this.area.value.length : end);
    this.area.scrollTop = Math.max(0, (line - 6) * LINE);
  }

  draw() {
    const lines = this.area.value.split("\n");
    const wrong = new Map(this.faults.filter(({ line }) => line !== null).map((fault) => [fault.line, fault.message]));
    fill(byId("gutter"), lines.map((_, i) => el("span", { class: wrong.has(i + 1) ? "wrong" : null }, i + 1)));
    fill(
      byId("marks"),
      [...wrong].map(([line, message]) => {
        const top = ((line ?? 1) - 1) * LINE;
        // The message stands behind what is written on its line.
        const written = lines[(line ?? 1) - 1]?.length ?? 0;
        return el("p", { class: "mark", "data-line": line, style: `top:${top}px;padding-left:calc(${written + 3}ch + 10px)` }, message);
      }),
    );
    this.scroll();
  }

  scroll() {
    byId("gutter").style.transform = `translateY(${-this.area.scrollTop}px)`;
    byId("marks").style.transform = `translate(${-this.area.scrollLeft}px, ${-this.area.scrollTop}px)`;
  }
}

/** A check begins this long after the last key [ms]. */
const QUIET_MS = 350;
const OWN = "own";

const editor = new Editor(later);
/** @type {Map<string, string>} */
const texts = new Map();
/** @type {object | null} */
let fields = null;
/** One key for each text that was checked: sent twice, it is one campaign. */
let key = "";
let nCheck = 0;
/** @type {number | undefined} */
let pending;

new Page({ events: null, refresh: start }).start();

async function start() {
  showTitle("New campaign", [["Campaigns", "/"]]);
  /** @type {SpecTemplates} */
  const { items } = await get("/specs/templates");
  for (const { name, toml } of items) texts.set(name, toml);
  const clone = parameter("clone");
  if (clone !== null && !(await readClone(clone))) return;
  offer(clone);
  byId("template").addEventListener("change", () => begin(/** @type {HTMLSelectElement} */ (byId("template")).value));
  byId("file").addEventListener("change", upload);
  byId("form").addEventListener("submit", submit);
  byId("spec").addEventListener("keydown", keys);
  begin(clone === null ? items[0].name : OWN);
}

/** @param {string} clone */
async function readClone(clone) {
  try {
    /** @type {SpecText} */
    const { toml, name } = await get(`/campaigns/${encodeURIComponent(clone)}/spec`);
    texts.set(OWN, `# A copy of campaign ${clone}, “${name}”. The same rng_seed draws the same guesses.\n${renamed(toml, name)}`);
    return true;
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    showEmpty(el("p", {}, error.message), el("p", {}, el("a", { href: "/campaigns/new" }, "Start from a template")));
    return false;
  }
}

/**
 * Give a copy a name of its own: the same specification would be the same campaign.
 * @param {string} toml
 * @param {string} name
 */
function renamed(toml, name) {
  const numbered = / (\d+)$/.exec(name);
  const next = numbered ? name.slice(0, numbered.index) + ` ${Number(numbered[1]) + 1}` : `${name.slice(0, 78)} 2`;
  return toml.replace(`name = ${JSON.stringify(name)}`, `name = ${JSON.stringify(next)}`);
}

/** @param {string | null} clone */
function offer(clone) {
  const own = texts.has(OWN) ? [el("option", { value: OWN }, `campaign ${clone}`)] : [];
  const names = [...texts.keys()].filter((name) => name !== OWN);
  fill(byId("template"), own, names.map((name) => el("option", { value: name }, `${name}.toml`)));
}

/** @param {string} name */
function begin(name) {
  editor.write(texts.get(name) ?? "");
  check();
}

async function upload() {
  const input = /** @type {HTMLInputElement} */ (byId("file"));
  const file = input.files?.[0];
  if (!file) return;
  editor.write(await file.text());
  input.value = "";
  await check();
}

/** Tab inserts two spaces, as in a code editor; after Escape it moves to the next control.
 * @param {KeyboardEvent} event
 */
function keys(event) {
  if (event.key === "Escape") byId("editor").dataset.leaves = "true";
  else if (event.key === "Tab" && !event.shiftKey && byId("editor").dataset.leaves !== "true") {
    event.preventDefault();
    editor.area.setRangeText("  ", editor.area.selectionStart, editor.area.selectionEnd, "end");
    editor.area.dispatchEvent(new Event("input"));
  } else delete byId("editor").dataset.leaves;
}

function later() {
  window.clearTimeout(pending);
  allow(null);
  pending = window.setTimeout(check, QUIET_MS);
}

async function check() {
  const n = ++nCheck;
  try {
    /** @type {SpecCheck} */
    const found = await post("/specs/check", { text: editor.text });
    // The answer may be about an older text.
    if (n === nCheck) showCheck(found);
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    refuse(error.message);
  }
}

/** @param {SpecCheck} found */
function showCheck({ faults, fields: found, plan, remarks }) {
  byId("refused").hidden = true;
  byId("form").dataset.faults = String(faults.length);
  editor.mark(faults);
  allow(found);
  byId("verdict").textContent = plan ? "What will run" : faults.length === 1 ? "1 error" : `${faults.length} errors`;
  const warnings = remarks.map((remark) => el("p", { class: "notice" }, remark));
  fill(byId("said"), plan ? [...warnings, ...planned(plan)] : listed(faults));
}

/** @param {object | null} found */
function allow(found) {
  fields = found;
  key = found === null ? "" : newKey();
  byId("submit").toggleAttribute("disabled", found === null);
}

function newKey() {
  // randomUUID exists only on https and loopback.
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** @param {FaultView[]} faults */
function listed(faults) {
  return el(
    "ul",
    { class: "faults" },
    faults.map(({ path, line, message }) => {
      const where = line === null ? "whole text" : `line ${line}`;
      const place = line === null ? where : el("button", { type: "button", class: "link", onclick: () => editor.goTo(line) }, where);
      return el("li", { "data-path": path }, place, path && el("code", {}, path), el("span", {}, message));
    }),
  );
}

/** @param {SpecPlan} plan */
function planned(plan) {
  const most = (/** @type {number | null} */ n) => (n === null ? "open" : number(n, 0));
  const hours = (/** @type {number | null} */ n) => (n === null ? NONE : duration(3600 * n));
  const sums = facts([["Name", plan.name], ["rng_seed", String(plan.rng_seed)], ["Segments", number(plan.n_segments, 0)], ["Searches", number(plan.searches.length, 0)], ["Cases", number(plan.n_cases, 0)], ["Guesses, at most", most(plan.n_guesses_most)], ["CPU, at most", hours(plan.core_hours_most)]]);
  const head = [["Search", ""], ["Cases", "number"], ["Guesses", "number"], ["CPU", "number minor"], ["Seeds", "minor"]];
  const rows = plan.searches.map((one) =>
    el("tr", {}, el("th", { scope: "row" }, one.strategy, el("span", { class: "muted name" }, ` ${one.id}`)), el("td", { class: "number" }, number(one.n_cases, 0)), el("td", { class: "number" }, `${one.seeds_from && one.n_guesses_most !== null ? "≤ " : ""}${most(one.n_guesses_most)}`), el("td", { class: "number minor" }, one.core_hours_most === null ? NONE : `≤ ${hours(one.core_hours_most)}`), el("td", { class: "minor" }, one.seeds_from ?? NONE)),
  );
  const table = el("table", {}, el("caption", { class: "visually-hidden" }, "Searches"), el("thead", {}, el("tr", {}, head.map(([words, kind]) => el("th", { scope: "col", class: kind || null }, words)))), el("tbody", {}, rows));
  return [el("dl", { class: "facts" }, sums), el("div", { class: "scroll" }, table)];
}

/** @param {string} words */
function refuse(words) {
  byId("refused").hidden = false;
  byId("refused").textContent = words;
}

/** @param {Event} event */
async function submit(event) {
  event.preventDefault();
  if (fields === null) return;
  byId("submit").toggleAttribute("disabled", true);
  try {
    /** @type {CampaignView} */
    const { id } = await post("/campaigns", fields, { "Idempotency-Key": key });
    window.location.assign(`/campaigns/${id}`);
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    refuse(error.message);
    byId("submit").toggleAttribute("disabled", false);
  }
}
