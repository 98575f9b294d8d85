/** A moment of a flight, chosen by hand or passing by itself. */

import { el, fill } from "./dom.js";
import { number } from "./format.js";

/** Speeds [days per second]. */
const SPEEDS = [1, 2, 5, 10, 20];
const USUAL_SPEED = 5;
/** One press of an arrow key [days]. */
const STEP_DAYS = 0.1;
/** Whom motion disturbs gets a picture a second instead of a film [ms]. */
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
