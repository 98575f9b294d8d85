/** The certificate of a solution: what independent verification found, trajectory by trajectory. */

import { el, fill } from "./dom.js";
import { epoch, number, small } from "./format.js";
import { LEVELS } from "./looks.js";

/** @import { CertificateContent, CertificateDocument, CertifiedApproach, CertifiedTrajectory } from "../types" */

/**
 * @param {HTMLElement} place
 * @param {CertificateDocument | null} found
 * @param {string} id
 */
export function showCertificate(place, found, id) {
  if (!found) {
    const command = el("code", {}, `coastarc solutions verify ${id.slice(0, 8)}`);
    return fill(place, el("p", { class: "muted" }, "None yet. ", command, " verifies the solution independently and creates one."));
  }
  const { content } = found;
  const reasons = [...content.marks, content.failure].filter(Boolean);
  fill(
    place,
    el("p", {}, pill(content), " ", el("code", { id: "certificate-hash", title: "Hash of the content" }, found.hash)),
    reasons.length > 0 && el("ul", { class: "marks" }, reasons.map((reason) => el("li", {}, reason))),
    el("div", { class: "scroll inset" }, table(content.trajectories)),
    el("p", { class: "muted caption" }, words(found)),
  );
}

/** @param {CertificateContent} content */
function pill({ is_sound: isSound, is_marginal: isMarginal, level }) {
  const words = isSound && level !== "none" ? `sound, ${LEVELS[level]}` : "not sound";
  return el("span", { class: "pill", "data-verdict": isSound ? level : "none" }, isMarginal ? `${words}, marginal` : words);
}

/** @param {CertificateDocument} found */
function words(found) {
  const { min_altitude_km: least, min_altitudes_km: each } = found.content;
  const limits = Object.entries(each ?? {}).map(([body, km]) => `${number(km, 0, "km")} above the ${body}`);
  const limit = limits.join(" and ") || (least > 0 && number(least, 0, "km"));
  const again = found.checked_at === found.made_at ? "" : `, confirmed ${found.checked_at.slice(0, 10)}`;
  return (
    "Miss: distance from the target at arrival when a trajectory is propagated from the departure without any correction. " +
    `${limit ? `Approaches below ${limit} are marked.` : ""}${third(found.content)} Made ${found.made_at.slice(0, 10)} on ${found.made_on}` +
    `${again}${found.is_from_elsewhere ? "; imported from there, and not confirmed here" : ""}.`
  );
}

/** @param {CertificateContent} content */
function third({ third }) {
  if (!third) return "";
  const apart = third.trajectories.map((flown) => flown.apart[0] ?? Infinity);
  return ` Propagation with ${third.integrator} differs by at most ${small(Math.max(...apart), "km")}.`;
}

/** @param {CertifiedTrajectory[]} trajectories */
function table(trajectories) {
  const bodies = [...new Set(trajectories.flatMap(({ closest }) => closest.map(({ body }) => body)))];
  const titles = ["Trajectory", "Miss at arrival", ...bodies.map((body) => `Lowest above the ${body}`), "Propellant", "Final mass"];
  const head = el("thead", {}, el("tr", {}, titles.map((text, i) => el("th", { scope: "col", class: i ? "number" : null }, text))));
  const caption = el("caption", { class: "visually-hidden" }, "Verification of each trajectory");
  return el("table", {}, caption, head, el("tbody", {}, trajectories.map((flown) => row(flown, bodies))));
}

/**
 * @param {CertifiedTrajectory} flown
 * @param {string[]} bodies
 */
function row(flown, bodies) {
  const { mass, through } = flown;
  const miss = through.failure || small(through.arrival_miss[0], "km");
  return el(
    "tr",
    {},
    el("th", { scope: "row" }, flown.name),
    el("td", { class: "number" }, miss),
    ...bodies.map((body) => lowest(flown.closest.find((one) => one.body === body))),
    el("td", { class: "number", title: `departs with ${number(mass.departure, 2, "kg")}` }, number(mass.before_outage + mass.segments, 2, "kg")),
    el("td", { class: "number", title: `${number(mass.spare, 2, "kg")} above the dry mass` }, number(mass.arrival, 2, "kg")),
  );
}

/** @param {CertifiedApproach | undefined} approach */
function lowest(approach) {
  if (!approach) return el("td", { class: "number" }, "–");
  return el("td", { class: "number", title: epoch(approach.epoch) }, number(approach.altitude_km, 0, "km"));
}
