/** All solves of a search as marks: a row for each chain or seed, a column for each hop or case. */

import { el, fill, svg } from "./dom.js";
import { SvgFigure } from "./figures.js";
import { number, small } from "./format.js";
import { colourOf, isFeasible, OUTCOMES } from "./looks.js";
import { outcomeOf, roleOf } from "./solves.js";
import { colour } from "./theme.js";

/**
 * @import { Child } from "./dom.js"
 * @import { Outcome } from "./looks.js"
 * @import { Solve } from "./solves.js"
 */

/** @typedef {{ label: string, cells: { column: number, solve: Solve }[] }} Row */
/** @typedef {{ rows: Row[], heads: string[], about: string }} Sheet  `heads` are those of the columns, "" where one is left out */

/** Least and greatest width of a cell [px]. */
const CELLS_PX = [11, 26];
const LABEL_PX = 46;
/** Width of a label with a seed's hash [px]. */
const SEED_PX = 72;
const HEAD_PX = 16;
/** Rows of a block before the next one begins beside it. */
const BLOCK_ROWS = 6;

export class HopGrid {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "Hops of each chain");
    this.figure.plot.classList.add("hops");
    this.readout = el("p", { class: "muted readout", "aria-live": "polite" });
    this.figure.plot.after(this.readout);
    /** @type {Map<string, Solve>} */
    this.solves = new Map();
    for (const kind of ["pointerover", "focusin"]) this.figure.plot.addEventListener(kind, (event) => this.describe(event));
    this.figure.plot.addEventListener("keydown", (event) => this.move(event));
  }

  /**
   * @param {Solve[]} solves in order
   * @param {{ isMapped: boolean, hops: number }} search
   * @param {string} caption
   */
  show(solves, search, caption) {
    this.figure.heading.textContent = search.isMapped ? "Outcome of each seed" : search.hops > 1 ? "Hops of each chain" : "Solves, in order of their chains";
    this.solves = new Map(solves.map((solve) => [String(solve.id), solve]));
    const sheet = sheetOf(solves, search);
    this.figure.show((width) => chart(sheet, width), `${caption}${sheet.about}`);
    if (!this.readout.textContent) fill(this.readout, "Hover over a mark, or move to it with the arrow keys, for its numbers; click it to open its solution.");
    this.figure.plot.querySelector("[data-solve]")?.setAttribute("tabindex", "0");
  }

  redraw() {
    this.figure.draw();
  }

  /** @param {Event} event */
  describe(event) {
    const cell = /** @type {Element} */ (event.target).closest("[data-solve]");
    const solve = cell && this.solves.get(cell.getAttribute("data-solve") ?? "");
    if (solve) fill(this.readout, ...words(solve));
  }

  /** @param {KeyboardEvent} event */
  move(event) {
    const steps = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 });
    const step = steps[event.key];
    const all = [...this.figure.plot.querySelectorAll("[data-solve]")];
    const here = all.indexOf(/** @type {Element} */ (document.activeElement));
    const next = /** @type {SVGElement | undefined} */ (all[here + (step ?? 0)]);
    if (here < 0 || !step || !next) return;
    all[here].setAttribute("tabindex", "-1");
    next.setAttribute("tabindex", "0");
    next.focus();
    event.preventDefault();
  }
}

/**
 * @param {Solve} solve
 * @returns {Child[]}
 */
function words(solve) {
  const outcome = OUTCOMES.find(({ key }) => key === outcomeOf(solve))?.words ?? "";
  const where = solve.seed ? `Seed ${solve.seed.slice(0, 8)}, mapped “${solve.mapping}”` : `Chain ${solve.chain + 1}, hop ${solve.hop + 1}, ${ROLES[roleOf(solve)]}`;
  const facts = [
    `case ${solve.case + 1}`,
    `${outcome} (${solve.status.toLowerCase().replaceAll("_", " ")})`,
    solve.delta_v_km_s === null ? "" : `Δv ${number(solve.delta_v_km_s, 4, "km/s")}`,
    solve.violation === null ? "violation not finite" : `violation ${small(solve.violation)}`,
    solve.width === null ? "" : `width ${small(solve.width)}`,
    number(solve.n_iterations, 0, "iterations"),
    number(solve.cpu_seconds, 1, "s of CPU"),
  ];
  return [el("strong", {}, where), `: ${facts.filter(Boolean).join(", ")}`];
}

