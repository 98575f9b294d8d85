/** A comparison: up to four solutions side by side, named by the address. */

import { ApiError, find, get } from "../api.js";
import { MOST, idsOfAddress } from "../archive/choice.js";
import { showNumbers } from "../compare/numbers.js";
import { Overlay } from "../compare/overlay.js";
import { Profiles } from "../compare/profiles.js";
import { byId, el, fill } from "../dom.js";
import { FRAMES } from "../flight.js";
import { Page, parameter, setParameters, showEmpty, showTitle } from "../page.js";

/**
 * @typedef {import("../flight.js").Frame} Frame
 * @typedef {import("../compare/sides.js").Side} Side
 */

const overlay = new Overlay(byId("overlay"), (frame) => change({ frame }), (isShown) => change({ realizations: isShown || null }));
const profiles = new Profiles(byId("profiles"));
/** What has been read, by id. @type {Map<string, Side>} */
const known = new Map();
/** Pictures one after the other: a second drawing must not overtake the first. */
let drawing = Promise.resolve();

async function refresh() {
  const ids = idsOfAddress("ids");
  const found = await Promise.all(ids.map(side));
  const sides = found.filter((one) => one !== null);
  showTitle(sides.length ? `Comparison of ${sides.length}` : "Comparison", [["Archive", "/archive"]]);
  fill(byId("actions"), el("a", { class: "button", id: "choose", href: `/archive${sides.length ? `?chosen=${sides.map(({ id }) => id).join(",")}` : ""}` }, "Choose in the archive"));
  if (sides.length === 0) return showEmpty(...none(ids.length > 0));
  showEmpty();
  if (sides.length < ids.length) refuse(`${ids.length - sides.length} of the solutions in the address are not in this archive.`);
  byId("add").hidden = sides.length >= MOST;
  showNumbers(sides, (id) => choose(ids.filter((one) => one !== id)));
  drawing = drawing.then(() => fly(sides)).then(draw);
}

/** @param {boolean} areUnknown */
function none(areUnknown) {
  return [
    el("h2", {}, areUnknown ? "No such solutions" : "Nothing to compare yet"),
    el("p", {}, "Choose two to four solutions by the boxes of the table in the archive."),
    el("p", {}, el("a", { class: "button primary", href: "/archive" }, "Go to the archive")),
  ];
}

/**
 * @param {string} id
 * @returns {Promise<Side | null>}
 */
async function side(id) {
  const mine = known.get(id);
  if (mine) return mine;
  const record = await find(`/solutions/${id}`);
  if (!record) return null;
  const read = { id, record, flight: null };
  known.set(id, read);
  return read;
}

/** @param {Side[]} sides */
async function fly(sides) {
  const missing = sides.filter(({ flight }) => flight === null);
  overlay.waiting.hidden = missing.length === 0;
  const failed = [];
  for (const one of missing) {
    try {
      one.flight = await get(`/solutions/${one.id}/trajectory`);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      failed.push(error.message);
    }
  }
  if (failed.length) refuse(`Not drawn: ${failed.join("; ")}`);
}

async function draw() {
  const sides = idsOfAddress("ids").flatMap((id) => known.get(id) ?? []);
  const flown = sides.filter(({ flight }) => flight !== null);
  overlay.waiting.hidden = true;
  if (flown.length === 0) return;
  const given = parameter("frame");
  const frame = /** @type {Frame} */ (FRAMES.some(({ id }) => id === given) ? given : "rotating");
  const hasRealizations = parameter("realizations") === "true";
  await overlay.show(sides, frame, hasRealizations);
  await profiles.show(sides, hasRealizations);
}

/** @param {Record<string, string | boolean | null>} values */
function change(values) {
  setParameters(values);
  drawing = drawing.then(draw);
}

/** @param {string[]} ids */
function choose(ids) {
  byId("refused").hidden = true;
  setParameters({ ids: ids.join(",") || null });
  return page.reload();
}

/** @param {string} words */
function refuse(words) {
  byId("refused").hidden = false;
  fill(byId("refused"), words);
}

byId("add").addEventListener("submit", async (event) => {
  event.preventDefault();
  const field = /** @type {HTMLInputElement} */ (byId("another"));
  const id = /[0-9a-f]{32}/.exec(field.value)?.[0];
  const ids = idsOfAddress("ids");
  if (!id) return refuse("Solution: expected its 32 digits or the address of its page; both stand on that page.");
  if (ids.includes(id)) return refuse("This solution is compared already.");
  if (!(await side(id))) return refuse(`No solution of this archive has the id ${id}.`);
  field.value = "";
  await choose([...ids, id]);
});

const page = new Page({ events: null, refresh, redraw: () => page.reload() });
window.addEventListener("popstate", () => page.reload());
page.start();
