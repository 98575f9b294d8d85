/** Jobs of one state, page by page; waiting and running ones can be cancelled, dead ones requeued. */

import { get, post } from "./api.js";
import { askRequeue, confirm } from "./controls.js";
import { el, fill } from "./dom.js";
import { date, duration, NONE, number, shortId } from "./format.js";
import { Table } from "./table.js";

/**
 * @import { Column } from "./table.js"
 * @import { AttemptDetail, AttemptsOfJob, JobPage, JobView } from "../types"
 */

/** @typedef {"running" | "queued" | "dead"} State */

/** Jobs per request, and the most shown. */
const PAGE = 50;
const MOST = 500;

export class JobTable {
  /**
   * @param {HTMLElement} place
   * @param {HTMLElement} more for the button that shows further ones
   * @param {() => Promise<void>} onChanged
   */
  constructor(place, more, onChanged) {
    this.place = place;
    this.more = more;
    this.onChanged = onChanged;
    /** @type {State} */
    this.state = "running";
    /** @type {string | null} */
    this.campaign = null;
    this.limit = PAGE;
    this.now = Date.now();
    this.leaseS = 30;
    this.mayChange = false;
    /** Attempts at the jobs whose errors are open, by job. @type {Map<number, AttemptDetail[]>} */
    this.opened = new Map();
    /** @type {Table<JobView> | undefined} */
    this.table = undefined;
  }

  /**
   * @param {State} state
   * @param {string | null} campaign
   */
  choose(state, campaign) {
    if (this.state !== state || this.campaign !== campaign) this.limit = PAGE;
    if (this.state !== state) this.table = undefined;
    [this.state, this.campaign] = [state, campaign];
  }

  /**
   * Read and show; the focus stays where it was.
   * @param {number} now by the coordinator's clock [ms]
   */
  async refresh(now) {
    this.now = now;
    /** @type {JobView[]} */
    const jobs = [];
    /** @type {number | null} */
    let after = 0;
    while (after !== null && jobs.length < this.limit) {
      /** @type {JobPage} */
      const answer = await get("/jobs", { state: this.state, campaign: this.campaign, after, limit: Math.min(200, this.limit - jobs.length) });
      jobs.push(...answer.items);
      after = answer.next;
    }
    this.jobs = jobs;
    this.hasMore = after !== null;
    this.draw();
    return jobs.length;
  }

  draw() {
    const key = this.place.contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
    this.table ??= new Table(this.place, `Jobs that are ${this.state}`, this.columns(), { id: (job) => String(job.id) });
    this.table.show(this.jobs ?? []);
    if (key) /** @type {HTMLElement | null} */ (this.place.querySelector(`[data-key="${CSS.escape(key)}"]`))?.focus();
    this.more.hidden = !this.hasMore || this.limit >= MOST;
    fill(this.more, el("button", { type: "button", onclick: () => this.showMore() }, "Show more"));
  }

  async showMore() {
    this.limit = Math.min(MOST, this.limit + 3 * PAGE);
    await this.refresh(this.now);
  }

  /** @returns {Column<JobView>[]} */
  columns() {
    const search = (/** @type {JobView} */ job) => el("a", { href: `/campaigns/${job.campaign_id}/searches/${encodeURIComponent(job.search)}` }, job.search);
    /** @type {Column<JobView>[]} */
    const shared = [
      { key: "id", title: "Job", cell: (job) => number(job.id, 0) },
      { key: "search", title: "Search", cell: search },
      { key: "what", title: "What", minor: true, cell: (job) => (job.seed_id ? `seed ${shortId(job.seed_id)}` : job.n_hops > 1 ? `chain of ${number(job.n_hops, 0)} hops` : "one start") },
    ];
    const own = { running: () => this.running(), queued: () => this.queued(), dead: () => this.dead() };
    return [...shared, ...own[this.state]()];
  }

