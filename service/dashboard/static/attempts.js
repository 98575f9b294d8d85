/** The attempts of a time window that ends now, and a chart of who worked on what. */

import { get } from "./api.js";
import { el, fill, svg } from "./dom.js";
import { sampled, SvgFigure } from "./figures.js";
import { duration } from "./format.js";
import { colour } from "./theme.js";

/** @import { AttemptPage, AttemptView } from "../types" */

/** Bars of one figure. */
const MOST = 5000;
/** How often a sample is read again [ms]. */
const DRAWN_MS = 6000;
/** Overlap of two requests: an answer may miss attempts of the last moment [ms]. */
const OVERLAP_MS = 2000;

export class Attempts {
  /** @param {number} seconds length of the window */
  constructor(seconds) {
    this.seconds = seconds;
    /** @type {Map<string, AttemptView>} */
    this.byKey = new Map();
    this.nAll = 0;
    /** The coordinator's clock at the last answer [ms]. */
    this.until = 0;
    this.drawnAt = -Infinity;
  }

  get all() {
    return [...this.byKey.values()];
  }

  get isPart() {
    return this.byKey.size < this.nAll;
  }

  /** @param {number} seconds */
  setWindow(seconds) {
    this.seconds = seconds;
    this.until = 0;
  }

  /**
   * Read what is new since the last time.
   * @param {number} now by the coordinator's clock [ms]
   */
  async refresh(now) {
    if (this.isPart && this.until > 0 && performance.now() - this.drawnAt < DRAWN_MS) return;
    const isWhole = this.isPart || this.until === 0;
    const since = new Date(isWhole ? now - 1000 * this.seconds : this.until - OVERLAP_MS).toISOString();
    /** @type {AttemptPage} */
    const answer = await get("/attempts", { since, limit: MOST });
    if (isWhole) this.byKey.clear();
    for (const one of answer.items) this.byKey.set(`${one.job_id}/${one.attempt}`, one);
    if (isWhole) [this.nAll, this.drawnAt] = [answer.n_all, performance.now()];
    this.until = Date.parse(answer.until);
    this.forget(this.until - 1000 * this.seconds);
    if (!isWhole) this.nAll = this.byKey.size;
    // Too many for one figure: from now on a sample is read.
    if (this.byKey.size > MOST) this.until = 0;
  }

  /** @param {number} moment before which nothing is shown [ms] */
  forget(moment) {
    for (const [key, { ended_at: end }] of this.byKey) {
      if (end !== null && Date.parse(end) < moment) {
        this.byKey.delete(key);
        this.nAll -= 1;
      }
    }
  }
}

/** @typedef {{ name: string, lanes: AttemptView[][] }} Group */

/** How attempts end: words and a colour of the style sheet; failed ones have an outline too. */
const ENDINGS = /** @type {Record<string, { words: string, colour: string, isFailed?: boolean }>} */ ({
  running: { words: "running", colour: "accent" },
  feasible: { words: "feasible", colour: "good" },
  infeasible: { words: "infeasible", colour: "coast" },
  timeout: { words: "timed out", colour: "series-2" },
  numerical: { words: "not finite", colour: "target" },
  error: { words: "error", colour: "outage", isFailed: true },
  crash: { words: "crash", colour: "outage", isFailed: true },
  lost: { words: "lost", colour: "series-5", isFailed: true },
  cancelled: { words: "cancelled", colour: "line-strong" },
});
const LANES_PX = [5, 18];
/** Height that the lanes may take before they get thinner [px]. */
const ALL_LANES_PX = 420;
const NAME_PX = 20;
const AXIS_PX = 24;
const LETTER_PX = 6.6;
/** Steps of the axis [s]; as many as there is room for. */
const STEPS = [60, 120, 300, 600, 1800, 3600, 7200];
const STEP_PX = 64;
/** Clocks differ by a moment between the end of an attempt and the claim of the next [ms]. */
const SLACK_MS = 50;

export class Gantt {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new SvgFigure(place, "What each worker did");
    this.figure.plot.classList.add("gantt");
    this.readout = el("p", { class: "muted readout", "aria-live": "polite" }, "Hover over a bar for details; click it to open its search.");
    this.figure.plot.after(this.readout);
    /** @type {Map<string, AttemptView>} */
    this.byKey = new Map();
    for (const kind of ["pointerover", "focusin"]) this.figure.plot.addEventListener(kind, (event) => this.describe(event));
  }

  /**
   * @param {Attempts} attempts
   * @param {number} now [ms]
   */
  show(attempts, now) {
    this.now = now;
    this.byKey = attempts.byKey;
    const groups = groupsOf(attempts.all, now);
    const span = 1000 * attempts.seconds;
    this.readout.hidden = groups.length === 0;
    if (groups.length === 0) return this.figure.show(() => ({ height: 48, content: [svg("text", { x: 0, y: 26, fill: colour("muted") }, "No job ran in this period.")] }), "");
    this.figure.show((width) => chart(groups, width, now, span), sampled(attempts.byKey.size, attempts.nAll, "attempts"));
  }

  redraw() {
    this.figure.draw();
  }

  /** @param {Event} event */
  describe(event) {
    const key = /** @type {Element} */ (event.target).closest("[data-attempt]")?.getAttribute("data-attempt");
    const one = key && this.byKey.get(key);
    if (!one) return;
    const end = one.ended_at === null ? (this.now ?? Date.now()) : Date.parse(one.ended_at);
    const took = duration((end - Date.parse(one.started_at)) / 1000);
    const how = ENDINGS[one.ending ?? "running"].words;
    fill(this.readout, el("strong", {}, `Job ${one.job_id}, attempt ${one.attempt}`), `: ${one.strategy} · ${one.search}, ${one.kind === "map" ? "a mapped seed" : "a chain"}, ${how}, ${one.ended_at === null ? "for" : "took"} ${took}, on ${one.worker}`);
  }
}

