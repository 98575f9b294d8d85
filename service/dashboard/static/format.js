/** Numbers and times for readers, with their units; "–" where there is none. */

export const NONE = "–";
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/**
 * @param {number | null | undefined} value
 * @param {number} digits after the point
 * @param {string} [unit]
 */
export function number(value, digits, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = formatOf(digits).format(value);
  return unit ? `${text.replaceAll(",", "\u202f")}\u00a0${unit}` : text.replaceAll(",", "\u202f");
}

/** @type {Map<number, Intl.NumberFormat>} */
const formats = new Map();

/**
 * Return a number format, cached: creating one for each number takes as long as drawing it.
 * @param {number} digits after the point
 */
function formatOf(digits) {
  const known = formats.get(digits) ?? new Intl.NumberFormat("en-GB", { minimumFractionDigits: digits, maximumFractionDigits: digits });
  formats.set(digits, known);
  return known;
}

/**
 * Return a number of things with its noun in singular or plural.
 * @param {number} n
 * @param {string} one
 * @param {string} [many] where an "s" at its end does not do
 */
export function counted(n, one, many = `${one}s`) {
  return `${number(n, 0)} ${n === 1 ? one : many}`;
}

/**
 * Return two significant digits, as a power of ten where that is shorter.
 * @param {number | null | undefined} value
 * @param {string} [unit]
 */
export function small(value, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "not finite";
  const tail = unit ? `\u00a0${unit}` : "";
  if (value === 0) return `0${tail}`;
  const exponent = Math.floor(Math.log10(Math.abs(value)));
  if (exponent >= -3 && exponent < 5) return `${Number(value.toPrecision(2))}${tail}`;
  const power = String(Math.abs(exponent)).replace(/\d/g, (digit) => SUPERSCRIPTS[Number(digit)]);
  const mantissa = (value / 10 ** exponent).toFixed(1).replace(/\.0$/, "");
  return `${mantissa === "1" ? "" : `${mantissa}·`}10${exponent < 0 ? "⁻" : ""}${power}${tail}`;
}

/**
 * @param {number | null | undefined} share
 */
export function percent(share) {
  if (share === null || share === undefined || !Number.isFinite(share)) return NONE;
  const value = 100 * share;
  return `${value.toFixed(value > 0 && value < 10 ? 1 : 0)}\u202f%`;
}

/**
 * Return a time span in its two leading units.
 * @param {number | null | undefined} seconds
 */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NONE;
  const whole = Math.max(0, Math.round(seconds));
  const [days, hours, minutes] = [Math.floor(whole / 86400), Math.floor(whole / 3600) % 24, Math.floor(whole / 60) % 60];
  if (days > 0) return `${days}\u00a0d ${hours}\u00a0h`;
  if (hours > 0) return `${hours}\u00a0h ${minutes}\u00a0min`;
  if (minutes > 0) return `${minutes}\u00a0min ${String(whole % 60).padStart(2, "0")}\u00a0s`;
  return `${whole}\u00a0s`;
}

/**
 * @param {string | null | undefined} text TDB calendar epoch
 */
export function epoch(text) {
  return text ? `${text.slice(0, 16).replace("T", " ")}\u00a0TDB` : NONE;
}

/**
 * @param {Date} moment
 */
export function clock(moment) {
  return moment.toLocaleTimeString("en-GB");
}

/**
 * @param {{ segment: number, duration_days: number }[]} outages
 */
export function outages(outages) {
  if (outages.length === 0) return "no outage";
  return outages.map((o) => `segment ${o.segment}, ${number(o.duration_days, 1, "d")}`).join("; ");
}

/** @param {string} id */
export function shortId(id) {
  return id.slice(0, 8);
}

/**
 * @param {string | null | undefined} text a time in UTC, as the service sends it
 */
export function date(text) {
  if (!text) return NONE;
  const how = /** @type {Intl.DateTimeFormatOptions} */ ({ day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit" });
  return new Date(text).toLocaleString("en-GB", how);
}
