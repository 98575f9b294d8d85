/** The chains of a search as a table: what each came to. */

import { el } from "./dom.js";
import { NONE, number, small } from "./format.js";
import { byChain, roleOf } from "./solves.js";
import { Table } from "./table.js";

/** @typedef {import("./solves.js").Solve} Solve */
/** @typedef {{ id: string, case: number, chain: number, hops: number, accepted: number, restarts: number, strict: number, best: Solve | null, least: number | null, seconds: number }} Chain */

/** Chains that the table shows, the best ones first. */
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
      "Chains and what they came to",
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
