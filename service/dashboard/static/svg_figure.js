/** A picture of our own: SVG with its title, its caption, and buttons that save it; drawn again when its width changes. */

import { el, fill, svg } from "./dom.js";
import { colour } from "./theme.js";

/** Pixels of a saved PNG for one of the screen. */
const PNG_SCALE = 2;
/** Redrawn only when the width changes by more [px]. */
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
   * @param {...(import("./dom.js").Child)} caption
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
    download(format === "svg" ? written : await painted(written, this.width, drawn.clientHeight), `coastarc-${this.name}.${format}`);
  }
}

/**
 * @param {Blob} written
 * @param {number} width
 * @param {number} height
 * @returns {Promise<Blob>}
 */
async function painted(written, width, height) {
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
