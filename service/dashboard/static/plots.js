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
 * Draw a picture, or change it into another one; `data-drawn` counts how often.
 * @param {HTMLElement} place
 * @param {object[]} traces
 * @param {object} layout
 */
export async function draw(place, traces, layout) {
  const library = await plotly();
  // One task for each picture: in between the browser shows what is done, and answers its user.
  await new Promise((resolve) => window.setTimeout(resolve));
  const font = { family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("muted") };
  const shared = {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font,
    showlegend: false,
    margin: { l: 64, r: 12, t: 10, b: 44 },
    hoverlabel: {
      bgcolor: colour("raised"),
      bordercolor: colour("line-strong"),
      font: { color: colour("text"), family: font.family },
    },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 12 } },
  };
  await library.react(place, traces, { ...shared, ...layout }, { displayModeBar: false, responsive: true });
  place.dataset.drawn = String(Number(place.dataset.drawn ?? 0) + 1);
}

/**
 * Return an axis in the colours of the theme.
 * @param {string} title with its unit
 * @param {object} [more]
 */
export function axis(title, more = {}) {
  return {
    title: { text: title, standoff: 8 },
    gridcolor: colour("line"),
    linecolor: colour("line-strong"),
    zeroline: false,
    automargin: true,
    ...more,
  };
}

/**
 * Save a picture as a file, on paper white whatever the theme.
 * @param {HTMLElement} place
 * @param {"svg" | "png"} format
 * @param {string} filename without its ending
 */
export async function save(place, format, filename) {
  const library = await plotly();
  const { width, height } = place.getBoundingClientRect();
  await library.downloadImage(place, { format, filename, width: Math.round(width), height: Math.round(height), scale: format === "png" ? 2 : 1 });
}

/** Colours and marks of series, distinguishable with any colour vision and, by their marks, without colour. */
const SERIES = ["series-1", "series-2", "series-3", "series-4", "series-5", "series-6", "series-7"];
const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "cross", "x", "star"];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot", "solid"];

/**
 * Return the look of one series of a figure: the same for one place in all figures of a page.
 * @param {number} place from 0
 */
export function series(place) {
  const i = place % SERIES.length;
  return { color: colour(SERIES[i]), symbol: SYMBOLS[i], dash: DASHES[i] };
}
