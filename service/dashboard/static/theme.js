/** Light or dark: the system's preference until the user chooses. */

import { byId } from "./dom.js";

const KEY = "coastarc-theme";

/** @returns {"light" | "dark"} */
export function theme() {
  const chosen = localStorage.getItem(KEY);
  if (chosen === "light" || chosen === "dark") return chosen;
  return window.matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

/** @param {() => void} onChange called after every change of colours */
export function watchTheme(onChange) {
  const apply = () => {
    document.documentElement.dataset.theme = theme();
    colours.clear();
    byId("theme").setAttribute("aria-label", `Use the ${other()} theme`);
    onChange();
  };
  byId("theme").addEventListener("click", () => {
    localStorage.setItem(KEY, other());
    apply();
  });
  window.matchMedia("(prefers-color-scheme: light)").addEventListener("change", apply);
  apply();
}

function other() {
  return theme() === "light" ? "dark" : "light";
}

/** @type {Map<string, string>} colours of the theme, cached: figures ask thousands of times */
const colours = new Map();

/**
 * Return a colour of the style sheet.
 * @param {string} name
 */
export function colour(name) {
  const known = colours.get(name) ?? getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  colours.set(name, known);
  return known;
}
