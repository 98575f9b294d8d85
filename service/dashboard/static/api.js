// @ts-check
/** The REST API as this page uses it. */

/**
 * @typedef {{ segment: number, duration_days: number }} Outage
 * @typedef {{ queued: number, running: number, done: number, dead: number, cancelled: number }} JobCounts
 * @typedef {{
 *   id: number, name: string, strategy: string, state: string, k: number,
 *   cases: { problem_hash: string, outages: Outage[] }[],
 *   mapping: string | null, seeds_from: string | null, jobs: JobCounts, n_guesses_planned: number | null,
 *   n_solves: number, n_paper: number, n_strict: number, n_solutions: number, endings: Record<string, number>,
 *   statuses: Record<string, number>, hops: number,
 *   best_solution_id: string | null, best_delta_v_km_s: number | null, best_propellant_kg: number | null,
 *   cpu_seconds: number }} Search
 * @typedef {{
 *   id: number, name: string, state: string, created_at: string, n_jobs: number, n_done: number,
 *   n_solves: number, n_solutions: number, best_delta_v_km_s: number | null }} CampaignItem
 * @typedef {CampaignItem & {
 *   finished_at: string | null, rng_seed: number, searches: Search[], rate_per_min: number,
 *   eta_seconds: number | null, elapsed_seconds: number, cpu_seconds: number }} Campaign
 * @typedef {{
 *   id: string, search: string, strategy: string, k: number, outages: Outage[], objective_kg: number,
 *   propellant_kg: number, delta_v_km_s: number, delta_v_total_km_s: number, shooting_days: number,
 *   initial_coast_days: number, final_coast_days: number, time_of_flight_days: number, arrival_epoch: string,
 *   insertion_epoch: string, defects_solved: (number | null)[][], defects_verified: (number | null)[][],
 *   paper: boolean, strict: boolean, status: string, n_iterations: number, n_evaluations: number,
 *   cpu_seconds: number, wall_seconds: number, rng_key: string, seed_id: string | null,
 *   mapping: string | null, code_version: string, created_at: string }} Record_
 * @typedef {{ kind: "coast" | "thrust" | "outage", segment: number, first: number, stop: number,
 *   throttle: number, in_plane_rad: number, out_of_plane_rad: number }} Arc
 * @typedef {{ outage: Outage | null, arcs: Arc[], matchpoint: number, days: number[], inertial_km: number[][],
 *   rotating_km: number[][], moon_km: number[][], speed_km_s: number[], mass_kg: number[] }} Trajectory
 * @typedef {{ days: number[], inertial_km: number[][], rotating_km: number[][], moon_km: number[][] }} Path
 * @typedef {{ trajectories: Trajectory[], moon: Path, target: Path }} Flight
 */

export const ROOT = "/api/v1";

/** A refusal of the service, or its silence (status 0). */
export class ApiError extends Error {
  /**
   * @param {number} status
   * @param {string} detail
   */
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

/**
 * @param {string} path
 * @returns {Promise<any>}
 */
async function get(path) {
  let response;
  try {
    response = await fetch(ROOT + path, { headers: { Accept: "application/json" } });
  } catch {
    throw new ApiError(0, "The coordinator does not answer.");
  }
  if (response.status === 401) return signIn();
  if (!response.ok) {
    const body = await response.json().catch(() => ({}));
    throw new ApiError(response.status, body.detail ?? response.statusText);
  }
  return response.json();
}

/**
 * Leave for the page that asks for a token, which leads back here; nothing is answered meanwhile.
 * @returns {Promise<never>}
 */
function signIn() {
  const here = window.location.pathname + window.location.search;
  window.location.assign(`/sign-in?next=${encodeURIComponent(here)}`);
  return new Promise(() => {});
}

/**
 * Ask who one is: an event stream that is refused does not say why.
 * @returns {Promise<{ name: string, role: string }>}
 */
export function session() {
  return get("/session");
}

/** @returns {Promise<CampaignItem[]>} */
export async function campaigns() {
  return (await get("/campaigns")).items;
}

/**
 * @param {number} id
 * @returns {Promise<Campaign>}
 */
export function campaign(id) {
  return get(`/campaigns/${id}`);
}

/** Most solutions that the table holds; the server sorts them by delta-v. */
export const TABLE_LIMIT = 200;

/**
 * @param {number} campaignId
 * @returns {Promise<{ items: Record_[], next: string | null }>}
 */
export function solutions(campaignId) {
  return get(`/solutions?campaign=${campaignId}&limit=${TABLE_LIMIT}`);
}

/**
 * @param {string} id
 * @returns {Promise<Record_>}
 */
export function solution(id) {
  return get(`/solutions/${encodeURIComponent(id)}`);
}

/**
 * @param {string} id
 * @returns {Promise<Flight>}
 */
export function trajectory(id) {
  return get(`/solutions/${encodeURIComponent(id)}/trajectory`);
}
