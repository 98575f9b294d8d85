/** The flight on its page: frame, moment and switches, and the pictures that follow them. */

import { ApiError, get } from "./api.js";
import { byId, el, fill } from "./dom.js";
import { FRAMES, lastDay } from "./flight.js";
import { completed } from "./frames.js";
import { showLegend } from "./flight_legend.js";
import { parameter, setParameters } from "./page.js";
import { ProfileFigures } from "./profile.js";
import { TimeSlider } from "./time_slider.js";
import { TrajectoryFigure } from "./trajectory.js";

/** @typedef {import("./flight.js").Frame} Frame */

/** Of all trajectories: as many as a picture of this size shows. */
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
    this.waiting = el("p", { class: "muted waiting", role: "status" }, "The solution is being flown again for its pictures; the first time after a start this may take a minute.");
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
      /** @type {import("./flight.js").Flight} */
      this.flight = completed(await get(`/solutions/${id}/trajectory`, { samples: SAMPLES, tracks: "inertial" }));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      fill(this.waiting, `The trajectory could not be drawn: ${error.message} Load this page again to try once more.`);
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
