/** The stream of events: one connection that repairs itself and says how it is. */

import { ROOT } from "./api.js";

const RETRY_MS = [1000, 2000, 5000, 10000];
/** A connection lost for longer than this is shown as a stopped coordinator. */
const PATIENCE_MS = 6000;

/**
 * @typedef {"live" | "connecting" | "stopped"} Connection
 * @typedef {{ id: number, campaign_id: number, kind: string, created_at: string, data: Record<string, any> }} Event_
 */

export class EventStream {
  /**
   * @param {string} path of the stream, below the root of the API
   * @param {(event: Event_ | null) => void} onEvent null stands for all that was missed while the line was down
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
    this.source.onerror = () => this.lost();
    this.source.onmessage = (event) => this.take(event);
  }

  /** @param {MessageEvent} event */
  take(event) {
    this.lastId = event.lastEventId || this.lastId;
    this.onEvent(JSON.parse(event.data));
  }

  connected() {
    window.clearTimeout(this.patience);
    this.patience = undefined;
    const again = this.failures > 0;
    this.failures = 0;
    this.onConnection("live");
    // What happened while the line was down is read once, whatever the stream replays.
    if (again) this.onEvent(null);
  }

  lost() {
    // Browsers differ in when they retry by themselves, so the retry is ours in every case.
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