/**
 * @param {Solve[]} solves
 * @param {{ isMapped: boolean, hops: number }} search
 * @returns {Sheet}
 */
function sheetOf(solves, { isMapped, hops }) {
  const pairs = [...new Set(solves.map((solve) => `${solve.case}/${solve.mapping}`))];
  // A single column is wrapped into several.
  if (isMapped ? pairs.length === 1 : hops === 1) {
    return { rows: [{ label: "", cells: solves.map((solve, column) => ({ column, solve })) }], heads: [], about: isMapped ? "One mark for each seed." : "One mark for each chain: this search does not hop." };
  }
  const columns = new Map(pairs.map((pair, place) => [pair, place]));
  const isManyCases = new Set(solves.map((solve) => solve.case)).size > 1;
  /** @type {Map<string, Row>} */
  const rows = new Map();
  for (const solve of solves) {
    const name = isManyCases ? `${solve.case + 1} · ${solve.chain + 1}` : String(solve.chain + 1);
    const key = solve.seed ?? `${solve.case}/${solve.chain}`;
    const row = rows.get(key) ?? { label: solve.seed ? solve.seed.slice(0, 8) : name, cells: [] };
    row.cells.push({ column: isMapped ? (columns.get(`${solve.case}/${solve.mapping}`) ?? 0) : solve.hop, solve });
    rows.set(key, row);
  }
  const mappings = new Set(solves.map((solve) => solve.mapping)).size;
  const cases = pairs.map((pair, place) => (place === 0 || pair.split("/")[0] !== pairs[place - 1].split("/")[0] ? String(Number(pair.split("/")[0]) + 1) : ""));
  const about = isMapped
    ? `A row for each seed, a column for each case${mappings > 1 ? " and mapping" : ""}; the numbers are those of the cases below.`
    : `A row for each chain${isManyCases ? " (case · chain)" : ""}, a column for each hop.`;
  return { rows: [...rows.values()], heads: isMapped ? cases : Array.from({ length: hops }, (_, hop) => String(hop + 1)), about };
}

/**
 * @param {Sheet} sheet
 * @param {number} width
 */
function chart({ rows, heads }, width) {
  const longest = rows.reduce((most, { label }) => Math.max(most, label.length), 0);
  const room = longest === 0 ? 6 : longest > 6 ? SEED_PX : LABEL_PX;
  const widest = 1 + rows.reduce((most, { cells }) => Math.max(most, cells.reduce((end, { column }) => Math.max(end, column), 0)), 0);
  const cell = Math.min(CELLS_PX[1], Math.max(CELLS_PX[0], (width - room) / widest));
  const fitting = Math.max(1, Math.floor((width - room) / cell));
  const lines = rows.flatMap((row) => folded(row, fitting));
  const across = room + Math.min(widest, fitting) * cell + 14;
  const n_blocks = Math.max(1, Math.min(Math.floor((width + 14) / across), Math.ceil(lines.length / BLOCK_ROWS)));
  const per_block = Math.ceil(lines.length / n_blocks);
  const solves = rows.flatMap(({ cells }) => cells.map(({ solve }) => solve));
  const key = legend(new Set(solves.map(roleOf)), new Set(solves.map(outcomeOf)), width);
  const top = key.height + 4 + (heads.length && widest <= fitting ? HEAD_PX : 0);
  const content = lines.flatMap((line, i) => {
    const left = Math.floor(i / per_block) * across;
    const y = top + ((i % per_block) + 0.5) * cell;
    const head = i % per_block === 0 && widest <= fitting ? headsOf(heads.slice(0, widest), left + room, top, cell) : [];
    const label = svg("text", { x: left + room - 8, y: y + 4, "text-anchor": "end", "font-size": 11, fill: colour("muted") }, line.label);
    return [...head, label, ...line.cells.map(({ column, solve }) => shown(solve, left + room + (column + 0.5) * cell, y, 0.36 * cell))];
  });
  return { height: top + 6 + per_block * cell, content: [...key.content, ...content] };
}

/**
 * Return the numbers above the columns, as many as there is room for.
 * @param {string[]} heads
 * @param {number} left
 * @param {number} bottom
 * @param {number} cell
 */
function headsOf(heads, left, bottom, cell) {
  const step = cell < 18 ? 5 : 1;
  const isKept = (/** @type {number} */ i) => step === 1 || i === 0 || (i + 1) % step === 0;
  return heads.flatMap((head, i) =>
    head && isKept(i) ? [svg("text", { x: left + (i + 0.5) * cell, y: bottom - 4, "text-anchor": "middle", "font-size": 10, fill: colour("muted") }, head)] : [],
  );
}

