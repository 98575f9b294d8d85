/** Which outages a solution recovers from, and at what cost, by segment and duration. */

import { axis, Figure } from "./figures.js";
import { number } from "./format.js";
import { colour } from "./theme.js";

/** @import { MissedThrustView } from "../types" */

export class MissedThrustFigure {
  /** @param {HTMLElement} place hidden until there is an analysis */
  constructor(place) {
    this.place = place;
    /** @type {Figure | undefined} */
    this.figure = undefined;
  }

  /** @param {MissedThrustView | undefined} analysis */
  show(analysis) {
    this.analysis = analysis;
    this.place.hidden = !analysis;
    if (!analysis) return;
    this.figure ??= new Figure(this.place, "Missed thrust: cost of recovery");
    this.draw();
  }

  draw() {
    if (!this.analysis || !this.figure) return;
    const found = this.analysis;
    const layout = {
      xaxis: axis("segment in which the outage begins"),
      yaxis: axis("duration, d", { tickvals: found.durations_days }),
    };
    void this.figure.show([unrecovered(found), costs(found)], layout, words(found));
  }
}

/** @param {MissedThrustView} found */
function words(found) {
  const { recovered_given_one_least: least, recovered_given_one_most: most } = found.survivability;
  const chance = `${number(100 * least, 0)} to ${number(100 * most, 0)} % of single safe modes have a recovery. `;
  const fragile = found.fragile.length ? `Fragile segments, the weakest first: ${found.fragile.join(", ")}. ` : "No segment is fragile. ";
  const open = found.n_done < found.n_jobs ? `${found.n_done} of ${found.n_jobs} solves are done. ` : "";
  return `Propellant in addition to that of the reference, which is frozen until the outage; in the orange cells no recovery was found. ${chance}${fragile}${open}`;
}

/** @param {MissedThrustView} found */
function costs(found) {
  const places = found.segments.map(({ segment }) => segment);
  return {
    type: "heatmap",
    x: places,
    y: found.durations_days,
    z: transposed(found.propellant_kg),
    customdata: transposed(found.delay_days),
    zmin: 0,
    zmax: Math.max(1e-3, ...found.propellant_kg.flat().map((cost) => cost ?? 0)),
    colorscale: [[0, colour("line")], [1, colour("series-1")]],
    colorbar: { title: { text: "kg", side: "top" }, thickness: 12, outlinewidth: 0 },
    hovertemplate: "segment %{x}, %{y} d: %{z:+.2f} kg, %{customdata:+.2f} d<extra></extra>",
    hoverongaps: false,
  };
}

/** @param {MissedThrustView} found */
function unrecovered(found) {
  const isLost = found.propellant_kg.map((row, i) => row.map((cell, j) => (cell === null && found.is_tried[i][j] ? 1 : null)));
  return {
    type: "heatmap",
    x: found.segments.map(({ segment }) => segment),
    y: found.durations_days,
    z: transposed(isLost),
    colorscale: [[0, colour("poor")], [1, colour("poor")]],
    showscale: false,
    hovertemplate: "segment %{x}, %{y} d: no recovery found<extra></extra>",
    hoverongaps: false,
  };
}

/**
 * @template T
 * @param {T[][]} rows
 */
function transposed(rows) {
  return rows[0].map((_, j) => rows.map((row) => row[j]));
}
