/** The parts of a machine: its compounds, each with what can be done there; like parts of lists in one group. */

import { generalised, linesOf } from "./folding.js";

/**
 * @typedef {{path: string, title: string, objects: Page.Entry[], actions: Page.Action[], tunables: Page.Tunable[]}} Part
 * @typedef {{title: string, family: string, parts: Part[]}} Group  `family` is empty for a part that stands alone.
 */

/** @param {Page.Description} description @returns {Part[]} */
export function partsOf({ station, objects, actions, tunables, units, books }) {
  /** @type {Map<string, Part>} */
  const found = new Map();
  const at = (/** @type {string} */ path) => {
    const parent = path.includes(".") ? path.slice(0, path.lastIndexOf(".")) : "";
    const part = found.get(parent) ?? { path: parent, title: parent || station, objects: [], actions: [], tunables: [] };
    found.set(parent, part);
    return part;
  };
  at("");
  for (const entry of objects) at(entry.path).objects.push(entry);
  const own = actions.filter(({ path }) => ![...units, ...books].some((each) => path.startsWith(`${each.path}.`)));  // those stand with the states and the recipes
  for (const entry of own) at(entry.path).actions.push(entry);
  const nodes = new Set([...objects, ...actions].flatMap(({ path }) => path.split(".").slice(0, -1).map((_, i, names) => names.slice(0, i + 1).join("."))));
  for (const entry of tunables) {  // a law's number stands with the part that has the law
    const names = entry.path.split(".");
    let count = names.length - 1;
    while (count > 0 && !nodes.has(names.slice(0, count).join("."))) count -= 1;
    const name = names.slice(count).join(".");
    at([...names.slice(0, count), ""].join(".")).tunables.push({ ...entry, name });
  }
  return [...found.values()].filter(({ objects: all, actions: calls, tunables: numbers }) => calls.length || numbers.length || all.some(isActuator));
}

/** @param {Page.Entry} entry */
export const isActuator = ({ actuator }) => Boolean(actuator);

/** Those parts of which a path contains some letters. @param {Part[]} parts @param {string} wanted  Small letters. */
export function filtered(parts, wanted) {
  if (!wanted) return parts;
  return parts.filter(({ path, objects, actions, tunables }) => (
    [path, ...[...objects, ...actions, ...tunables].map((each) => each.path)].some((each) => each.toLowerCase().includes(wanted))
  ));
}

/** Like parts of lists share a group. @param {Part[]} parts @returns {Group[]} */
export function groupsOf(parts) {
  const paths = parts.map(({ path }) => path);
  return linesOf(paths).map(({ name, places }) => {
    const own = places.map((place) => parts[place]);
    return own.length > 1 ? { title: name, family: generalised(own[0].path), parts: own } : { title: own[0].title, family: "", parts: own };
  });
}
