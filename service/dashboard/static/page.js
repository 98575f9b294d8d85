/** What every page has: theme, connection, title, and a view that updates itself. */

import { ApiError, get, ROOT } from "./api.js";
import { byId, el, fill } from "./dom.js";
import { clock } from "./format.js";
import { watchTheme } from "./theme.js";

/**
 * @import { Child } from "./dom.js"
 * @import { EventView } from "../types"
 */

/** Least time between two refreshes, however many events come [ms]. */
const REFRESH_MS = 1000;
/** A hidden page closes its stream after this time: a browser has six connections to a host [ms]. */
const HIDDEN_MS = 60_000;

const CONNECTIONS = { live: "live", connecting: "reconnecting", stopped: "offline" };

/**
 * @typedef {{
 *   events: string | null,
 *   refresh: (events: EventView[], isAll: boolean) => Promise<void>,
 *   redraw?: () => void,
 * }} View  `events`: path of the stream, or null for a page that does not change;
 *   `refresh` reads and shows: all of it (isAll), or what the events since the last time are about;
 *   `redraw` draws all figures again, in the colours of another theme.
 */

export class Page {
  /** @param {View} view */
  constructor(view) {
    this.view = view;
    /** @type {EventView[]} */
    this.waiting = [];
    this.wantsAll = true;
    this.isBusy = false;
    this.lastHeard = new Date();
    this.refreshedAt = -Infinity;
    /** @type {EventStream | undefined} */
    this.stream = undefined;
  }

  /** Show the view and keep it up to date. */
  async start() {
    watchTheme(() => this.refreshedAt > 0 && this.view.redraw?.());
    await this.refresh();
    if (this.view.events === null) return showConnection("still", this.lastHeard);
    this.follow();
    document.addEventListener("visibilitychange", () => this.visibilityChanged());
  }

  /** Read everything again, as after a change that this page has made. */
  async reload() {
    this.wantsAll = true;
    await this.refresh();
  }

  follow() {
    const path = /** @type {string} */ (this.view.events);
    this.stream = new EventStream(path, (event) => this.receive(event), (connection) => this.connected(connection));
  }

  visibilityChanged() {
    window.clearTimeout(this.hiding);
    if (document.hidden) {
      this.hiding = window.setTimeout(() => {
        this.stream?.close();
        this.stream = undefined;
      }, HIDDEN_MS);
    } else if (!this.stream) {
      this.follow();
      this.receive(null);
    }
  }

  /** @param {EventView | null} event */
  receive(event) {
    if (event === null) this.wantsAll = true;
    else this.waiting.push(event);
    this.schedule();
  }

  /** Schedule a refresh: at most one a second, never two at a time. */
  schedule() {
    if (this.isBusy || this.pending !== undefined || !(this.wantsAll || this.waiting.length)) return;
    const wait = Math.max(0, REFRESH_MS - (performance.now() - this.refreshedAt));
    this.pending = window.setTimeout(async () => {
      this.pending = undefined;
      await this.refresh();
      this.schedule();
    }, wait);
  }

  async refresh() {
    const [events, isAll] = [this.waiting, this.wantsAll];
    [this.waiting, this.wantsAll, this.isBusy] = [[], false, true];
    try {
      await this.view.refresh(events, isAll);
      this.lastHeard = new Date();
      document.body.dataset.refreshed = String(Number(document.body.dataset.refreshed ?? 0) + 1);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      // The stream reports an unreachable coordinator, and reads again when the connection is back.
      if (error.status !== 0) showFault(error.message);
      this.wantsAll = this.wantsAll || isAll;
    } finally {
      this.refreshedAt = performance.now();
      this.isBusy = false;
    }
  }

  /** @param {Connection} connection */
  connected(connection) {
    if (connection === "live") this.lastHeard = new Date();
    // A refused stream gives no reason; a request does, and leads to signing in.
    else get("/session").catch(() => {});
    showConnection(connection, this.lastHeard);
  }
}

/**
 * @param {Connection | "still"} connection
 * @param {Date} lastHeard
 */
function showConnection(connection, lastHeard) {
  const dot = byId("connection");
  dot.dataset.connection = connection;
  dot.textContent = connection === "still" ? "" : CONNECTIONS[connection];
  const notice = byId("notice");
  notice.hidden = connection !== "stopped";
  if (connection !== "stopped") return;
  fill(
    notice,
    el("strong", {}, "The coordinator has stopped, or cannot be reached."),
    ` Below is what it last reported, at ${clock(lastHeard)}. Results are safe in its database; this page `,
    "resumes once ",
    el("code", {}, "coastarc run"),
    " or ",
    el("code", {}, "coastarc serve"),
    " is running again.",
  );
}

