/** Workers: who is there, how busy they are, and what they need. */

import { el } from "./dom.js";
import { duration, NONE, number } from "./format.js";
import { Table } from "./table.js";

/**
 * @typedef {{
 *   name: string, host: string, executor: string, slots: number, code_version: string, python_version: string,
 *   cpu_cores: number | null, memory_bytes: number | null, host_memory_bytes: number | null, created_at: string, seen_at: string,
 *   is_alive: boolean, held: { job_id: number, attempt: number, lease_until: string }[],
 * }} Worker
 */

const GIB = 2 ** 30;

export class WorkerTable {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.now = Date.now();
    const ago = (/** @type {string} */ moment) => duration((this.now - Date.parse(moment)) / 1000);
    /** @type {Table<Worker>} */
    this.table = new Table(
      place,
      "Workers, those seen last first",
      [
        { key: "name", title: "Worker", cell: (worker) => [el("strong", {}, worker.name), el("small", { class: "muted under" }, `${worker.executor} on ${worker.host}`)] },
        { key: "alive", title: "State", minor: true, cell: (worker) => el("span", { class: "pill", "data-state": worker.is_alive ? "active" : "gone" }, worker.is_alive ? "connected" : "gone") },
        { key: "slots", title: "Busy", cell: (worker) => meter(worker.held.length, worker.slots, `${number(worker.held.length, 0)} of ${number(worker.slots, 0)} slots`, "Slots in use") },
        { key: "cpu", title: "CPU", cell: (worker) => (worker.cpu_cores === null ? NONE : meter(worker.cpu_cores, worker.slots, number(worker.cpu_cores, 2, "cores"), "Processors in use")) },
        { key: "memory", title: "Memory", cell: memory },
        { key: "seen", title: "Last seen", numeric: true, minor: true, cell: (worker) => `${ago(worker.seen_at)} ago` },
        { key: "since", title: "Since", numeric: true, minor: true, cell: (worker) => `${ago(worker.created_at)} ago` },
        { key: "version", title: "Version", minor: true, cell: (worker) => [el("code", {}, worker.code_version), el("small", { class: "muted under" }, `Python ${worker.python_version}`)] },
      ],
      { id: (worker) => worker.name },
    );
  }

  /**
   * @param {Worker[]} workers
   * @param {number} now by the coordinator's clock [ms]
   */
  show(workers, now) {
    this.now = now;
    this.table.show(workers);
  }
}

/** @param {Worker} worker */
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
