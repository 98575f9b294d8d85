/** Questions before something is changed. */

import { ApiError } from "./api.js";
import { el, fill } from "./dom.js";

/**
 * Ask before doing something; what the service refuses is said in the dialog, which then stays open.
 * @param {string} title a question
 * @param {import("./dom.js").Child[]} words what will happen
 * @param {string} verb on the button that does it
 * @param {(form: HTMLFormElement) => Promise<unknown>} action
 * @param {{ isDangerous?: boolean }} [how]
 */
export function confirm(title, words, verb, action, how = {}) {
  const fault = el("p", { class: "notice", role: "alert", hidden: true });
  const go = el("button", { type: "submit", class: how.isDangerous ? "danger" : "primary" }, verb);
  const leave = el("button", { type: "button", onclick: () => dialog.close() }, "Keep as it is");
  const form = /** @type {HTMLFormElement} */ (
    el("form", { method: "dialog" }, el("h2", { id: "dialog-title" }, title), words, fault, el("div", { class: "buttons" }, leave, go))
  );
  const dialog = /** @type {HTMLDialogElement} */ (el("dialog", { "aria-labelledby": "dialog-title" }, form));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    go.toggleAttribute("disabled", true);
    try {
      await action(form);
      dialog.close();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      fault.hidden = false;
      fill(fault, error.message);
      go.toggleAttribute("disabled", false);
    }
  });
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}