/**
 * Show why the service refused a request.
 * @param {string} words
 */
function showFault(words) {
  const notice = byId("notice");
  notice.hidden = false;
  fill(notice, words);
}

/**
 * Set the title of the page.
 * @param {string} words
 * @param {[string, string][]} [crumbs] titles and addresses of the pages above it
 */
export function showTitle(words, crumbs = []) {
  document.title = `${words} · coastarc`;
  byId("title").textContent = words;
  byId("crumbs").hidden = crumbs.length === 0;
  fill(byId("crumbs"), crumbs.map(([title, href]) => el("a", { href }, title)));
}

/**
 * Show the numbers below the title.
 * @param {[string, Child][]} all
 */
export function showFacts(all) {
  fill(byId("facts"), facts(all));
}

/**
 * Return names and values as the children of a description list.
 * @param {[string, Child][]} all
 */
export function facts(all) {
  return all.map(([name, value]) => el("div", { class: "fact" }, el("dt", {}, name), el("dd", {}, value)));
}

/**
 * Show why there is no content and what to do next; without arguments, show the content.
 * @param {...(Child)} words
 */
export function showEmpty(...words) {
  byId("empty").hidden = words.length === 0;
  byId("content").hidden = words.length > 0;
  fill(byId("empty"), words);
}

/**
 * Return a part of the address of this page, counted from 0.
 * @param {number} place
 */
export function pathPart(place) {
  return decodeURIComponent(window.location.pathname.split("/").filter(Boolean)[place] ?? "");
}

/**
 * Return a parameter of the address.
 * @param {string} name
 */
export function parameter(name) {
  return new URLSearchParams(window.location.search).get(name);
}

/**
 * Change parameters of the address, so that it can be shared; null takes one away.
 * @param {Record<string, string | number | boolean | null>} values
 */
export function setParameters(values) {
  const all = new URLSearchParams(window.location.search);
  for (const [name, value] of Object.entries(values)) {
    if (value === null || value === "") all.delete(name);
    else all.set(name, String(value));
  }
  const written = all.toString();
  history.pushState(null, "", window.location.pathname + (written ? `?${written}` : ""));
}

const RETRY_MS = [1000, 2000, 5000, 10000];
/** A connection lost for longer than this is shown as a stopped coordinator [ms]. */
const PATIENCE_MS = 6000;

/** @typedef {"live" | "connecting" | "stopped"} Connection */

export class EventStream {
  /**
   * @param {string} path of the stream, below the root of the API
   * @param {(event: EventView | null) => void} onEvent null stands for all that was missed while disconnected
   * @param {(connection: Connection) => void} onConnection
   */
  constructor(path, onEvent, onConnection) {
    this.address = ROOT + path;
    this.onEvent = onEvent;
    this.onConnection = onConnection;
    this.failures = 0;
    /** @type {number | undefined} */
    this.patience = undefined;
    this.closed = false;
    this.open();
  }

  open() {
    if (this.closed) return;
    const from = this.lastId ? `?after=${encodeURIComponent(this.lastId)}` : "";
    this.source = new EventSource(this.address + from);
    this.source.onopen = () => this.connected();
    this.source.onerror = () => this.disconnected();
    this.source.onmessage = (event) => this.receive(event);
  }

  /** @param {MessageEvent} event */
  receive(event) {
    this.lastId = event.lastEventId || this.lastId;
    this.onEvent(JSON.parse(event.data));
  }

  connected() {
    window.clearTimeout(this.patience);
    this.patience = undefined;
    const again = this.failures > 0;
    this.failures = 0;
    this.onConnection("live");
    // What happened while disconnected is read once, whatever the stream replays.
    if (again) this.onEvent(null);
  }

  disconnected() {
    // Browsers differ in when they reconnect, so reconnecting is always done here.
    this.source?.close();
    if (this.closed) return;
    this.patience ??= window.setTimeout(() => this.onConnection("stopped"), PATIENCE_MS);
    if (this.failures === 0) this.onConnection("connecting");
    const wait = RETRY_MS[Math.min(this.failures, RETRY_MS.length - 1)];
    this.failures += 1;
    window.setTimeout(() => this.open(), wait);
  }

  close() {
    this.closed = true;
    window.clearTimeout(this.patience);
    this.source?.close();
  }
}
