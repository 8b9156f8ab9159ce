/** Numbers of colours for traces: a trace keeps its own as long as it is on the scope. */

/**
 * @param {string[]} paths  Of the traces that are shown.
 * @param {Map<string, number>} known  Those that had a colour before.
 * @returns {Map<string, number>}  The others get the lowest numbers that are free.
 */
export function coloursOf(paths, known = new Map()) {
  const kept = paths.filter((path) => known.has(path));
  /** @type {Map<string, number>} */
  const found = new Map(kept.map((path) => [path, /** @type {number} */ (known.get(path))]));
  const taken = new Set(found.values());
  let free = 0;
  for (const path of paths) {
    if (found.has(path)) continue;
    while (taken.has(free)) free += 1;
    taken.add(free);
    found.set(path, free);
  }
  return found;
}

/** For the address: `0.2.1`; null where they are in order. @param {Map<string, number>} colours */
export function toAddress(colours) {
  const numbers = [...colours.values()];
  return numbers.every((number, place) => number === place) ? null : numbers.join(".");
}

/** @param {string[]} paths @param {string | null} text  @returns {Map<string, number>} */
export function fromAddress(paths, text) {
  const numbers = (text ?? "").split(".").filter((word) => /^\d{1,3}$/.test(word)).map(Number);
  const fit = numbers.length === paths.length && new Set(numbers).size === numbers.length;
  return new Map(fit ? paths.map((path, place) => [path, numbers[place]]) : []);
}
