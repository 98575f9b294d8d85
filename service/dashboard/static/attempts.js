/** The attempts of a window of time that ends now, kept up to date by asking for what has changed. */

import { get } from "./api.js";

/** Bars of one picture. */
const MOST = 5000;
/** How often a part that is drawn from all is drawn anew [ms]. */
const DRAWN_MS = 6000;
/** What an answer may have missed of the moment before it [ms]. */
const OVERLAP_MS = 2000;

/**
 * @typedef {{
 *   job_id: number, attempt: number, worker: string, campaign_id: number, search: string, strategy: string, kind: string,
 *   started_at: string, ended_at: string | null, ending: string | null,
 * }} Attempt
 */

export class Attempts {
  /** @param {number} seconds length of the window */
  constructor(seconds) {
    this.seconds = seconds;
    /** @type {Map<string, Attempt>} */
    this.byKey = new Map();
    this.nAll = 0;
    /** The coordinator's clock at the last answer [ms]. */
    this.until = 0;
    this.drawnAt = -Infinity;
  }

  get all() {
    return [...this.byKey.values()];
  }

  get isPart() {
    return this.byKey.size < this.nAll;
  }

  /** @param {number} seconds */
  setWindow(seconds) {
    this.seconds = seconds;
    this.until = 0;
  }

  /**
   * Read what is new since the last time.
   * @param {number} now by the coordinator's clock [ms]
   */
  async refresh(now) {
    if (this.isPart && this.until > 0 && performance.now() - this.drawnAt < DRAWN_MS) return;
    const isWhole = this.isPart || this.until === 0;
    const since = new Date(isWhole ? now - 1000 * this.seconds : this.until - OVERLAP_MS).toISOString();
    const answer = await get("/attempts", { since, limit: MOST });
    if (isWhole) this.byKey.clear();
    for (const one of /** @type {Attempt[]} */ (answer.items)) this.byKey.set(`${one.job_id}/${one.attempt}`, one);
    if (isWhole) [this.nAll, this.drawnAt] = [answer.n_all, performance.now()];
    this.until = Date.parse(answer.until);
    this.forget(this.until - 1000 * this.seconds);
    if (!isWhole) this.nAll = this.byKey.size;
    // Too many for one picture by now: they are drawn from all.
    if (this.byKey.size > MOST) this.until = 0;
  }

  /** @param {number} moment before which nothing is shown [ms] */
  forget(moment) {
    for (const [key, { ended_at: end }] of this.byKey) {
      if (end !== null && Date.parse(end) < moment) {
        this.byKey.delete(key);
        this.nAll -= 1;
      }
    }
  }
}
