/** Wilson's 95 % interval of a ratio, equation 23 of docs/method.md. */

const Z = 1.96;

/**
 * @param {number} successes
 * @param {number} trials
 * @returns {[number, number]} all of [0, 1] while there are no trials
 */
export function wilson(successes, trials) {
  if (trials === 0) return [0, 1];
  const p = successes / trials;
  const share = (Z * Z) / trials;
  const half = Z * Math.sqrt((p * (1 - p)) / trials + share / (4 * trials));
  const centre = p + share / 2;
  return [Math.max(0, (centre - half) / (1 + share)), Math.min(1, (centre + half) / (1 + share))];
}
