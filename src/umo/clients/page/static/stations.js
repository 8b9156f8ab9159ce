/** The stations that run: their names, the choice in the header, the list, and the run that follows one that has ended. */

import { el } from "./dom.js";

/** @typedef {import("./feed.js").Feed} Feed */

/** A run's name and wiring, and its folder if another station of this name runs. @param {Page.Line} line @param {Page.Line[]} lines */
export function nameOf({ name, wiring, station, place }, lines) {
  const shared = lines.some((line) => line.station === station && line.place !== place);
  return `${name}${wiring && ` (${wiring})`}${shared && place ? ` in ${place}` : ""}`;
}

/** @param {Page.Line} line @param {Page.Line[]} lines */
export function sentenceOf(line, lines) {
  const { ending, stage } = line;
  return `${nameOf(line, lines)}: ${ending ? `${ending.failed ? "failed" : "ended"}: ${ending.text}` : stage}`;
}

/** What is wrong in a run, each with its class: the faults first. @param {Page.Line} line @returns {[string, string][]} */
export function troublesOf({ faults = [], alarms = [], changed = "" }) {
  const told = [...faults.map((text) => /** @type {[string, string]} */ (["failed", `✕ ${text}`])), ...alarms.map((text) => /** @type {[string, string]} */ (["warn", `▲ ${text}`]))];
  return changed ? [...told, ["warn", `▲ ${changed}`]] : told;
}

/** Another run of the station of an ended run, which is not over; null: there is none. @param {Page.Line[]} lines @param {string} name */
export function runAfter(lines, name) {
  const own = lines.find((line) => line.name === name);
  return lines.find((line) => line.station === own?.station && line.place === own.place && line.name !== name && line.stage !== "ended") ?? null;
}

/** Show every station and what is chosen in a select. Its list stays open as long as nothing changes. @param {HTMLSelectElement} select @param {Feed} feed */
export function offer(select, { stations, station }) {
  const texts = ["All stations", ...stations.map((line) => nameOf(line, stations) + (line.stage === "ended" ? ", ended" : ""))];
  const values = ["", ...stations.map(({ name }) => name)];
  const options = texts.map((textContent, i) => el("option", { textContent, value: values[i] }));
  if (select.innerHTML !== options.map(({ outerHTML }) => outerHTML).join("")) select.replaceChildren(...options);
  const chosen = station ?? "";
  if (select.value !== chosen) select.value = chosen;
}

/**
 * The list of running stations, and what to type if there is none. Until the server has told its stations, it claims nothing about them.
 * @param {HTMLElement} element @param {Feed} feed @param {(name: string) => void} choose @param {HTMLElement} fleet  Of all computers.
 */
export function list(element, { stations, listed, refused, wanted: chosen, server }, choose, fleet) {
  if (!listed) {
    element.append(el("p", { className: "hint", textContent: refused ? "" : "Connecting to the server ..." }));
    return;
  }
  const wanted = chosen ?? server?.station;
  const lines = stations.map((line) => el("li", {}, el("button", {
    className: line.ending?.failed ? "failed" : "", textContent: sentenceOf(line, stations), onclick: () => choose(line.name),
  }), ...troublesOf(line).map(([className, textContent]) => el("p", { className, textContent }))));
  element.append(fleet);
  if (lines.length) element.append(el("h2", { textContent: "Stations" }), el("ul", {}, ...lines));
  const missing = wanted && !stations.some(({ name }) => name === wanted);
  const text = missing ? `${wanted} is not running. ` : lines.length ? "" : "No station is running. ";
  element.append(el("div", { className: missing ? "" : "hint" },  // not below the table of a fleet
    el("p", { textContent: `${text}Start one in a terminal:` }),
    el("pre", { textContent: `umo run ${wanted || "ztheta"} --realtime` }),
    el("p", { textContent: "It appears here by itself." })));
}
