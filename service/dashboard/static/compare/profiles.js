/** Throttle and mass of several solutions against time, over each other. */

import { Figure } from "../figure.js";
import { outageOf } from "../flight.js";
import { axis } from "../plots.js";
import { lookOf, nameOf } from "./sides.js";

/**
 * @typedef {import("../flight.js").Trajectory} Trajectory
 * @typedef {import("./sides.js").Side} Side
 */

/** Samples of the mass of one trajectory. */
const OF_MASS = 120;
/** Height of the bars of one solution, of that of the figure. */
const LANE = 0.03;

export class Profiles {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.figure = new Figure(place, "Throttle and mass against time", { tall: true });
  }

  /**
   * @param {Side[]} sides those that have been flown
   * @param {boolean} hasRealizations
   */
  async show(sides, hasRealizations) {
    const isNarrow = this.figure.plot.clientWidth < 500;
    const traces = sides.flatMap((side, place) => {
      const all = side.flight?.trajectories ?? [];
      return (hasRealizations ? all : all.slice(0, 1)).flatMap((trajectory, i) => lines(trajectory, i, nameOf(side, place, isNarrow), lookOf(place).color));
    });
    const words = `Time since departure of each.${hasRealizations ? " Realizations are dotted." : ""} Bars above: outages, in the colour of the solution that survives them.`;
    await this.figure.show(traces, layout(sides), words);
    this.figure.plot.dataset.sides = String(sides.length);
  }
}

/**
 * @param {Trajectory} trajectory
 * @param {number} index 0 is the reference
 * @param {string} name
 * @param {string} color
 */
function lines(trajectory, index, name, color) {
  const style = { type: "scatter", mode: "lines", name, legendgroup: name, line: { color, width: index === 0 ? 2 : 1.2, dash: index === 0 ? "solid" : "dot" } };
  const arcs = trajectory.arcs.filter(({ first, stop }) => stop > first);
  const throttle = {
    x: arcs.flatMap(({ first, stop }) => [trajectory.days[first], trajectory.days[stop - 1]]),
    y: arcs.flatMap((arc) => [arc.throttle, arc.throttle]),
  };
  const step = Math.max(1, Math.ceil(trajectory.days.length / OF_MASS));
  const places = trajectory.days.map((_, i) => i).filter((i) => i % step === 0 || i === trajectory.days.length - 1);
  const mass = { x: places.map((i) => trajectory.days[i]), y: places.map((i) => trajectory.mass_kg[i]) };
  const extra = `<extra>${name}${index ? `, realization ${index}` : ""}</extra>`;
  return [
    { ...style, ...throttle, showlegend: index === 0, hovertemplate: `%{y:.2f}${extra}` },
    { ...style, ...mass, yaxis: "y2", showlegend: false, hovertemplate: `%{y:.1f} kg${extra}` },
  ];
}

/** @param {Side[]} sides */
function layout(sides) {
  return {
    showlegend: true,
    hovermode: "closest",
    xaxis: { ...axis("days after departure"), anchor: "y2" },
    yaxis: axis("throttle [–]", { domain: [0.5, 0.86], range: [-0.03, 1.06], tickvals: [0, 0.5, 1], fixedrange: true }),
    yaxis2: axis("mass [kg]", { domain: [0, 0.4], tickformat: ",.0f", nticks: 5, fixedrange: true }),
    shapes: sides.flatMap((side, place) => (side.flight?.trajectories ?? []).flatMap((trajectory) => band(trajectory, place))),
  };
}

/**
 * @param {Trajectory} trajectory
 * @param {number} place
 */
function band(trajectory, place) {
  const outage = outageOf(trajectory);
  if (!outage) return [];
  const color = lookOf(place).color;
  const across = { xref: "x", yref: "paper", x0: outage.from, x1: outage.from + outage.days };
  // A row of its own for each, so that equal ones do not hide each other.
  const top = 1 - place * LANE;
  return [{ type: "rect", ...across, y0: top - 0.8 * LANE, y1: top, fillcolor: color, line: { color, width: 1 } }];
}
