/** Up to four solutions chosen for comparison; they stand in the address. */

import { byId, el, fill } from "../dom.js";
import { shortId } from "../format.js";
import { parameter, setParameters } from "../page.js";

export const MOST = 4;
const ID = /^[0-9a-f]{32}$/;

/**
 * Return the ids in a parameter of the address, each once.
 * @param {string} name
 */
export function idsOfAddress(name) {
  const given = (parameter(name) ?? "").split(",").filter((id) => ID.test(id));
  return [...new Set(given)].slice(0, MOST);
}

/**
 * Return the address of a comparison.
 * @param {string[]} ids
 */
function comparison(ids) {
  return `/compare?ids=${ids.join(",")}`;
}

export class Choice {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
  }

  get ids() {
    return idsOfAddress("chosen");
  }

  /**
   * @param {string} id
   * @param {boolean} isChosen
   */
  set(id, isChosen) {
    const others = this.ids.filter((one) => one !== id);
    const ids = isChosen ? [...others, id].slice(0, MOST) : others;
    setParameters({ chosen: ids.join(",") || null });
    this.onChange();
  }

  /** @param {string} id */
  box(id) {
    const { ids } = this;
    const isFull = ids.length >= MOST && !ids.includes(id);
    const input = el("input", {
      type: "checkbox",
      checked: ids.includes(id),
      disabled: isFull,
      "aria-label": `Compare ${shortId(id)}`,
      title: isFull ? "Four can be compared at most" : "Compare",
      onchange: (/** @type {Event} */ event) => this.set(id, /** @type {HTMLInputElement} */ (event.target).checked),
    });
    return el("label", { class: "box" }, input);
  }

  /** Show what is chosen at the foot of the window. */
  show() {
    const { ids } = this;
    byId("choice").hidden = ids.length === 0;
    const chips = ids.map((id) =>
      el("span", { class: "chip" }, el("a", { href: `/solutions/${id}` }, shortId(id)), el("button", { type: "button", class: "quiet", "aria-label": `Do not compare ${shortId(id)}`, onclick: () => this.set(id, false) }, "×")),
    );
    const words = ids.length === 1 ? "1 of 4 chosen; choose another" : `${ids.length} of 4 chosen`;
    const go = ids.length > 1 && el("a", { class: "button primary", id: "compare", href: comparison(ids) }, `Compare ${ids.length} solutions`);
    fill(byId("choice"), el("span", { class: "muted" }, words), ...chips, go);
  }
}