/**
 * Return the attempts by worker, in lanes where none overlaps another.
 * @param {AttemptView[]} attempts
 * @param {number} now
 * @returns {Group[]}
 */
function groupsOf(attempts, now) {
  /** @type {Map<string, { name: string, lanes: AttemptView[][], ends: number[] }>} */
  const groups = new Map();
  const inTime = [...attempts].sort((a, b) => Date.parse(a.started_at) - Date.parse(b.started_at));
  for (const one of inTime) {
    const group = groups.get(one.worker) ?? { name: one.worker, lanes: [], ends: [] };
    groups.set(one.worker, group);
    const free = group.ends.findIndex((end) => end <= Date.parse(one.started_at) + SLACK_MS);
    const lane = free < 0 ? group.lanes.length : free;
    (group.lanes[lane] ??= []).push(one);
    group.ends[lane] = one.ended_at === null ? now : Date.parse(one.ended_at);
  }
  return [...groups.values()].sort((a, b) => (a.name < b.name ? -1 : 1));
}

/**
 * @param {Group[]} groups
 * @param {number} width
 * @param {number} now
 * @param {number} span
 */
function chart(groups, width, now, span) {
  const begin = now - span;
  const at = (/** @type {number} */ moment) => (width * Math.min(Math.max(moment - begin, 0), span)) / span;
  const nLanes = groups.reduce((sum, { lanes }) => sum + lanes.length, 0);
  const lane = Math.min(LANES_PX[1], Math.max(LANES_PX[0], ALL_LANES_PX / nLanes));
  const key = legend(groups, width);
  let y = key.height;
  /** @type {SVGElement[]} */
  const content = [];
  const top = y;
  for (const { name, lanes } of groups) {
    content.push(svg("text", { x: 0, y: y + 14, "font-size": 11.5, fill: colour("muted") }, name));
    y += NAME_PX;
    for (const own of lanes) {
      content.push(svg("rect", { x: 0, y: y + 1, width, height: lane - 2, fill: colour("raised"), rx: 2 }));
      content.push(...own.map((one) => bar(one, at, now, y + 1, lane - 2)));
      y += lane;
    }
    y += 4;
  }
  return { height: y + AXIS_PX, content: [...key.content, ...ticks(begin, span, width, at, top, y), ...content] };
}

/**
 * @param {AttemptView} one
 * @param {(moment: number) => number} at
 * @param {number} now
 * @param {number} y
 * @param {number} height
 */
function bar(one, at, now, y, height) {
  const { colour: name, isFailed, words } = ENDINGS[one.ending ?? "running"];
  const [x, end] = [at(Date.parse(one.started_at)), at(one.ended_at === null ? now : Date.parse(one.ended_at))];
  const width = Math.max(1, end - x - 0.5);
  const paint = colour(name);
  const look = one.ended_at === null ? { fill: paint, "fill-opacity": 0.35, stroke: paint } : { fill: paint, stroke: isFailed ? colour("text") : null };
  const rect = svg("rect", { x, y, width, height, rx: Math.min(2, width / 2), ...look });
  const href = `/campaigns/${one.campaign_id}/searches/${encodeURIComponent(one.search)}`;
  return svg("a", { href, "data-attempt": `${one.job_id}/${one.attempt}`, "data-ending": one.ending ?? "running", tabindex: one.ended_at === null ? 0 : -1, "aria-label": `Job ${one.job_id}, ${words}` }, rect);
}

/**
 * Return the times of the axis, with lines through all lanes.
 * @param {number} begin
 * @param {number} span
 * @param {number} width
 * @param {(moment: number) => number} at
 * @param {number} top
 * @param {number} bottom
 */
function ticks(begin, span, width, at, top, bottom) {
  const room = Math.max(1, Math.floor(width / STEP_PX));
  const step = 1000 * (STEPS.find((s) => span / (1000 * s) <= room) ?? STEPS[STEPS.length - 1]);
  /** @type {SVGElement[]} */
  const content = [];
  for (let moment = Math.ceil(begin / step) * step; moment <= begin + span; moment += step) {
    const x = at(moment);
    const words = new Date(moment).toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
    content.push(svg("line", { x1: x, x2: x, y1: top, y2: bottom, stroke: colour("line") }));
    content.push(svg("text", { x: Math.min(Math.max(x, 16), width - 16), y: bottom + 16, "text-anchor": "middle", "font-size": 11, fill: colour("muted") }, words));
  }
  return content;
}

/**
 * @param {Group[]} groups
 * @param {number} width
 */
function legend(groups, width) {
  const found = /** @type {Set<string>} */ (new Set(groups.flatMap(({ lanes }) => lanes.flat().map(({ ending }) => ending ?? "running"))));
  /** @type {SVGElement[]} */
  const content = [];
  let [x, y] = [0, 4];
  for (const [name, { words, colour: paint, isFailed }] of Object.entries(ENDINGS)) {
    if (!found.has(name)) continue;
    const room = 32 + words.length * LETTER_PX;
    if (x > 0 && x + room > width) [x, y] = [0, y + 18];
    content.push(svg("rect", { x: x + 1, y, width: 12, height: 10, rx: 2, fill: colour(paint), "fill-opacity": name === "running" ? 0.35 : 1, stroke: isFailed ? colour("text") : name === "running" ? colour(paint) : null }));
    content.push(svg("text", { x: x + 19, y: y + 9, fill: colour("muted") }, words));
    x += room;
  }
  return { content, height: y + 18 };
}
