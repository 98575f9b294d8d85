/** Delta-v against time of flight, one colour and mark per strategy; a point opens its solution. */

import { Figure } from "../figure.js";
import { number, shortId } from "../format.js";
import { axis } from "../plots.js";
import { compareStrategies, lookOf } from "../strategies.js";
import { colour } from "../theme.js";

/** @typedef {import("./axes.js").Points} Points */

/** Part of a value that an axis shows on both sides of it, where there is no other. */
const MARGIN = 0.1;

export class Scatter {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Δv against time of flight", { tall: true });
    this.isClickable = false;
  }

  /**
   * @param {Points} points
   * @param {number[]} places those that are shown
   * @param {string} caption
   */
  async show(points, places, caption) {
    const names = [...points.strategies].sort(compareStrategies);
    const traces = names.flatMap((name) => {
      const mine = places.filter((i) => points.strategies[points.strategy[i]] === name);
      return mine.length ? [trace(points, mine, name)] : [];
    });
    await this.figure.show([...traces, front(points, places)], layout(points, places), `${caption} The line joins those that none beats in both. A click opens a solution.`);
    this.figure.plot.dataset.points = String(places.length);
    this.listen();
  }

  listen() {
    if (this.isClickable) return;
    this.isClickable = true;
    const plot = /** @type {any} */ (this.figure.plot);
    plot.on("plotly_click", (/** @type {any} */ event) => {
      const id = event.points.find((/** @type {any} */ point) => point.customdata)?.customdata;
      if (id) window.location.assign(`/solutions/${id}`);
    });
  }
}

/**
 * @param {Points} points
 * @param {number[]} places
 * @param {string} name
 */
function trace(points, places, name) {
  const { color, symbol } = lookOf(name);
  return {
    type: "scatter",
    mode: "markers",
    name,
    x: places.map((i) => points.time_of_flight_days[i]),
    y: places.map((i) => points.delta_v_km_s[i]),
    customdata: places.map((i) => points.id[i]),
    text: places.map((i) => `${shortId(points.id[i])}, ${number(points.propellant_kg[i], 1, "kg")}${points.strict[i] ? "" : ", not strict"}`),
    marker: { color, symbol, size: 7, opacity: places.length > 2000 ? 0.55 : 0.8, line: { width: 0 } },
    hovertemplate: "%{y:.4f} km/s, %{x:.1f} d<br>%{text}<extra>" + name + "</extra>",
  };
}

/**
 * Return the line through those that none beats in delta-v and time of flight.
 * @param {Points} points
 * @param {number[]} places
 */
function front(points, places) {
  const sorted = [...places].sort((a, b) => points.delta_v_km_s[a] - points.delta_v_km_s[b] || points.time_of_flight_days[a] - points.time_of_flight_days[b]);
  let quickest = Infinity;
  const on = sorted.filter((i) => {
    const isQuicker = points.time_of_flight_days[i] < quickest;
    if (isQuicker) quickest = points.time_of_flight_days[i];
    return isQuicker;
  });
  return {
    type: "scatter",
    mode: "lines",
    name: "best trade",
    x: on.map((i) => points.time_of_flight_days[i]),
    y: on.map((i) => points.delta_v_km_s[i]),
    line: { color: colour("text"), width: 1.2, dash: "dot", shape: "hv" },
    hoverinfo: "skip",
  };
}

/**
 * @param {Points} points
 * @param {number[]} places
 */
function layout(points, places) {
  const rangeOf = (/** @type {number[]} */ values) => around(places.map((i) => values[i]));
  return {
    showlegend: true,
    hovermode: "closest",
    xaxis: axis("time of flight [d]", rangeOf(points.time_of_flight_days)),
    yaxis: axis("Δv of the transfer [km/s]", rangeOf(points.delta_v_km_s)),
  };
}

/**
 * Return the range of an axis for values that are all the same: left alone it would reach below zero.
 * @param {number[]} values
 */
function around(values) {
  const same = values.every((value) => value === values[0]);
  return same ? { range: [(1 - MARGIN) * values[0], (1 + MARGIN) * values[0]] } : {};
}
