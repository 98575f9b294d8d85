/** One campaign: progress, strategies compared, dead jobs, and its controls. */

import { ApiError, get } from "../api.js";
import { askRequeue, askWeight, campaignControls, exportLink, mayControl, session } from "../controls.js";
import { byId, el, fill } from "../dom.js";
import { duration, NONE, number } from "../format.js";
import { BestSoFar, Boxes, Feasibility, OutcomeMix, showChains } from "../history.js";
import { tellTolerancesOf } from "../looks.js";
import { facts, Page, pathPart, showEmpty, showFacts, showTitle } from "../page.js";
import { showSearches } from "../searches.js";
import { Table } from "../table.js";

/**
 * @import { Child } from "../dom.js"
 * @import { CampaignView, HistoryView, JobPage, JobView, SessionView } from "../../types"
 */

/** After a start the service reads a large archive in pieces; meanwhile the page polls this often [ms]. */
const READ_ON_MS = 250;

const id = Number(pathPart(1));
const figures = [
  new BestSoFar(byId("best-so-far")),
  new OutcomeMix(byId("outcome-mix")),
  new Feasibility(byId("feasibility")),
  new Boxes(byId("delta-v")),
];
/** @type {HistoryView | undefined} */
let shown;
let mayChange = false;

const page = new Page({ events: `/campaigns/${id}/events`, refresh, redraw: () => shown && draw(shown) });
const changed = () => page.reload();
const who = session();
page.start();

async function refresh() {
  // Not awaited yet: in a large archive it takes longer than the rest of the page.
  /** @type {Promise<HistoryView>} */
  const asked = get(`/campaigns/${id}/history`);
  asked.catch(() => {});
  /** @type {[CampaignView, SessionView | null] | null} */
  const found = await Promise.all([get(`/campaigns/${id}`), who]).catch(missing);
  if (!found) return;
  const [campaign, user] = found;
  mayChange = mayControl(user);
  showEmpty();
  showHead(campaign);
  showSearches(id, campaign.searches, mayChange ? (search) => askWeight(id, search, changed) : null);
  if (!shown) await tellTolerancesOf(campaign.searches[0]?.cases ?? []);
  await showJobs(campaign);
  const history = await asked;
  showReading(history);
  showChains(byId("chains"), history.chains);
  // Figures are expensive: they are redrawn only when their data has changed.
  if (JSON.stringify(history) !== JSON.stringify(shown)) await draw(history);
}

/**
 * @param {unknown} error
 * @returns {null}
 */
function missing(error) {
  if (!(error instanceof ApiError) || error.status !== 404) throw error;
  showTitle("No such campaign", [["Campaigns", "/"]]);
  showEmpty(el("p", {}, error.message), el("p", {}, el("a", { href: "/" }, "All campaigns")));
  return null;
}

/** @param {HistoryView} history */
async function draw(history) {
  shown = history;
  for (const figure of figures) await figure.show(history);
}

/** @param {CampaignView} campaign */
function showHead(campaign) {
  showTitle(campaign.name, [["Campaigns", "/"]]);
  byId("state").textContent = campaign.state;
  byId("state").dataset.state = campaign.state;
  const focused = document.activeElement?.getAttribute("data-does");
  const buttons = mayChange ? campaignControls(campaign, changed) : [];
  const links = [
    el("a", { class: "button", href: `/archive?campaign=${id}` }, "Solutions"),
    el("a", { class: "button", href: `/campaigns/new?clone=${id}` }, "Clone"),
    exportLink(campaign),
  ];
  fill(byId("actions"), links, buttons);
  if (focused) /** @type {HTMLElement | null} */ (byId("actions").querySelector(`[data-does="${focused}"]`))?.focus();
  showFacts(headFacts(campaign));
}

/**
 * @param {CampaignView} campaign
 * @returns {[string, Child][]}
 */
function headFacts(campaign) {
  const isOver = campaign.state === "done" || campaign.state === "cancelled";
  const planned = campaign.searches.map((search) => search.n_guesses_planned);
  const sum = planned.includes(null) ? null : planned.reduce((all, n) => (all ?? 0) + (n ?? 0), 0);
  const guesses = sum === null ? number(campaign.n_solves, 0) : `${number(campaign.n_solves, 0)} of ${number(Math.max(sum, campaign.n_solves), 0)}`;
  /** @type {[string, string][]} */
  const going = [["Remaining", duration(campaign.eta_seconds)], ["Rate", number(campaign.rate_per_min, 1, "guesses/min")]];
  /** @type {[string, string]} */
  const priority = ["Priority", String(campaign.priority)];
  return [
    ["Best Δv", number(campaign.best_delta_v_km_s, 4, "km/s")],
    ["Guesses", guesses],
    ["Solutions", number(campaign.n_solutions, 0)],
    ["Elapsed", duration(campaign.elapsed_seconds)],
    ...(isOver ? [] : going),
    ["CPU", duration(campaign.cpu_seconds)],
    ...(campaign.priority === 0 ? [] : [priority]),
    ["rng_seed", String(campaign.rng_seed)],
  ];
}

/** @param {HistoryView} history */
function showReading(history) {
  const isPart = history.n_read < history.n_solves;
  byId("reading").hidden = !isPart;
  fill(byId("reading"), `Reading the archive: figures show the first ${number(history.n_read, 0)} of ${number(history.n_solves, 0)} solves.`);
  if (isPart) window.setTimeout(() => page.receive(null), READ_ON_MS);
}

const dead = /** @type {Table<JobView>} */ (
  new Table(
    byId("dead"),
    "Dead jobs",
    [
      { key: "id", title: "Dead job", cell: (job) => String(job.id) },
      { key: "kind", title: "Kind", cell: (job) => job.kind, minor: true },
      { key: "attempt", title: "Attempts", numeric: true, minor: true, cell: (job) => String(job.attempt) },
      { key: "error", title: "What went wrong", cell: (job) => el("span", { class: "error" }, job.error ?? job.ending ?? NONE) },
      { key: "again", title: "", cell: (job) => mayChange && el("button", { type: "button", "aria-label": `Requeue job ${job.id}`, onclick: () => askRequeue(job, changed) }, "Requeue") },
    ],
    { id: (job) => String(job.id) },
  )
);

/** @param {CampaignView} campaign */
async function showJobs(campaign) {
  const of = (/** @type {"queued" | "running" | "done" | "dead" | "cancelled"} */ state) => campaign.searches.reduce((sum, search) => sum + search.jobs[state], 0);
  const link = (/** @type {"queued" | "running" | "dead"} */ state) => el("a", { href: `/workers?campaign=${id}&state=${state}` }, number(of(state), 0));
  fill(byId("jobs"), facts([["Waiting", link("queued")], ["Running", link("running")], ["Done", number(of("done"), 0)], ["Dead", link("dead")], ["Cancelled", number(of("cancelled"), 0)]]));
  byId("jobs-link").setAttribute("href", `/workers?campaign=${id}`);
  byId("dead").hidden = of("dead") === 0;
  if (of("dead") === 0) return dead.show([]);
  /** @type {JobPage} */
  const { items } = await get("/jobs", { campaign: id, state: "dead", limit: 20 });
  dead.show(items);
}
