// @ts-check
/** The live page: what the address asks for, what the service says, and which view shows it. */

import * as api from "./api.js";
import { byId, el, fill } from "./dom.js";
import { showCampaign, showCampaignList, showConnection } from "./header.js";
import { EventStream } from "./live.js";
import { showProfile } from "./profile.js";
import { showRecord } from "./record.js";
import { showSearches } from "./searches.js";
import { SolutionTable } from "./solutions.js";
import { watchTheme } from "./theme.js";
import { FRAMES, showTrajectory } from "./trajectory.js";

/** At most one redraw in this time, however many events come. */
const REFRESH_MS = 1000;
/** How often a page without a campaign looks for one. */
const WELCOME_MS = 3000;

class LivePage {
  constructor() {
    this.table = new SolutionTable((id) => this.choose(id));
    /** @type {api.Campaign | undefined} */
    this.campaign = undefined;
    /** @type {{ record: api.Record_, flight: api.Flight } | undefined} */
    this.shown = undefined;
    this.fetchedAt = 0;
    this.lastHeard = new Date();
    this.wantsSolutions = true;
    this.wantsRefresh = false;
    /** @type {number | undefined} */
    this.pending = undefined;
  }

  async start() {
    watchTheme(() => this.redraw());
    this.frameTabs();
    byId("campaigns").addEventListener("change", (event) => {
      window.location.search = `?campaign=${/** @type {HTMLSelectElement} */ (event.target).value}`;
    });
    window.addEventListener("popstate", () => this.followAddress());
    await this.open();
  }

  async open() {
    const items = await api.campaigns().catch(() => null);
    if (!items?.length) {
      this.welcome(items === null);
      window.setTimeout(() => this.open(), WELCOME_MS);
      return;
    }
    byId("welcome").hidden = true;
    byId("campaign-view").hidden = false;
    const asked = Number(this.parameter("campaign"));
    this.campaignId = items.some(({ id }) => id === asked) ? asked : items[0].id;
    showCampaignList(items, this.campaignId);
    await this.refresh();
    this.stream = new EventStream(this.campaignId, (kind) => this.onEvent(kind), (connection) => this.onConnection(connection));
    window.setInterval(() => this.campaign && showCampaign(this.campaign, this.fetchedAt), 1000);
  }

  /** @param {boolean} unreachable */
  welcome(unreachable) {
    byId("campaign-view").hidden = true;
    byId("welcome").hidden = false;
    byId("campaign-state").textContent = unreachable ? "offline" : "idle";
    showConnection(unreachable ? "stopped" : "live", this.lastHeard);
    fill(
      byId("welcome"),
      el("h2", {}, "No campaign yet"),
      el("p", {}, "A campaign is a search that you describe in a file. Start one in a terminal and it appears here:"),
      el("pre", {}, "coastarc run examples/quick.toml"),
      el("p", { class: "muted" }, "To hand it to this coordinator instead: ", el("code", {}, "coastarc submit examples/quick.toml")),
    );
  }

  // -- live --------------------------------------------------------------------------------------

  /** @param {string} kind */
  onEvent(kind) {
    if (kind === "solution" || kind === "reconnected") this.wantsSolutions = true;
    this.wantsRefresh = true;
    this.scheduleRefresh();
  }

  /** Refresh at once after a quiet second, else when the second is over; never twice at a time. */
  scheduleRefresh() {
    if (this.pending !== undefined || !this.wantsRefresh) return;
    const wait = Math.max(0, REFRESH_MS - (performance.now() - this.fetchedAt));
    this.pending = window.setTimeout(async () => {
      this.wantsRefresh = false;
      await this.refresh();
      this.pending = undefined;
      this.scheduleRefresh();
    }, wait);
  }

  /** @param {import("./live.js").Connection} connection */
  onConnection(connection) {
    if (connection === "live") this.lastHeard = new Date();
    else api.session().catch(() => {});
    showConnection(connection, this.lastHeard);
  }

  async refresh() {
    try {
      const campaign = await api.campaign(/** @type {number} */ (this.campaignId));
      this.campaign = campaign;
      this.fetchedAt = performance.now();
      this.lastHeard = new Date();
      showCampaign(campaign, this.fetchedAt);
      showSearches(campaign.searches);
      if (this.wantsSolutions) await this.refreshSolutions(campaign);
    } catch (error) {
      // A silent coordinator is the stream's to report; it asks again when the line is back.
      if (!(error instanceof api.ApiError)) throw error;
    }
  }

