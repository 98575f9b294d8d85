/** A text area with line numbers, and with what is wrong written behind the lines that it is about. */

import { byId, el, fill } from "./dom.js";

/** As in style.css [px]. */
const LINE = 20;

/** @typedef {{ path: string, line: number | null, message: string }} Fault */

export class Editor {
  /** @param {(text: string) => void} onChange */
  constructor(onChange) {
    this.area = /** @type {HTMLTextAreaElement} */ (byId("spec"));
    /** @type {Fault[]} */
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

  /** @param {Fault[]} faults */
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
