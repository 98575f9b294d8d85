/** The chains of a search, and its seeds: what each of them yielded. */

import { el } from "./dom.js";
import { axis, Figure } from "./figures.js";
import { NONE, number, percent, shortId, small } from "./format.js";
import { byChain, roleOf } from "./solves.js";
import { Table } from "./table.js";
import { colour } from "./theme.js";

/**
 * @import { Solve, Solves } from "./solves.js"
 * @import { SeedOfSearch } from "../types"
 */

/** @typedef {{ id: string, case: number, chain: number, hops: number, accepted: number, restarts: number, strict: number, best: Solve | null, least: number | null, seconds: number }} Chain */

/** Chains or seeds that a table shows, the best ones first. */
const MOST_ROWS = 100;

/**
 * @param {Solve[]} solves
 * @returns {Chain[]}
 */
function chainsOf(solves) {
  return [...byChain(solves)].map(([id, own]) => {
    const strict = own.filter(({ verdict }) => verdict === "strict");
    const best = strict.reduce((/** @type {Solve | null} */ least, solve) => (least && (least.delta_v_km_s ?? 0) <= (solve.delta_v_km_s ?? 0) ? least : solve), null);
    const known = own.flatMap(({ violation }) => (violation === null ? [] : [violation]));
    return {
      id,
      case: own[0].case,
      chain: own[0].chain,
      hops: own.length,
      accepted: own.filter((solve) => roleOf(solve) === "accepted").length,
      restarts: own.filter(({ move }) => move === "restarted").length,
      strict: strict.length,
      best,
      least: known.length ? known.reduce((a, b) => Math.min(a, b)) : null,
      seconds: own.reduce((sum, solve) => sum + solve.cpu_seconds, 0),
    };
  });
}

export class ChainTable {
  /** @param {HTMLElement} place */
  constructor(place) {
    /** @type {Table<Chain>} */
    this.table = new Table(
      place,
      "Chains and their results",
      [
        { key: "chain", title: "Chain", value: (chain) => chain.chain, cell: (chain) => number(chain.chain + 1, 0) },
        { key: "case", title: "Case", numeric: true, value: (chain) => chain.case, cell: (chain) => number(chain.case + 1, 0) },
        { key: "hops", title: "Solves", numeric: true, value: (chain) => chain.hops, cell: (chain) => number(chain.hops, 0) },
        { key: "accepted", title: "Hops accepted", numeric: true, minor: true, value: (chain) => chain.accepted, cell: (chain) => number(chain.accepted, 0) },
        { key: "restarts", title: "Restarts", numeric: true, minor: true, value: (chain) => chain.restarts, cell: (chain) => number(chain.restarts, 0) },
        { key: "strict", title: "Strict", numeric: true, value: (chain) => chain.strict, cell: (chain) => number(chain.strict, 0) },
        { key: "least", title: "Least violation", numeric: true, minor: true, value: (chain) => chain.least, cell: (chain) => (chain.least === null ? NONE : small(chain.least)) },
        { key: "best", title: "Best Δv", unit: "km/s", numeric: true, value: ({ best }) => best?.delta_v_km_s ?? null, cell: ({ best }) => (best ? el("a", { href: `/solutions/${best.solution_id}` }, number(best.delta_v_km_s, 4)) : NONE) },
        { key: "cpu", title: "CPU", unit: "s", numeric: true, minor: true, value: (chain) => chain.seconds, cell: (chain) => number(chain.seconds, 1) },
      ],
      { id: (chain) => chain.id, sort: "best" },
    );
  }

  /**
   * Show the best chains; return how many that are, and of how many.
   * @param {Solve[]} solves
   */
  show(solves) {
    const all = chainsOf(solves);
    const value = (/** @type {Chain} */ chain) => chain.best?.delta_v_km_s ?? Infinity;
    const shown = all.sort((a, b) => value(a) - value(b) || (a.least ?? Infinity) - (b.least ?? Infinity)).slice(0, MOST_ROWS);
    this.table.show(shown);
    return [shown.length, all.length];
  }
}

/**
 * @typedef {{
 *   seed: SeedOfSearch, solves: number, strict: number, mappings: string, best: Solve | null,
 * }} Yield
 */

/** Radius of a mark, from that of one solve [px]. */
const SIZES = [7, 22];

/**
 * @param {Solves} solves
 * @returns {Yield[]}
 */
export function yieldsOf(solves) {
  return [...byChain(solves.all)].flatMap(([id, own]) => {
    const seed = solves.seeds.get(id);
    if (!seed) return [];
    const strict = own.filter(({ verdict }) => verdict === "strict");
    const best = strict.reduce((/** @type {Solve | null} */ least, solve) => (least && (least.delta_v_km_s ?? 0) <= (solve.delta_v_km_s ?? 0) ? least : solve), null);
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
    if (yields.length === 0) return this.empty("No seed has been mapped yet. Seeds come from another search and are mapped as soon as they are found.");
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
      `${caption}One mark for each seed, larger for more solves; click one to open the seed.`,
    );
  }
}

export class SeedTable {
  /** @param {HTMLElement} place */
  constructor(place) {
    /** @type {Table<Yield>} */
    this.table = new Table(
      place,
      "Seeds and their outcomes",
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
   * Show the most productive seeds; return how many that are.
   * @param {Yield[]} yields
   */
  show(yields) {
    const shown = [...yields].sort((a, b) => b.strict - a.strict || a.seed.delta_v_km_s - b.seed.delta_v_km_s).slice(0, MOST_ROWS);
    this.table.show(shown);
    return shown.length;
  }
}
