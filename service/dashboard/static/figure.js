/** A picture with its title, its caption, and buttons that save it. */

import { el, fill } from "./dom.js";
import { number } from "./format.js";
import { draw, save } from "./plots.js";

export class Figure {
  /**
   * @param {HTMLElement} place an empty element, whose id names saved files
   * @param {string} title
   * @param {{ tall?: boolean }} [how]
   */
  constructor(place, title, how = {}) {
    this.name = place.id;
    this.plot = el("div", { class: how.tall ? "plot tall" : "plot", id: `${place.id}-plot`, role: "img", "aria-label": title });
    this.none = el("p", { class: "empty", hidden: true });
    this.caption = el("figcaption", { class: "muted caption" });
    this.buttons = el("div", { class: "tools" }, this.button("svg"), this.button("png"));
    const head = el("header", {}, el("h2", {}, title), this.buttons);
    fill(place, el("figure", { class: "card figure" }, head, this.none, this.plot, this.caption));
  }

  /** @param {"svg" | "png"} format */
  button(format) {
    const name = `Save “${this.plot.getAttribute("aria-label")}” as ${format.toUpperCase()}`;
    const press = () => save(this.plot, format, `coastarc-${this.name}`);
    return el("button", { type: "button", class: "quiet", "aria-label": name, title: name, onclick: press }, format.toUpperCase());
  }

  /**
   * @param {object[]} traces
   * @param {object} layout
   * @param {string} [caption]
   */
  async show(traces, layout, caption = "") {
    this.plot.hidden = this.buttons.hidden = false;
    this.none.hidden = true;
    this.caption.textContent = caption;
    await draw(this.plot, traces, layout);
  }

  /**
   * Say why there is nothing to draw, and what to do next.
   * @param {...(import("./dom.js").Child)} words
   */
  empty(...words) {
    this.plot.hidden = this.buttons.hidden = true;
    this.none.hidden = false;
    this.caption.textContent = "";
    fill(this.none, words);
  }
}

/**
 * Say how many points of all are drawn; nothing where it is all of them.
 * @param {number} shown
 * @param {number} all
 * @param {string} [things]
 */
export function sampled(shown, all, things = "points") {
  return shown < all ? `${number(shown, 0)} of ${number(all, 0)} ${things}, drawn evenly. ` : "";
}
