/** The flight of a solution: frame, time and switches, and the figures that follow them. */

import { ApiError, get } from "./api.js";
import { byId, el, fill } from "./dom.js";
import { FRAMES, framesOf, lastDay, lookOf, nameOf, outageText } from "./flight.js";
import { number } from "./format.js";
import { withAllFrames } from "./frames.js";
import { parameter, setParameters } from "./page.js";
import { ProfileFigures } from "./profile.js";
import { colour } from "./theme.js";
import { TrajectoryFigure } from "./trajectory.js";

/** @import { Flight, Frame } from "./flight.js" */

/** Samples of all trajectories together: as many as a figure of this size resolves. */
const SAMPLES = 2000;

export class FlightView {
  constructor() {
    this.trajectory = new TrajectoryFigure(byId("trajectory"));
    this.profile = new ProfileFigures(byId("controls"), byId("states"));
    this.tabs = el("div", { class: "tabs", role: "tablist", "aria-label": "Frame" }, FRAMES.map((frame) => this.tab(frame)));
    this.tabs.addEventListener("keydown", (event) => this.turn(event));
    this.trajectory.figure.buttons.before(this.tabs);
    this.legend = el("ul", { class: "legend", id: "legend", "aria-label": "Legend" });
    this.player = el("div", { class: "player", role: "group", "aria-label": "Moment of the flight" });
    this.trajectory.figure.caption.before(this.player, this.legend);
    this.waiting = el("p", { class: "muted waiting", role: "status" }, "The solution is being propagated for its figures; the first time after a start this may take a minute.");
    this.trajectory.plot.before(this.waiting);
    /** @type {Set<number>} */
    this.hidden = new Set();
    window.addEventListener("popstate", () => this.flight && this.draw());
  }

  /**
   * @param {string} id
   * @param {(day: number) => string} dateOf
   */
  async load(id, dateOf) {
    this.slider = new TimeSlider(this.player, dateOf, (day) => this.move(day), (day) => this.rest(day));
    this.mark();
    try {
      /** @type {Flight} */
      this.flight = withAllFrames(await get(`/solutions/${id}/trajectory`, { samples: SAMPLES, tracks: "inertial" }));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      fill(this.waiting, `The trajectory could not be drawn: ${error.message} Reload the page to try again.`);
      return;
    }
    this.waiting.hidden = true;
    await this.draw();
    this.slider.open(lastDay(this.flight), Number(parameter("day") ?? 0) || 0);
    this.player.dataset.ready = "yes";
  }

  async draw() {
    if (!this.flight || !this.slider) return;
    this.mark();
    const frame = this.frame;
    framesOf(this.flight.world).forEach(({ title }, i) => fill(/** @type {HTMLElement} */ (this.tabs.children[i]), title));
    showLegend(this.legend, this.flight, frame, this.hidden, (index, isShown) => this.switch(index, isShown));
    await this.trajectory.show(this.flight, frame, this.hidden, this.slider.day);
    await this.profile.show(this.flight, this.hidden);
  }

  /** @returns {Frame} */
  get frame() {
    const wanted = parameter("frame");
    return FRAMES.find(({ id }) => id === wanted)?.id ?? "rotating";
  }

  /** @param {{ id: Frame, title: string }} frame */
  tab({ id, title }) {
    return el("button", { type: "button", role: "tab", "data-frame": id, "aria-selected": "false", onclick: () => this.choose(id) }, title);
  }

  /** @param {Frame} frame */
  choose(frame) {
    if (frame === this.frame) return;
    setParameters({ frame });
    this.draw();
  }

  /** @param {KeyboardEvent} event */
  turn(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined) return;
    const place = FRAMES.findIndex(({ id }) => id === this.frame);
    this.choose(FRAMES[(place + step + FRAMES.length) % FRAMES.length].id);
    /** @type {HTMLElement} */ (this.tabs.querySelector("[aria-selected=true]")).focus();
    event.preventDefault();
  }

  mark() {
    for (const tab of this.tabs.children) {
      const isChosen = tab.getAttribute("data-frame") === this.frame;
      tab.setAttribute("aria-selected", String(isChosen));
      tab.setAttribute("tabindex", isChosen ? "0" : "-1");
    }
  }

  /**
   * @param {number} index
   * @param {boolean} isShown
   */
  switch(index, isShown) {
    if (isShown) this.hidden.delete(index);
    else this.hidden.add(index);
    this.draw();
  }

  /** @param {number} day */
  move(day) {
    this.trajectory.move(day);
    this.profile.mark(day);
  }

  /** @param {number} day */
  async rest(day) {
    // The last of many moves may have been skipped.
    while (!(await this.trajectory.move(day)) && this.trajectory.isMoving) await new Promise(requestAnimationFrame);
    const address = new URL(window.location.href);
    address.searchParams.set("day", day.toFixed(1));
    history.replaceState(null, "", address);
  }
}

/** Speeds [days per second]. */
const SPEEDS = [1, 2, 5, 10, 20];
const USUAL_SPEED = 5;
/** One press of an arrow key [days]. */
const STEP_DAYS = 0.1;
/** With reduced motion preferred, the flight moves once in this time instead of smoothly [ms]. */
const STILL_MS = 1000;

