/** Figures drawn by plotly or as SVG, with title, caption and buttons that save them. */

import { el, fill, svg } from "./dom.js";
import { number } from "./format.js";
import { colour } from "./theme.js";

/** @import { Child } from "./dom.js" */

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
 * Draw or update a figure; `data-drawn` counts how often.
 * @param {HTMLElement} place
 * @param {object[]} traces
 * @param {object} layout
 */
export async function draw(place, traces, layout) {
  const library = await plotly();
  // One task per figure, so that the browser can paint and respond in between.
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
 * Save a figure as a file, on white whatever the theme.
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

  /** Open the solution whose id a mark has as its customdata when the mark is clicked; called after each drawing. */
  linkMarks() {
    const plot = /** @type {any} */ (this.plot);
    // An empty figure has no marks yet.
    if (!plot.removeAllListeners) return;
    plot.removeAllListeners("plotly_click");
    plot.on("plotly_click", (/** @type {{ points: { customdata?: string }[] }} */ { points }) => {
      const id = points.find((point) => point.customdata)?.customdata;
      if (id) window.location.assign(`/solutions/${id}`);
    });
  }

  /**
   * Show why there is nothing to draw, and what to do next.
   * @param {...(Child)} words
   */
  empty(...words) {
    this.plot.hidden = this.buttons.hidden = true;
    this.none.hidden = false;
    this.caption.textContent = "";
    fill(this.none, words);
  }
}

/**
 * Return how many of all points are drawn, in words; nothing where all are.
 * @param {number} shown
 * @param {number} all
 * @param {string} [things]
 */
export function sampled(shown, all, things = "points") {
  return shown < all ? `${number(shown, 0)} of ${number(all, 0)} ${things}, drawn evenly. ` : "";
}

/** Pixels of a saved PNG for one of the screen. */
const PNG_SCALE = 2;
/** Changes of the width up to this are not redrawn [px]. */
const SLACK_PX = 8;

export class SvgFigure {
  /**
   * @param {HTMLElement} place an empty element, whose id names saved files
   * @param {string} title
   */
  constructor(place, title) {
    this.name = place.id;
    this.title = title;
    this.plot = el("div", { class: "drawing", id: `${place.id}-plot` });
    this.caption = el("figcaption", { class: "muted caption" });
    this.heading = el("h2", {}, title);
    this.buttons = el("div", { class: "tools" }, this.button("svg"), this.button("png"));
    fill(place, el("figure", { class: "card figure" }, el("header", {}, this.heading, this.buttons), this.plot, this.caption));
    this.width = 0;
    new ResizeObserver(() => this.resized()).observe(this.plot);
  }

  /**
   * @param {(width: number) => { height: number, content: SVGElement[] }} drawing
   * @param {...(Child)} caption
   */
  show(drawing, ...caption) {
    this.drawing = drawing;
    fill(this.caption, caption);
    this.draw();
  }

  resized() {
    if (Math.abs(this.plot.clientWidth - this.width) > SLACK_PX) this.draw();
  }

  draw() {
    if (!this.drawing) return;
    this.width = this.plot.clientWidth || 600;
    const focused = this.plot.contains(document.activeElement) ? document.activeElement?.getAttribute("href") : null;
    const { height, content } = this.drawing(this.width);
    const size = { width: this.width, height, viewBox: `0 0 ${this.width} ${height}` };
    const font = getComputedStyle(document.body).fontFamily;
    fill(this.plot, svg("svg", { ...size, role: "group", "aria-label": this.title, "font-family": font, "font-size": 12, fill: colour("text") }, content));
    this.plot.dataset.drawn = String(Number(this.plot.dataset.drawn ?? 0) + 1);
    if (focused) /** @type {SVGAElement | null} */ (this.plot.querySelector(`a[href="${CSS.escape(focused)}"]`))?.focus();
  }

  /** @param {"svg" | "png"} format */
  button(format) {
    const name = `Save “${this.title}” as ${format.toUpperCase()}`;
    return el("button", { type: "button", class: "quiet", "aria-label": name, title: name, onclick: () => this.save(format) }, format.toUpperCase());
  }

  /** @param {"svg" | "png"} format */
  async save(format) {
    const drawn = this.plot.querySelector("svg");
    if (!drawn) return;
    const copy = /** @type {SVGElement} */ (drawn.cloneNode(true));
    copy.prepend(svg("rect", { width: "100%", height: "100%", fill: colour("card") }));
    const written = new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" });
    download(format === "svg" ? written : await rasterized(written, this.width, drawn.clientHeight), `coastarc-${this.name}.${format}`);
  }
}

/**
 * @param {Blob} written
 * @param {number} width
 * @param {number} height
 * @returns {Promise<Blob>}
 */
async function rasterized(written, width, height) {
  const image = new Image();
  image.src = URL.createObjectURL(written);
  await image.decode();
  const canvas = /** @type {HTMLCanvasElement} */ (el("canvas", { width: width * PNG_SCALE, height: height * PNG_SCALE }));
  canvas.getContext("2d")?.drawImage(image, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(image.src);
  return new Promise((resolve) => canvas.toBlob((blob) => resolve(/** @type {Blob} */ (blob)), "image/png"));
}

/**
 * @param {Blob} content
 * @param {string} filename
 */
function download(content, filename) {
  const link = /** @type {HTMLAnchorElement} */ (el("a", { href: URL.createObjectURL(content), download: filename }));
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
