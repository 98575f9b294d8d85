/** The client of the REST API: JSON in, JSON out, errors with their messages. */

export const ROOT = "/api/v1";

/** An error response, or status 0 where there was none. */
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

/** @typedef {Record<string, string | number | boolean | null | undefined>} Query */

/**
 * Return the address of a route; what is null or undefined is left out.
 * @param {string} path below the root of the API
 * @param {Query} [query]
 */
export function address(path, query = {}) {
  const given = Object.entries(query).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const written = new URLSearchParams(given.map(([name, value]) => [name, String(value)])).toString();
  return ROOT + path + (written ? `?${written}` : "");
}

/**
 * @template Answer
 * @param {string} path
 * @param {Query} [query]
 * @returns {Promise<Answer>}
 */
export function get(path, query) {
  return ask(address(path, query), { headers: { Accept: "application/json" } });
}

/**
 * Return what a route has, or null where the id in its path is unknown or invalid.
 * @template Answer
 * @param {string} path
 * @returns {Promise<Answer | null>}
 */
export async function find(path) {
  try {
    return await get(path);
  } catch (error) {
    if (error instanceof ApiError && (error.status === 404 || error.status === 422)) return null;
    throw error;
  }
}

/**
 * @template Answer
 * @param {string} path
 * @param {unknown} [body] sent as JSON
 * @param {Record<string, string>} [headers]
 * @returns {Promise<Answer>}
 */
export function post(path, body, headers = {}) {
  const content = body === undefined ? {} : { body: JSON.stringify(body) };
  const type = { "Content-Type": "application/json", Accept: "application/json" };
  return ask(address(path), { method: "POST", headers: { ...type, ...headers }, ...content });
}

/**
 * Send a file unchanged.
 * @template Answer
 * @param {string} path
 * @param {File} file
 * @param {string} type
 * @returns {Promise<Answer>}
 */
export function upload(path, file, type) {
  return ask(address(path), { method: "POST", headers: { "Content-Type": type, Accept: "application/json" }, body: file });
}

/**
 * @param {string} url
 * @param {RequestInit} options
 */
async function ask(url, options) {
  let response;
  try {
    response = await fetch(url, options);
  } catch {
    throw new ApiError(0, "The coordinator does not answer.");
  }
  if (response.status === 401) return signIn();
  if (!response.ok) {
    const body = await response.json().catch(() => ({}));
    throw new ApiError(response.status, body.detail ?? response.statusText);
  }
  return response.status === 204 ? null : response.json();
}

/**
 * Go to the sign-in page, which leads back here; the request never completes.
 * @returns {Promise<never>}
 */
function signIn() {
  const here = window.location.pathname + window.location.search;
  window.location.assign(`/sign-in?next=${encodeURIComponent(here)}`);
  return new Promise(() => {});
}
