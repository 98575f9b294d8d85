/** Figures of the solutions: delta-v against time of flight, and parallel coordinates. */

import { el, svg } from "../dom.js";
import { axis, Figure, SvgFigure } from "../figures.js";
import { number, shortId } from "../format.js";
import { compareStrategies, lookOf } from "../looks.js";
import { colour } from "../theme.js";
import { AXES, within } from "./filters.js";

/**
 * @import { Ranges } from "./filters.js"
 * @import { PointsView } from "../../types"
 */

/** Half the range of an axis with a single value, as a share of the value. */
const MARGIN = 0.1;

export class Scatter {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Δv against time of flight", { tall: true });
  }

  /**
   * @param {PointsView} points
   * @param {string} caption
   */
  async show(points, caption) {
    const names = [...points.strategies].sort(compareStrategies);
    const traces = names.map((name) => trace(points, name));
    await this.figure.show([...traces, front(points)], layout(points), `${caption} The line joins the Pareto-optimal solutions. Click a mark to open its solution.`);
    this.figure.plot.dataset.points = String(points.id.length);
    this.figure.linkMarks();
  }
}

/**
 * @param {PointsView} points
 * @param {string} name of a strategy
 */
function trace(points, name) {
  const { color, symbol } = lookOf(name);
  const own = points.id.map((_, i) => i).filter((i) => points.strategies[points.strategy[i]] === name);
  return {
    type: "scatter",
    mode: "markers",
    name,
    x: own.map((i) => points.time_of_flight_days[i]),
    y: own.map((i) => points.delta_v_km_s[i]),
    customdata: own.map((i) => points.id[i]),
    text: own.map((i) => `${shortId(points.id[i])}, ${number(points.propellant_kg[i], 1, "kg")}${points.strict[i] ? "" : ", not strict"}`),
    marker: { color, symbol, size: 7, opacity: points.id.length > 2000 ? 0.55 : 0.8, line: { width: 0 } },
    hovertemplate: "%{y:.4f} km/s, %{x:.1f} d<br>%{text}<extra>" + name + "</extra>",
  };
}

/** @param {PointsView} points */
function front(points) {
  return {
    type: "scatter",
    mode: "lines",
    name: "Pareto front",
    x: points.front.map((i) => points.time_of_flight_days[i]),
    y: points.front.map((i) => points.delta_v_km_s[i]),
    line: { color: colour("text"), width: 1.2, dash: "dot", shape: "hv" },
    hoverinfo: "skip",
  };
}

/** @param {PointsView} points */
function layout(points) {
  return {
    showlegend: true,
    hovermode: "closest",
    xaxis: axis("time of flight [d]", around(points.time_of_flight_days)),
    yaxis: axis("Δv of the transfer [km/s]", around(points.delta_v_km_s)),
  };
}

/**
 * Return a range for an axis whose values are all equal; the default would reach below zero.
 * @param {number[]} values
 */
function around(values) {
  const same = values.every((value) => value === values[0]);
  return same ? { range: [(1 - MARGIN) * values[0], (1 + MARGIN) * values[0]] } : {};
}

const HEIGHT = 340;
const [TOP, BOTTOM, SIDE] = [46, 24, 52];
/** Half the width of an axis for a pointer, and of a brush [px]. */
const REACH = 16;
const BRUSH = 7;
/** A shorter drag is a click, which clears the filter of the axis [px]. */
const CLICK = 4;

