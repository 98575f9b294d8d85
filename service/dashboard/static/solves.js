/** The solves of one search, updated by requesting only new ones. */

import { get } from "./api.js";

/**
 * @import { Outcome } from "./looks.js"
 * @import { HopColumns, HopsView, SeedOfSearch } from "../types"
 */

/** Of more solves whole chains are sampled evenly: as many marks as three figures draw in a second. */
const MOST = 2000;
/** How often a sample is read again [ms]: new solves change all of it. */
const DRAWN_MS = 15_000;

/**
 * One row of the columns; `seed` is the id of the one that was mapped.
 * @typedef {{ [Column in keyof HopColumns]: HopColumns[Column][number] } & { seed: string | null }} Solve
 */

export class Solves {
  /** @param {string} path of the route */
  constructor(path) {
    this.path = path;
    /** @type {Map<number, Solve>} */
    this.byId = new Map();
    /** @type {Map<string, SeedOfSearch>} */
    this.seeds = new Map();
    this.nAll = 0;
    this.last = 0;
    this.drawnAt = -Infinity;
  }

  /** All that are loaded, in order of case, chain and hop. */
  get all() {
    return [...this.byId.values()].sort((a, b) => a.case - b.case || compare(a.seed, b.seed) || a.chain - b.chain || a.hop - b.hop);
  }

  get isPart() {
    return this.byId.size < this.nAll;
  }

  /**
   * Read what is new, or everything.
   * @param {boolean} isAll
   */
  async refresh(isAll) {
    if (!isAll && this.isPart && performance.now() - this.drawnAt < DRAWN_MS) return;
    const after = isAll || this.isPart ? 0 : this.last;
    /** @type {HopsView} */
    const answer = await get(this.path, { after, limit: MOST });
    if (after === 0) this.forget();
    this.take(answer);
    // More have come than are shown at once: from now on a sample is read.
    if (after > 0 && this.nAll > MOST) await this.refresh(true);
  }

  forget() {
    this.byId.clear();
    this.seeds.clear();
    this.drawnAt = performance.now();
  }

  /** @param {HopsView} answer */
  take({ solves, seeds, n_all: nAll, last }) {
    for (const seed of seeds) this.seeds.set(seed.id, seed);
    const names = /** @type {(keyof HopColumns)[]} */ (Object.keys(solves));
    solves.id.forEach((id, i) => {
      const solve = /** @type {Solve} */ (Object.fromEntries(names.map((name) => [name, solves[name][i]])));
      solve.seed = seeds.length ? seeds[solve.chain].id : null;
      this.byId.set(id, solve);
    });
    [this.nAll, this.last] = [nAll, last];
  }
}

/**
 * Return the outcome of a solve.
 * @param {Solve} solve
 * @returns {Outcome}
 */
export function outcomeOf(solve) {
  if (solve.verdict) return /** @type {Outcome} */ (solve.verdict);
  return solve.ending === "timeout" || solve.ending === "numerical" ? solve.ending : "infeasible";
}

/**
 * Return the role of a solve in its chain.
 * @param {Solve} solve
 * @returns {"start" | "accepted" | "rejected" | "restarted" | "mapped"}
 */
export function roleOf(solve) {
  if (solve.move === null) return "mapped";
  if (solve.move === "restarted") return "restarted";
  return solve.width === null ? "start" : /** @type {"accepted" | "rejected"} */ (solve.move);
}

/**
 * Return solves by chain, or by seed.
 * @param {Solve[]} solves
 * @returns {Map<string, Solve[]>}
 */
export function byChain(solves) {
  /** @type {Map<string, Solve[]>} */
  const chains = new Map();
  for (const solve of solves) {
    const key = solve.seed ?? `${solve.case}/${solve.chain}`;
    const chain = chains.get(key);
    if (chain) chain.push(solve);
    else chains.set(key, [solve]);
  }
  return chains;
}

/**
 * @param {number[]} values
 * @param {number} share
 */
export function quantile(values, share) {
  if (values.length === 0) return null;
  const sorted = [...values].sort((a, b) => a - b);
  const place = share * (sorted.length - 1);
  const low = Math.floor(place);
  return sorted[low] + (place - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

/**
 * @param {string | null} a
 * @param {string | null} b
 */
function compare(a, b) {
  return a === b ? 0 : (a ?? "") < (b ?? "") ? -1 : 1;
}
