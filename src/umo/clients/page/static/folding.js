/** Like objects of lists in one line, as `umo show values` has them. */

/** @typedef {{name: string, group: string, places: number[]}} Line */

const FOLDED_FROM = 3;  // members from which a family is folded

/** A path with `*` for its indexes. @param {string} path */
export const generalised = (path) => path.split(".").map((part) => (/^\d+$/.test(part) ? "*" : part)).join(".");

/** The name of like paths: `zones[0..39].heater`, `zones[0..2, 4..39].heater`. @param {string[]} paths */
export function folded(paths) {
  const parts = paths.map((path) => path.split("."));
  return parts[0].map((part, i) => {
    const numbers = new Set(parts.map((path) => Number(path[i])));
    if (!/^\d+$/.test(part) || numbers.size === 1) return `.${part}`;
    const firsts = [...numbers].filter((number) => !numbers.has(number - 1)).sort((a, b) => a - b);
    const lasts = [...numbers].filter((number) => !numbers.has(number + 1)).sort((a, b) => a - b);
    return `[${firsts.map((first, k) => (first === lasts[k] ? first : `${first}..${lasts[k]}`)).join(", ")}]`;
  }).join("").slice(1);
}

/**
 * The lines of a list of paths: one for each object, or for a family of at least three.
 * @param {string[]} paths @returns {Line[]}  In the order of the groups' first members.
 */
export function linesOf(paths) {
  /** @type {Map<string, number[]>} */
  const families = new Map();
  paths.forEach((path, place) => {
    const family = generalised(path);
    families.set(family, [...(families.get(family) ?? []), place]);
  });
  /** @type {Line[]} */
  const lines = [];
  for (const places of families.values()) {
    if (places.length >= FOLDED_FROM) lines.push(line(folded(places.map((place) => paths[place])), places));
    else for (const place of places) lines.push(line(paths[place], [place]));
  }
  /** @type {Map<string, Line[]>} */
  const groups = new Map();
  for (const each of lines) groups.set(each.group, [...(groups.get(each.group) ?? []), each]);
  return [...groups.values()].flat();
}

/** @param {string} name @param {number[]} places @returns {Line} */
function line(name, places) {
  const [, group = ""] = name.match(/^([^.[]+)(\[[^\]]*\])?\./) ?? [];
  return { name, group, places };
}