export class TimeSlider {
  /**
   * @param {HTMLElement} place
   * @param {(day: number) => string} dateOf
   * @param {(day: number) => void} onMove
   * @param {(day: number) => void} onRest  when the moment is chosen and nothing moves
   */
  constructor(place, dateOf, onMove, onRest) {
    this.dateOf = dateOf;
    this.onMove = onMove;
    this.onRest = onRest;
    this.day = 0;
    this.last = 1;
    this.isPlaying = false;
    this.input = /** @type {HTMLInputElement} */ (
      el("input", { type: "range", id: "moment", min: 0, max: 1, step: STEP_DAYS, value: 0, "aria-label": "Day after departure" })
    );
    this.input.addEventListener("input", () => this.set(Number(this.input.value)));
    this.input.addEventListener("change", () => this.onRest(this.day));
    this.button = el("button", { type: "button", id: "play", "aria-pressed": "false", onclick: () => this.toggle() }, "▶ Play");
    this.text = el("output", { id: "moment-text", for: "moment" });
    this.speed = /** @type {HTMLSelectElement} */ (
      el("select", { id: "speed" }, SPEEDS.map((speed) => el("option", { value: speed, selected: speed === USUAL_SPEED }, `${speed} d/s`)))
    );
    const speed = el("label", {}, "Speed ", this.speed);
    fill(place, this.button, this.input, this.text, speed);
  }

  /**
   * @param {number} last day of the flight
   * @param {number} day
   */
  open(last, day) {
    this.last = last;
    this.input.max = String(last);
    this.set(day);
  }

  /** @param {number} day */
  set(day) {
    this.day = Math.min(this.last, Math.max(0, day));
    this.input.value = String(this.day);
    const words = `day ${number(this.day, 1)} · ${this.dateOf(this.day)}`;
    this.text.textContent = words;
    this.input.setAttribute("aria-valuetext", words);
    this.onMove(this.day);
  }

  toggle() {
    if (this.isPlaying) return this.stop();
    if (this.day >= this.last) this.set(0);
    this.isPlaying = true;
    this.show("❚❚ Pause");
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.step();
    else this.film(performance.now());
  }

  stop() {
    this.isPlaying = false;
    window.clearTimeout(this.timer);
    this.show("▶ Play");
    this.onRest(this.day);
  }

  /** @param {number} since */
  film(since) {
    requestAnimationFrame((now) => {
      if (!this.isPlaying) return;
      this.advance((Math.max(0, now - since) / 1000) * Number(this.speed.value));
      if (this.isPlaying) this.film(now);
    });
  }

  step() {
    this.timer = window.setTimeout(() => {
      if (!this.isPlaying) return;
      this.advance((STILL_MS / 1000) * Number(this.speed.value));
      if (this.isPlaying) this.step();
    }, STILL_MS);
  }

  /** @param {number} days */
  advance(days) {
    this.set(this.day + days);
    if (this.day >= this.last) this.stop();
  }

  /** @param {string} words */
  show(words) {
    this.button.textContent = words;
    this.button.setAttribute("aria-pressed", String(this.isPlaying));
  }
}

/**
 * @param {HTMLElement} place a list
 * @param {Flight} flight
 * @param {Frame} frame
 * @param {Set<number>} hidden
 * @param {(index: number, isShown: boolean) => void} onSwitch
 */
export function showLegend(place, flight, frame, hidden, onSwitch) {
  const focused = place.contains(document.activeElement) ? document.activeElement?.id : undefined;
  const switches = flight.trajectories.map((trajectory, index) => {
    const { color, dash } = lookOf(index);
    const input = el("input", { type: "checkbox", id: `shows-${index}`, checked: !hidden.has(index) });
    input.addEventListener("change", () => onSwitch(index, /** @type {HTMLInputElement} */ (input).checked));
    const swatches = [swatch("thick", color, dash), swatch("thin", index === 0 ? colour("coast") : color, dash)];
    const about = trajectory.outage && el("small", { class: "muted" }, outageText(trajectory));
    return el("li", {}, el("label", {}, input, swatches, el("span", {}, nameOf(index), " ", about)));
  });
  /** @type {[string, string, string][]} */
  const others = [["medium", colour("target"), "target orbit"]];
  if (flight.trajectories.length > 1) others.unshift(["thick", colour("outage"), "outage"]);
  if (frame === "inertial") others.push(["dotted", colour("moon"), `${flight.world.main}’s path`]);
  const rest = others.map(([kind, tint, words]) => el("li", {}, swatch(kind, tint), words));
  fill(place, switches, rest, el("li", { class: "muted" }, "thick: thrust; thin: coast; ◆ spacecraft now"));
  if (focused) document.getElementById(focused)?.focus();
}

/**
 * @param {string} kind
 * @param {string} tint
 * @param {string} [dash]
 */
function swatch(kind, tint, dash = "solid") {
  const style = dash === "solid" ? "" : `; border-top-style: ${dash === "dash" ? "dashed" : "dotted"}`;
  return el("i", { class: kind, style: `--tint:${tint}${style}`, "aria-hidden": "true" });
}