  /** @param {api.Campaign} campaign */
  async refreshSolutions(campaign) {
    const { items } = await api.solutions(campaign.id);
    this.wantsSolutions = false;
    this.table.show(items, campaign);
    // Without a choice in the address the page follows the best solution as it changes.
    const id = this.parameter("solution") ?? best(items);
    if (id) await this.show(id);
    else this.nothingChosen();
  }

  // -- the chosen solution -----------------------------------------------------------------------

  /** @param {string} id */
  choose(id) {
    this.setParameter("solution", id);
    this.show(id);
  }

  followAddress() {
    this.markTabs();
    this.wantsSolutions = true;
    this.refresh().then(() => this.redraw());
  }

  /** @param {string} id */
  async show(id) {
    this.table.choose(id);
    if (this.shown?.record.id === id) return;
    this.wanted = id;
    byId("chosen-empty").hidden = true;
    try {
      const [record, flight] = await Promise.all([api.solution(id), api.trajectory(id)]);
      // A slow answer must not replace a later choice.
      if (this.wanted !== id) return;
      this.shown = { record, flight };
      byId("pictures").hidden = false;
      showRecord(record, (seed) => this.choose(seed));
      await this.redraw();
      byId("chosen").dataset.solution = id;
    } catch (error) {
      if (this.wanted === id && error instanceof api.ApiError) this.nothingChosen(error.message);
    }
  }

  /** @param {string} [reason] */
  nothingChosen(reason) {
    byId("pictures").hidden = !this.shown;
    byId("chosen-empty").hidden = false;
    byId("chosen-empty").textContent = reason ?? "The best solution is drawn here as soon as there is one.";
  }

  async redraw() {
    if (!this.shown) return;
    await showTrajectory(this.shown.flight, this.frame());
    await showProfile(this.shown.flight);
  }

  // -- frames and address ------------------------------------------------------------------------

  /** @returns {import("./trajectory.js").Frame} */
  frame() {
    const asked = this.parameter("frame");
    return FRAMES.find(({ id }) => id === asked)?.id ?? "rotating";
  }

  frameTabs() {
    const tabs = FRAMES.map(({ id, title }) =>
      el("button", { type: "button", role: "tab", "data-frame": id, "aria-controls": "trajectory", onclick: () => this.setFrame(id) }, title),
    );
    fill(byId("frames"), tabs);
    byId("frames").addEventListener("keydown", (event) => {
      const key = /** @type {KeyboardEvent} */ (event).key;
      const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!step) return;
      const next = FRAMES.findIndex(({ id }) => id === this.frame()) + step;
      this.setFrame(FRAMES[(next + FRAMES.length) % FRAMES.length].id);
      /** @type {HTMLElement} */ (byId("frames").querySelector("[aria-selected=true]")).focus();
    });
    this.markTabs();
  }

  /** @param {import("./trajectory.js").Frame} id */
  setFrame(id) {
    this.setParameter("frame", id);
    this.markTabs();
    this.redraw();
  }

  markTabs() {
    for (const tab of byId("frames").children) {
      const chosen = tab.getAttribute("data-frame") === this.frame();
      tab.setAttribute("aria-selected", String(chosen));
      tab.setAttribute("tabindex", chosen ? "0" : "-1");
    }
  }

  /** @param {string} name */
  parameter(name) {
    return new URLSearchParams(window.location.search).get(name);
  }

  /**
   * @param {string} name
   * @param {string} value
   */
  setParameter(name, value) {
    const parameters = new URLSearchParams(window.location.search);
    parameters.set("campaign", String(this.campaignId));
    parameters.set(name, value);
    history.pushState(null, "", `?${parameters}`);
  }
}

/**
 * Return the solution to show unasked: the cheapest strict one among those that survive most outages.
 * @param {api.Record_[]} records
 */
function best(records) {
  const strict = records.filter((record) => record.strict);
  const candidates = strict.length ? strict : records;
  const k = Math.max(...candidates.map((record) => record.k));
  return candidates.filter((record) => record.k === k).sort((a, b) => a.delta_v_km_s - b.delta_v_km_s)[0]?.id;
}

new LivePage().start();
