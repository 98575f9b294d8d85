/** Workers and jobs: who is connected, what they did, what waits, and dead jobs. */

import { get, post } from "../api.js";
import { Attempts, Gantt } from "../attempts.js";
import { confirm, mayControl, session } from "../controls.js";
import { byId, el, fill } from "../dom.js";
import { counted, duration, NONE, number } from "../format.js";
import { JobTable } from "../job_table.js";
import { Page, parameter, setParameters, showFacts } from "../page.js";
import { Table } from "../table.js";

/**
 * @import { State } from "../job_table.js"
 * @import { QueueItem, QueueView, SessionView, WorkerPage, WorkerView } from "../../types"
 */

const GIB = 2 ** 30;

export class WorkerTable {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.now = Date.now();
    const ago = (/** @type {string} */ moment) => duration((this.now - Date.parse(moment)) / 1000);
    /** @type {Table<WorkerView>} */
    this.table = new Table(
      place,
      "Workers, those seen last first",
      [
        { key: "name", title: "Worker", cell: (worker) => [el("strong", {}, worker.name), el("small", { class: "muted under" }, `${worker.executor} on ${worker.host}`)] },
        { key: "alive", title: "State", minor: true, cell: (worker) => el("span", { class: "pill", "data-state": worker.is_alive ? "active" : "gone" }, worker.is_alive ? "connected" : "gone") },
        { key: "slots", title: "Busy", cell: (worker) => meter(worker.held.length, worker.slots, `${number(worker.held.length, 0)} of ${number(worker.slots, 0)} slots`, "Slots in use") },
        { key: "cpu", title: "CPU", cell: (worker) => (worker.cpu_cores === null ? NONE : meter(worker.cpu_cores, worker.slots, number(worker.cpu_cores, 2, "cores"), "CPU cores in use")) },
        { key: "memory", title: "Memory", cell: memory },
        { key: "seen", title: "Last seen", numeric: true, minor: true, cell: (worker) => `${ago(worker.seen_at)} ago` },
        { key: "since", title: "Since", numeric: true, minor: true, cell: (worker) => `${ago(worker.created_at)} ago` },
        { key: "version", title: "Version", minor: true, cell: (worker) => [el("code", {}, worker.code_version), el("small", { class: "muted under" }, `Python ${worker.python_version}`)] },
      ],
      { id: (worker) => worker.name },
    );
  }

  /**
   * @param {WorkerView[]} workers
   * @param {number} now by the coordinator's clock [ms]
   */
  show(workers, now) {
    this.now = now;
    this.table.show(workers);
  }
}

/** @param {WorkerView} worker */
function memory(worker) {
  if (worker.memory_bytes === null) return NONE;
  const words = number(worker.memory_bytes / GIB, 2, "GiB");
  const whole = worker.host_memory_bytes;
  return meter(worker.memory_bytes, whole ?? worker.memory_bytes, whole ? `${words} of ${number(whole / GIB, 0, "GiB")}` : words, "Memory in use");
}

/**
 * Return a number with a bar below it that shows its share.
 * @param {number} value
 * @param {number} whole
 * @param {string} words
 * @param {string} name read out
 */
function meter(value, whole, words, name) {
  const share = whole > 0 ? Math.min(1, value / whole) : 0;
  const said = { role: "meter", "aria-label": name, "aria-valuemin": 0, "aria-valuemax": whole, "aria-valuenow": value, "aria-valuetext": words };
  return el("div", { class: "meter", ...said }, el("span", {}, words), el("div", { class: "track" }, el("i", { style: `width:${100 * share}%` })));
}

/** How often the page polls: leases and loads change without an event [ms]. */
const LOOK_MS = 5000;
const WINDOWS = /** @type {[string, number][]} */ ([["15 min", 900], ["1 h", 3600], ["6 h", 21_600]]);
const STATES = /** @type {[State, string][]} */ ([["running", "Running"], ["queued", "Waiting"], ["dead", "Dead"]]);
const MOST_GONE = 20;

const gone = /** @type {HTMLInputElement} */ (byId("gone"));
const chosen = /** @type {HTMLSelectElement} */ (byId("campaign"));
/** @type {WorkerView[]} */
let workers = [];
/** @type {QueueView | undefined} */
let queue;
/** @type {SessionView | null} */
let who = null;

