/** The line of the page that says how the run and the connection are. */

import { el } from "./dom.js";
import { inSentence, lasting, readable } from "./presentation.js";

const MAX_FAULTS = 3;  // equipments in fault that are told in words
const SILENCE = 1;  // s without news, after which the page says so; of frames 10 periods, if that is more (frames/reader.py)

/**
 * @typedef {{connected: boolean, refused?: boolean, unheard: number, station: string | null, period: number, state: Page.State | null}} Known
 * @typedef {{kind: "" | "warn" | "failed" | "ended", text: string, seconds: string}} Status
 *   `text` is told to those who hear the page; `seconds`, which follow it, change all the time and are not.
 */

/** What is wrong, or how the run ended; an empty text: all is well. @param {Known} known @returns {Status} */
export function statusOf({ connected, refused, unheard, station, period, state }) {
  if (!connected) {
    const lost = "The connection to the server is lost. The page tries again by itself.";
    const out = "The server refuses this page. Open the address that `umo show page` has printed.";
    return warning(refused ? out : lost);
  }
  if (state?.stage === "ended") return ended(station ?? "", state.ending);
  if (station && unheard > SILENCE) return warning("Nothing heard from the server", unheard);
  if (state && state.silent > Math.max(SILENCE, 10 * period)) return warning("No new frame", state.silent);
  return { kind: "", text: "", seconds: "" };
}

/** @param {string} text @param {number | null} seconds @returns {Status} */
const warning = (text, seconds = null) => ({ kind: "warn", text, seconds: seconds === null ? "" : ` for ${lasting(seconds)}.` });

/** @param {string} station @param {Page.Ending | null} ending @returns {Status} */
function ended(station, ending) {
  if (!ending) return { kind: "ended", text: `${station} has ended.`, seconds: "" };
  const text = `${station} ${ending.failed ? "failed" : "has ended"}: ${ending.text}.`.replace(/\.\.$/, ".");
  return { kind: ending.failed ? "failed" : "ended", text, seconds: "" };
}

/**
 * The equipment in fault: the first few, each with the words for it, and how many more there are.
 * @param {Record<string, string> | undefined} faults
 */
export function faultsOf(faults) {
  const found = Object.entries(faults ?? {}).map(([path, reason]) => ({ path, text: `✖ ${readable(path)} is in fault: ${reason}` }));
  return { shown: found.slice(0, MAX_FAULTS), more: Math.max(0, found.length - MAX_FAULTS) };
}

/** The button that clears a fault. @param {string} path @param {() => void} onclick */
export function clearing(path, onclick) {
  const title = `End the fault of ${inSentence(path)} and initialise what had failed; the machine may move`;
  return el("button", { className: "clear", textContent: "Clear", title, "aria-label": `Clear ${inSentence(path)}`, onclick });
}

/**
 * What forbids actuators but the faults of their equipment, each reason once with how many it forbids: `the emergency stop was pressed (2 actuators)`.
 * @param {Record<string, string> | undefined} inhibited @param {Record<string, string>} faults
 */
export function forbidden(inhibited, faults = {}) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  const told = new Set(Object.keys(faults).map((path) => `${path} is in fault`));
  for (const reason of Object.values(inhibited ?? {})) if (!told.has(reason)) counts.set(reason, (counts.get(reason) ?? 0) + 1);
  return [...counts].map(([reason, count]) => `${reason} (${count} actuator${count > 1 ? "s" : ""})`);
}