/**
 * Return a row in as many lines as it needs.
 * @param {Row} row
 * @param {number} fitting
 * @returns {Row[]}
 */
function folded({ label, cells }, fitting) {
  /** @type {Row[]} */
  const lines = [];
  for (const { column, solve } of cells) {
    const line = Math.floor(column / fitting);
    lines[line] ??= { label: line === 0 ? label : "", cells: [] };
    lines[line].cells.push({ column: column % fitting, solve });
  }
  return lines.filter(Boolean);
}

/**
 * @param {Solve} solve
 * @param {number} x
 * @param {number} y
 * @param {number} r
 */
function shown(solve, x, y, r) {
  const outcome = outcomeOf(solve);
  const drawn = mark(roleOf(solve), { paint: colourOf(outcome), isFilled: isFeasible(outcome) }, x, y, r);
  // A mark is easier to hit with the whole of its cell.
  const room = svg("rect", { x: x - 1.35 * r, y: y - 1.35 * r, width: 2.7 * r, height: 2.7 * r, fill: "transparent" });
  const href = solve.solution_id && `/solutions/${solve.solution_id}`;
  return svg(href ? "a" : "g", { href, "data-solve": solve.id, tabindex: -1, role: href ? null : "img", "aria-label": `${ROLES[roleOf(solve)]}, ${outcome}` }, room, drawn);
}

/** @typedef {"start" | "accepted" | "rejected" | "restarted" | "mapped"} Role */

/** Names of the roles in legends. */
export const ROLES = /** @type {Record<Role, string>} */ ({
  start: "fresh start",
  accepted: "hop accepted",
  rejected: "hop rejected",
  restarted: "rejected, then restarted",
  mapped: "mapped seed",
});
/** Width of a letter of the legend [px]. */
const LETTER_PX = 6.6;
const LINE_PX = 20;

/**
 * Return a mark.
 * @param {Role} role
 * @param {{ paint: string, isFilled: boolean }} how
 * @param {number} x
 * @param {number} y
 * @param {number} r half its width
 */
export function mark(role, { paint, isFilled }, x, y, r) {
  const thin = Math.max(1.2, r * 0.28);
  const look = { fill: isFilled ? paint : "none", stroke: paint, "stroke-width": thin, "stroke-linejoin": "round" };
  if (role === "start") return svg("rect", { ...look, x: x - 0.9 * r, y: y - 0.9 * r, width: 1.8 * r, height: 1.8 * r });
  if (role === "rejected") {
    const d = 0.8 * r;
    const path = `M${x - d} ${y - d}L${x + d} ${y + d}M${x - d} ${y + d}L${x + d} ${y - d}`;
    return svg("path", { ...look, fill: "none", d: path, "stroke-width": isFilled ? r * 0.62 : thin, "stroke-linecap": "round" });
  }
  if (role === "restarted") return svg("path", { ...look, d: `M${x - r} ${y - 0.8 * r}L${x + r} ${y - 0.8 * r}L${x} ${y + r}Z` });
  return svg("circle", { ...look, cx: x, cy: y, r });
}

/**
 * Return a legend of the roles and outcomes that occur, and its height.
 * @param {Set<Role>} roles
 * @param {Set<Outcome>} outcomes
 * @param {number} width
 */
export function legend(roles, outcomes, width) {
  const plain = { paint: colour("muted"), isFilled: true };
  /** @type {[Role, { paint: string, isFilled: boolean }, string][]} */
  const entries = [];
  for (const role of /** @type {Role[]} */ (Object.keys(ROLES))) if (roles.has(role) && roles.size > 1) entries.push([role, plain, ROLES[role]]);
  for (const { key, words } of OUTCOMES) {
    if (outcomes.has(key)) entries.push(["mapped", { paint: colourOf(key), isFilled: isFeasible(key) }, words]);
  }
  /** @type {SVGElement[]} */
  const content = [];
  let [x, y] = [8, 10];
  for (const [role, how, words] of entries) {
    const room = 30 + words.length * LETTER_PX;
    if (x > 8 && x + room > width) [x, y] = [8, y + LINE_PX];
    content.push(mark(role, how, x, y, 5), svg("text", { x: x + 11, y: y + 4, fill: colour("muted") }, words));
    x += room;
  }
  return { content, height: y + LINE_PX };
}
