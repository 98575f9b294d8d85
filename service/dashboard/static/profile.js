// @ts-check
/** Throttle and mass against time, outages shaded, realizations over the reference. */

import { byId } from "./dom.js";
import { number } from "./format.js";
import { draw, realizationColour } from "./plots.js";
import { colour } from "./theme.js";

/**
 * @typedef {import("./api.js").Flight} Flight
 * @typedef {import("./api.js").Trajectory} Trajectory
 */

/** @param {Flight} flight */
export async function showProfile(flight) {
  const traces = flight.trajectories.flatMap((trajectory, index) => [throttle(trajectory, index), mass(trajectory, index)]);
  await draw(byId("profile"), traces, layout(flight), "svg");
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index
 */
function throttle(trajectory, index) {
  const arcs = trajectory.arcs.filter((arc) => arc.stop > arc.first);
  return {
    ...style(index),
    x: arcs.flatMap((arc) => [trajectory.days[arc.first], trajectory.days[arc.stop - 1]]),
    y: arcs.flatMap((arc) => [arc.throttle, arc.throttle]),
    fill: index === 0 ? "tozeroy" : "none",
    fillcolor: colour("reference-fill"),
    hovertemplate: "%{y:.2f}<extra>" + title(index) + "</extra>",
  };
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index
 */
function mass(trajectory, index) {
  return {
    ...style(index),
    x: trajectory.days,
    y: trajectory.mass_kg,
    yaxis: "y2",
    hovertemplate: "%{y:.1f} kg<extra>" + title(index) + "</extra>",
  };
}

/** @param {number} index */
function style(index) {
  const tint = index === 0 ? colour("reference") : realizationColour(index);
  return {
    type: "scatter",
    mode: "lines",
    name: title(index),
    line: { color: tint, width: index === 0 ? 1.5 : 2, shape: "linear" },
  };
}

/** @param {number} index */
function title(index) {
  return index === 0 ? "reference" : `realization ${index}`;
}

/** @param {Flight} flight */
function layout(flight) {
  const axis = { gridcolor: colour("line"), linecolor: colour("line-strong"), zeroline: false, fixedrange: true };
  const outages = flight.trajectories.slice(1).flatMap((trajectory) => {
    const arc = trajectory.arcs.find(({ kind }) => kind === "outage");
    return arc && trajectory.outage ? [{ from: trajectory.days[arc.first], days: trajectory.outage.duration_days }] : [];
  });
  return {
    margin: { l: 68, r: 8, t: 18, b: 40 },
    hovermode: "x unified",
    xaxis: { ...axis, fixedrange: false, title: { text: "days after departure", standoff: 8 }, anchor: "y2" },
    yaxis: { ...axis, domain: [0.56, 1], range: [-0.02, 1.05], title: { text: "throttle [–]" }, tickvals: [0, 0.5, 1] },
    yaxis2: { ...axis, domain: [0, 0.46], title: { text: "mass [kg]", standoff: 14 }, tickformat: ",.0f", nticks: 4 },
    shapes: outages.map(({ from, days }) => ({
      type: "rect",
      xref: "x",
      yref: "paper",
      x0: from,
      x1: from + days,
      y0: 0,
      y1: 1,
      fillcolor: colour("outage"),
      opacity: 0.28,
      line: { width: 0 },
      layer: "below",
    })),
    annotations: outages.map(({ from, days }) => ({
      x: from + days / 2,
      y: 1,
      yref: "paper",
      yanchor: "bottom",
      showarrow: false,
      text: `outage ${number(days, 1, "d")}`,
      font: { color: colour("outage-text"), size: 11 },
    })),
  };
}