const attempts = new Attempts(windowOf());
const gantt = new Gantt(byId("gantt"));
const workerTable = new WorkerTable(byId("workers"));
const page = new Page({ events: "/events/stream", refresh, redraw: () => gantt.redraw() });
const jobTable = new JobTable(byId("jobs"), byId("more"), () => page.reload());
const queueTable = /** @type {Table<QueueItem>} */ (
  new Table(
    byId("queue"),
    "Waiting, running and dead jobs by campaign",
    [
      { key: "name", title: "Campaign", cell: (item) => item.name },
      { key: "state", title: "State", minor: true, cell: (item) => el("span", { class: "pill", "data-state": item.state }, item.state) },
      { key: "queued", title: "Waiting", numeric: true, cell: (item) => number(item.jobs.queued, 0) },
      { key: "running", title: "Running", numeric: true, minor: true, cell: (item) => number(item.jobs.running, 0) },
      { key: "dead", title: "Dead", numeric: true, cell: (item) => number(item.jobs.dead, 0) },
      { key: "do", title: "", cell: (item) => mayControl(who) && item.jobs.dead > 0 && item.state !== "cancelled" && el("button", { type: "button", "data-does": `requeue-${item.campaign_id}`, onclick: () => askRequeueAll(item) }, "Requeue all dead") },
    ],
    { id: (item) => String(item.campaign_id), href: (item) => `/campaigns/${item.campaign_id}` },
  )
);

gone.addEventListener("change", showWorkers);
chosen.addEventListener("change", () => choose({ campaign: chosen.value || null }));
window.addEventListener("popstate", () => page.reload());
window.setInterval(() => document.hidden || page.receive(null), LOOK_MS);
page.start();

async function refresh() {
  who ??= await session();
  /** @type {[WorkerPage, QueueView]} */
  const [found, waiting] = await Promise.all([get("/workers"), get("/queue")]);
  [workers, queue] = [found.items, waiting];
  const now = Date.parse(waiting.at);
  if (attempts.seconds !== windowOf()) attempts.setWindow(windowOf());
  jobTable.mayChange = mayControl(who);
  jobTable.leaseS = waiting.lease_s;
  jobTable.choose(stateOf(), parameter("campaign"));
  const [, n] = await Promise.all([attempts.refresh(now), jobTable.refresh(now)]);
  showNumbers(waiting, now);
  showWorkers();
  gantt.show(attempts, now);
  showChoices(waiting, n);
  queueTable.show(waiting.campaigns);
  byId("queue").hidden = waiting.campaigns.length === 0;
  byId("queue-note").hidden = waiting.campaigns.length > 0;
}

/** @returns {State} */
function stateOf() {
  return STATES.find(([state]) => state === parameter("state"))?.[0] ?? (queue && !queue.jobs.running && queue.jobs.dead ? "dead" : "running");
}

function windowOf() {
  return WINDOWS.find(([, seconds]) => String(seconds) === parameter("window"))?.[1] ?? WINDOWS[0][1];
}

/** @param {Record<string, string | number | null>} values */
async function choose(values) {
  setParameters(values);
  await page.reload();
}

/**
 * @param {QueueView} waiting
 * @param {number} now
 */
function showNumbers(waiting, now) {
  const alive = workers.filter((worker) => worker.is_alive);
  const sum = (/** @type {(worker: WorkerView) => number | null} */ value) => alive.reduce((all, worker) => all + (value(worker) ?? 0), 0);
  const isMeasured = alive.some((worker) => worker.cpu_cores !== null);
  const { jobs } = waiting;
  showFacts([
    ["Workers connected", number(alive.length, 0)],
    ["Slots in use", `${number(sum((worker) => worker.held.length), 0)} of ${number(sum((worker) => worker.slots), 0)}`],
    ["CPU", isMeasured ? number(sum((worker) => worker.cpu_cores), 2, "cores") : NONE],
    ["Memory", isMeasured ? number(sum((worker) => worker.memory_bytes) / 2 ** 30, 2, "GiB") : NONE],
    ["Jobs waiting", number(jobs.queued, 0)],
    ["Longest wait", waiting.oldest_queued_at ? duration((now - Date.parse(waiting.oldest_queued_at)) / 1000) : NONE],
    ["Dead jobs", number(jobs.dead, 0)],
    ["Done", number(jobs.done, 0)],
  ]);
}

