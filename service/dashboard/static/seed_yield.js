/** What each seed of a search was worth. */

import { el } from "./dom.js";
import { Figure } from "./figure.js";
import { number, percent, shortId } from "./format.js";
import { axis } from "./plots.js";
import { byChain } from "./solves.js";
import { Table } from "./table.js";
import { colour } from "./theme.js";

/**
 * @typedef {{
 *   seed: import("./solves.js").Seed, solves: number, strict: number, mappings: string, best: import("./solves.js").Solve | null,
 * }} Yield
 */

/** Seeds that the table shows, the best ones first. */
const MOST_ROWS = 100;
/** Radius of a mark, from one solve on [px]. */
const SIZES = [7, 22];

/**
 * @param {import("./solves.js").Solves} solves
 * @returns {Yield[]}
 */
export function yieldsOf(solves) {
  return [...byChain(solves.all)].flatMap(([id, own]) => {
    const seed = solves.seeds.get(id);
    if (!seed) return [];
    const strict = own.filter(({ verdict }) => verdict === "strict");
    const best = strict.reduce((/** @type {import("./solves.js").Solve | null} */ least, solve) => (least && (least.delta_v_km_s ?? 0) <= (solve.delta_v_km_s ?? 0) ? least : solve), null);
    const mappings = [...new Set(own.map(({ mapping }) => mapping))].join(", ");
    return [{ seed, solves: own.length, strict: strict.length, mappings, best }];
  });
}

export class YieldFigure extends Figure {
  /**
   * @param {Yield[]} yields
   * @param {string} caption
   */
  draw(yields, caption) {
    if (yields.length === 0) return this.empty("No seed has been mapped yet. Seeds come from the search that this one names; they are mapped as soon as they are found.");
    const most = yields.reduce((n, one) => Math.max(n, one.solves), 1);
    const trace = {
      type: "scatter",
      mode: "markers",
      x: yields.map(({ seed }) => seed.delta_v_km_s),
      y: yields.map((one) => (100 * one.strict) / one.solves),
      text: yields.map((one) => `seed ${shortId(one.seed.id)}: ${one.strict} of ${one.solves} solves`),
      customdata: yields.map(({ seed }) => seed.id),
      hovertemplate: "%{text}<br>Δv %{x:.4f} km/s<extra></extra>",
      marker: { color: colour("good"), opacity: 0.65, line: { color: colour("card"), width: 1 }, size: yields.map((one) => SIZES[0] + (SIZES[1] - SIZES[0]) * Math.sqrt(one.solves / most) * Number(most > 1)) },
    };
    return this.show(
      [trace],
      { xaxis: axis("Δv of the seed [km/s]"), yaxis: axis("strict solves from it [%]", { range: [-6, 106] }) },
      `${caption}One mark for each seed, larger for more solves; press one for the seed.`,
    );
  }
}

export class SeedTable {
  /** @param {HTMLElement} place */
  constructor(place) {
    /** @type {Table<Yield>} */
    this.table = new Table(
      place,
      "Seeds and what became of them",
      [
        { key: "seed", title: "Seed", cell: ({ seed }) => el("code", {}, shortId(seed.id)) },
        { key: "strategy", title: "From", value: ({ seed }) => seed.strategy, cell: ({ seed }) => `${seed.strategy} · ${seed.search}`, minor: true },
        { key: "delta_v", title: "Δv", unit: "km/s", numeric: true, value: ({ seed }) => seed.delta_v_km_s, cell: ({ seed }) => number(seed.delta_v_km_s, 4) },
        { key: "mappings", title: "Mapped by", cell: ({ mappings }) => mappings, minor: true },
        { key: "solves", title: "Solves", numeric: true, value: (one) => one.solves, cell: (one) => number(one.solves, 0) },
        { key: "strict", title: "Strict", numeric: true, value: (one) => one.strict, cell: (one) => number(one.strict, 0) },
        { key: "yield", title: "Yield", numeric: true, value: (one) => one.strict / one.solves, cell: (one) => percent(one.strict / one.solves) },
        { key: "best", title: "Best from it", unit: "km/s", numeric: true, value: ({ best }) => best?.delta_v_km_s ?? null, cell: ({ best }) => best && el("a", { href: `/solutions/${best.solution_id}` }, number(best.delta_v_km_s, 4)) },
      ],
      { id: ({ seed }) => seed.id, href: ({ seed }) => `/solutions/${seed.id}`, sort: "strict", descending: true },
    );
  }

  /**
   * Show the seeds that gave most; return how many that are.
   * @param {Yield[]} yields
   */
  show(yields) {
    const shown = [...yields].sort((a, b) => b.strict - a.strict || a.seed.delta_v_km_s - b.seed.delta_v_km_s).slice(0, MOST_ROWS);
    this.table.show(shown);
    return shown.length;
  }
}