export class Parallel {
  /**
   * @param {HTMLElement} place
   * @param {(key: string, bounds: [number, number] | null) => void} onBrush
   */
  constructor(place, onBrush) {
    this.figure = new SvgFigure(place, "Solutions on parallel axes");
    this.onBrush = onBrush;
    // A narrow card scrolls, since closer axes would be unreadable.
    const scroller = el("div", { class: "scroller", tabindex: 0, role: "region", "aria-label": "Parallel coordinates" });
    this.figure.plot.replaceWith(scroller);
    scroller.append(this.figure.plot);
    this.figure.plot.classList.add("parallel");
    /** @type {PointsView | undefined} */
    this.points = undefined;
    /** @type {Ranges} */
    this.ranges = new Map();
    /** @type {number | undefined} */
    this.frame = undefined;
    this.figure.plot.addEventListener("pointerdown", (event) => this.begin(event));
    this.figure.plot.addEventListener("pointermove", (event) => this.drag(event));
    this.figure.plot.addEventListener("pointerup", (event) => this.end(event));
    this.figure.plot.addEventListener("pointercancel", () => this.cancelDrag());
  }

  /**
   * @param {PointsView} points
   * @param {Ranges} ranges
   * @param {string} caption
   */
  show(points, ranges, caption) {
    if (this.held) return;
    [this.points, this.ranges] = [points, ranges];
    this.scales = AXES.map(({ key }) => extent(points[key]));
    this.figure.show((width) => this.drawing(width), `${caption} Drag along an axis to filter by it, click it to clear the filter; the fields above do the same.`);
  }

  /** @param {number} width */
  drawing(width) {
    this.step = (width - 2 * SIDE) / (AXES.length - 1);
    const points = /** @type {PointsView} */ (this.points);
    const chosen = within(points, this.ranges);
    this.figure.plot.dataset.chosen = String(chosen.length);
    return { height: HEIGHT, content: [this.context(points, chosen), ...this.lines(points, chosen), ...AXES.map((_, i) => this.axis(i))] };
  }

  /**
   * @param {PointsView} points
   * @param {number[]} chosen
   */
  context(points, chosen) {
    const isChosen = new Set(chosen);
    const others = points.id.map((/** @type {string} */ _, /** @type {number} */ i) => i).filter((/** @type {number} */ i) => !isChosen.has(i));
    const opacity = Math.max(0.08, Math.min(0.45, 400 / Math.max(1, others.length)));
    return svg("path", { d: this.path(points, others), fill: "none", stroke: colour("line-strong"), "stroke-width": 0.6, opacity });
  }

  /**
   * Return one path per strategy: a path per solution would be thousands of elements.
   * @param {PointsView} points
   * @param {number[]} chosen
   */
  lines(points, chosen) {
    const opacity = Math.max(0.12, Math.min(0.75, 90 / Math.max(1, chosen.length)));
    return [...points.strategies].sort(compareStrategies).map((name) => {
      const mine = chosen.filter((i) => points.strategies[points.strategy[i]] === name);
      const { color } = lookOf(name);
      return svg("path", { d: this.path(points, mine), "data-strategy": name, fill: "none", stroke: color, "stroke-width": 1, opacity }, svg("title", {}, name));
    });
  }

  /**
   * @param {PointsView} points
   * @param {number[]} places
   */
  path(points, places) {
    const lines = places.map((i) => AXES.map(({ key }, place) => `${this.x(place).toFixed(1)} ${this.y(place, points[key][i]).toFixed(1)}`).join("L"));
    return lines.length ? `M${lines.join("M")}` : "";
  }

  /** @param {number} place */
  axis(place) {
    const { key, title, unit, digits } = AXES[place];
    const [least, most] = /** @type {[number, number][]} */ (this.scales)[place];
    const x = this.x(place);
    const label = (/** @type {number} */ y, /** @type {string} */ words, /** @type {object} */ more = {}) =>
      svg("text", { x, y, "text-anchor": "middle", "font-size": 11, fill: colour("muted"), ...more }, words);
    const range = this.ranges.get(key);
    return svg(
      "g",
      { "data-axis": key },
      svg("line", { x1: x, x2: x, y1: TOP, y2: HEIGHT - BOTTOM, stroke: colour("muted"), "stroke-width": 1.2 }),
      range && this.brush(place, range),
      label(14, title, { fill: colour("text"), "font-weight": 600 }),
      label(28, unit),
      label(TOP - 5, number(most, digits)),
      label(HEIGHT - BOTTOM + 14, number(least, digits)),
      svg("rect", { x: x - REACH, width: 2 * REACH, y: TOP, height: HEIGHT - TOP - BOTTOM, fill: "transparent", class: "reach", "data-place": place }),
    );
  }