function showWorkers() {
  const now = Date.parse(queue?.at ?? "");
  const away = workers.filter((worker) => !worker.is_alive);
  const alive = workers.filter((worker) => worker.is_alive);
  byId("gone-label").hidden = away.length === 0;
  byId("gone-words").textContent = `show ${number(Math.min(away.length, MOST_GONE), 0)} that ${away.length === 1 ? "is" : "are"} gone`;
  workerTable.show([...alive, ...(gone.checked ? away.slice(0, MOST_GONE) : [])], now);
  byId("workers").hidden = alive.length === 0 && !gone.checked;
  byId("workers-card").hidden = workers.length === 0;
  byId("no-worker").hidden = alive.length > 0;
  if (alive.length === 0) fill(byId("no-worker"), ...connectionHelp());
}

/** Return how to connect a worker, with a token where one is needed. */
function connectionHelp() {
  const waits = queue?.jobs.queued ?? 0;
  const command = `coastarc dispatch --url ${window.location.origin} --workers 2`;
  const needsToken = who !== null && who.name !== "loopback";
  return [
    el("h2", {}, "No worker is connected"),
    el("p", {}, waits ? `${counted(waits, "job is", "jobs are")} waiting for one. Start one here or on another machine:` : "No job can run. Start a worker here or on another machine:"),
    el("pre", {}, needsToken ? `${command} --token-file worker.token` : command),
    ...(needsToken
      ? [el("p", {}, "This coordinator requires a token with the role worker. An administrator creates one:"), el("pre", {}, `coastarc token create my-worker --role worker --out worker.token --url ${window.location.origin}`)]
      : []),
  ];
}

/**
 * @param {QueueView} waiting
 * @param {number} n jobs that are shown
 */
function showChoices(waiting, n) {
  const campaign = parameter("campaign");
  const state = stateOf();
  const named = waiting.campaigns.map(({ campaign_id: id, name }) => [String(id), name]);
  if (campaign && !named.some(([id]) => id === campaign)) named.push([campaign, `campaign ${campaign}`]);
  const options = [["", "all campaigns"], ...named];
  if (document.activeElement !== chosen) fill(chosen, options.map(([value, name]) => el("option", { value, selected: value === (campaign ?? "") }, name)));
  const counts = campaign ? (waiting.campaigns.find(({ campaign_id: id }) => String(id) === campaign)?.jobs ?? null) : waiting.jobs;
  tabs("states", STATES.map(([name, words]) => [name, `${words} ${number(counts?.[name] ?? 0, 0)}`]), state, (name) => choose({ state: name }));
  tabs("windows", WINDOWS.map(([words, seconds]) => [String(seconds), words]), String(windowOf()), (seconds) => choose({ window: seconds }));
  const none = { running: "No job is running.", queued: "No job is waiting.", dead: "No job is dead." };
  byId("jobs-note").hidden = n > 0;
  byId("jobs-note").textContent = none[state];
  byId("jobs").hidden = n === 0;
}

/**
 * @param {string} place
 * @param {[string, string][]} entries
 * @param {string} current
 * @param {(name: string) => void} press
 */
function tabs(place, entries, current, press) {
  const key = byId(place).contains(document.activeElement) ? document.activeElement?.getAttribute("data-key") : null;
  fill(byId(place), entries.map(([name, words]) => el("button", { type: "button", "data-key": name, "aria-pressed": String(name === current), onclick: () => press(name) }, words)));
  if (key) /** @type {HTMLElement | null} */ (byId(place).querySelector(`[data-key="${key}"]`))?.focus();
}

/** @param {QueueItem} item */
function askRequeueAll(item) {
  const words = [el("p", {}, `${counted(item.jobs.dead, "dead job gets", "dead jobs get")} another attempt, and their failures are forgotten; searches that were done become active again.`)];
  confirm(`Requeue all dead jobs of “${item.name}”?`, words, "Requeue them", async () => {
    await post(`/campaigns/${item.campaign_id}/requeue`);
    await page.reload();
  });
}
