/** How a quality is shown: a sign, a word, and the class that colours it. */

/** Qualities from which a value is not the present one (umo.Quality). */
export const STALE = 3;

/**
 * @typedef {{sign: string, word: string, kind: string}} ShownQuality  `word` is empty for a good value.
 */

/**
 * @param {number} quality @param {[string, string][]} qualities  Sign and words of each. @param {boolean} ended
 * @returns {ShownQuality}  After the end of a run no value is good: it is the last one before.
 */
export function shownQuality(quality, qualities, ended) {
  const [sign, words] = qualities[quality] ?? ["?", "unknown"];
  if (ended && quality === 0) return { sign: "◌", word: "", kind: "last" };
  return { sign, word: quality > 0 ? words : "", kind: words };
}
