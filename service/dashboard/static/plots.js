// @ts-check
/** plotly.js, loaded when the first picture is due, and what all pictures share. */

import { colour } from "./theme.js";

/** @type {Promise<any> | undefined} */
let library;

/** Load plotly.js once; the tables are on the screen before this starts. */
export function plotly() {
  library ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = document.body.dataset.plotly ?? "";
    script.onload = () => resolve(/** @type {any} */ (window).Plotly);
    script.onerror = () => reject(new Error("plotly.js did not load"));
    document.head.append(script);
  });
  return library;
}

/**
 * Draw a picture, or change it into another one.
 * @param {HTMLElement} place
 * @param {object[]} traces
 * @param {object} layout
 * @param {"svg" | "png"} format of a saved picture
 */
export async function draw(place, traces, layout, format) {
  const library = await plotly();
  const shared = {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("muted") },
    showlegend: false,
    modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("line-strong"), activecolor: colour("text") },
    hoverlabel: {
      bgcolor: colour("raised"),
      bordercolor: colour("line-strong"),
      font: { color: colour("text"), family: getComputedStyle(document.body).fontFamily },
    },
  };
  const options = {
    displaylogo: false,
    responsive: true,
    toImageButtonOptions: { format, filename: "coastarc", scale: 2 },
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "orbitRotation", "resetCameraLastSave3d"],
  };
  await library.react(place, traces, { ...shared, ...layout }, options);
  place.dataset.drawn = String(Number(place.dataset.drawn ?? 0) + 1);
}

/**
 * Colours of the k realizations, distinguishable with any colour vision; further ones start again.
 * @param {number} index from 1
 */
export function realizationColour(index) {
  const names = ["realization", "realization-2", "realization-3"];
  return colour(names[(index - 1) % names.length]);
}