  /**
   * @param {number} place
   * @param {[number, number]} range
   */
  brush(place, range) {
    const [least, most] = /** @type {[number, number][]} */ (this.scales)[place];
    const [low, high] = [Math.max(least, range[0]), Math.min(most, range[1])];
    const [top, bottom] = [this.y(place, high), this.y(place, low)];
    return svg("rect", { class: "brush", x: this.x(place) - BRUSH, width: 2 * BRUSH, y: top, height: Math.max(2, bottom - top), rx: 3, fill: colour("accent"), opacity: 0.45 });
  }

  /** @param {number} place */
  x(place) {
    return SIDE + place * /** @type {number} */ (this.step);
  }

  /**
   * @param {number} place
   * @param {number} value
   */
  y(place, value) {
    const [least, most] = /** @type {[number, number][]} */ (this.scales)[place];
    return HEIGHT - BOTTOM - ((value - least) / (most - least)) * (HEIGHT - TOP - BOTTOM);
  }

  /** @param {PointerEvent} event */
  begin(event) {
    const place = /** @type {Element} */ (event.target).getAttribute("data-place");
    if (place === null || event.button !== 0) return;
    event.preventDefault();
    this.figure.plot.setPointerCapture(event.pointerId);
    this.held = { place: Number(place), from: this.height(event), before: this.ranges };
  }

  /** @param {PointerEvent} event */
  drag(event) {
    if (!this.held) return;
    const bounds = this.bounds(this.held.place, this.held.from, this.height(event));
    this.ranges = new Map(this.held.before).set(AXES[this.held.place].key, bounds);
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.figure.draw();
    });
  }

  /** @param {PointerEvent} event */
  end(event) {
    if (!this.held) return;
    const { place, from } = this.held;
    const to = this.height(event);
    this.held = undefined;
    this.onBrush(AXES[place].key, Math.abs(to - from) < CLICK ? null : this.bounds(place, from, to));
  }

  cancelDrag() {
    if (!this.held) return;
    this.ranges = this.held.before;
    this.held = undefined;
    this.figure.draw();
  }

  /** @param {PointerEvent} event */
  height(event) {
    const y = event.clientY - this.figure.plot.getBoundingClientRect().top;
    return Math.max(TOP, Math.min(HEIGHT - BOTTOM, y));
  }

  /**
   * Return the values between two heights, rounded outwards as the axis shows them.
   * @param {number} place
   * @param {number} one
   * @param {number} other
   * @returns {[number, number]}
   */
  bounds(place, one, other) {
    const [least, most] = /** @type {[number, number][]} */ (this.scales)[place];
    const value = (/** @type {number} */ y) => least + ((HEIGHT - BOTTOM - y) / (HEIGHT - TOP - BOTTOM)) * (most - least);
    const unit = 10 ** -AXES[place].digits;
    const [low, high] = [value(Math.max(one, other)), value(Math.min(one, other))];
    const round = (/** @type {number} */ number) => Number(number.toFixed(AXES[place].digits));
    // Integers are rounded to the nearest.
    if (unit === 1) return [round(low), round(high)];
    return [Math.max(0, round(Math.floor(low / unit) * unit)), round(Math.ceil(high / unit) * unit)];
  }
}

/**
 * Return the extent of a column, widened where it is a point.
 * @param {number[]} values
 * @returns {[number, number]}
 */
function extent(values) {
  const least = values.reduce((a, b) => Math.min(a, b), Infinity);
  const most = values.reduce((a, b) => Math.max(a, b), -Infinity);
  return most > least ? [least, most] : [least - 0.5, least + 0.5];
}