  /** @returns {Column<JobView>[]} */
  running() {
    const since = (/** @type {string} */ moment) => duration((this.now - Date.parse(moment)) / 1000);
    // The lease was given, or renewed, one lease before it ends.
    const age = (/** @type {JobView} */ job) => (job.lease_until ? duration(this.leaseS - (Date.parse(job.lease_until) - this.now) / 1000) : NONE);
    return [
      { key: "worker", title: "Worker", minor: true, cell: (job) => job.worker },
      { key: "attempt", title: "Attempt", numeric: true, minor: true, cell: (job) => number(job.attempt, 0) },
      { key: "since", title: "Running for", numeric: true, cell: (job) => (job.is_cancelling ? "stopping" : since(job.updated_at)) },
      { key: "lease", title: "Lease age", numeric: true, cell: age },
      { key: "do", title: "", cell: (job) => this.button(job, "cancel", "Cancel", job.is_cancelling, () => this.askCancel(job)) },
    ];
  }

  /** @returns {Column<JobView>[]} */
  queued() {
    return [
      { key: "since", title: "Waiting for", numeric: true, cell: (job) => duration((this.now - Date.parse(job.updated_at)) / 1000) },
      { key: "failures", title: "Failures", numeric: true, minor: true, cell: (job) => number(job.n_failures, 0) },
      { key: "not_before", title: "Not before", minor: true, cell: (job) => (job.not_before && Date.parse(job.not_before) > this.now ? date(job.not_before) : "now") },
      { key: "do", title: "", cell: (job) => this.button(job, "cancel", "Cancel", false, () => this.askCancel(job)) },
    ];
  }

  /** @returns {Column<JobView>[]} */
  dead() {
    return [
      { key: "attempt", title: "Attempts", numeric: true, minor: true, cell: (job) => number(job.attempt, 0) },
      { key: "when", title: "Dead since", minor: true, cell: (job) => date(job.updated_at) },
      { key: "error", title: "What went wrong", cell: (job) => this.error(job) },
      { key: "do", title: "", cell: (job) => this.button(job, "requeue", "Requeue", false, () => askRequeue(job, this.onChanged)) },
    ];
  }

  /** @param {JobView} job */
  error(job) {
    const attempts = this.opened.get(job.id);
    const words = job.error ?? job.ending ?? NONE;
    const press = () => this.toggle(job);
    const button = el("button", { type: "button", class: "error link", "data-key": `error-${job.id}`, "aria-expanded": String(attempts !== undefined), onclick: press }, words);
    return el("div", {}, button, attempts?.map(attemptWords));
  }

  /** @param {JobView} job */
  async toggle(job) {
    if (this.opened.has(job.id)) this.opened.delete(job.id);
    else {
      /** @type {AttemptsOfJob} */
      const { items } = await get(`/jobs/${job.id}/attempts`);
      this.opened.set(job.id, items);
    }
    this.draw();
  }

  /**
   * @param {JobView} job
   * @param {string} verb
   * @param {string} words
   * @param {boolean} isDone
   * @param {() => void} press
   */
  button(job, verb, words, isDone, press) {
    return this.mayChange && el("button", { type: "button", "data-key": `${verb}-${job.id}`, "aria-label": `${words} job ${job.id}`, disabled: isDone, onclick: press }, words);
  }

  /** @param {JobView} job */
  askCancel(job) {
    const words = job.state === "running" ? "Its worker is told to stop. Results that it still reports in time are kept." : "It is taken out of the queue.";
    confirm(`Cancel job ${job.id}?`, [el("p", {}, `${words} It can be requeued later.`)], "Cancel the job", () => this.act(`/jobs/${job.id}/cancel`), { isDangerous: true });
  }

  /** @param {string} path */
  async act(path) {
    await post(path);
    await this.onChanged();
  }
}

/** @param {AttemptDetail} one */
function attemptWords(one) {
  return el(
    "div",
    { class: "attempt" },
    el("p", { class: "muted" }, `Attempt ${one.attempt}, ${date(one.started_at)}, on ${one.worker}: ${one.ending ?? "running"}`),
    one.error && el("pre", {}, one.error),
  );
}
