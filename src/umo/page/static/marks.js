/** What happened, in words, and where it stands on the scope. */

import { clockText } from "./presentation.js";

const MARK_DISTANCE = 6;  // pixels from a mark within which it is told

/** `12.345 s z.motor: limited (by ann): done`. @param {Partial<Page.Event>} event */
export function sentence(event) {
  const { time, path = "", text = "", who = "", asked = "", state = "" } = event;
  const when = typeof time === "number" ? clockText(time) : "";
  const what = [path, asked, state && state !== "none" ? state : "", text].filter(Boolean).join(": ");
  return [when, what, who ? `(${who})` : ""].filter(Boolean).join(" ");
}

/**
 * The marks of the scope, in the order of time: commands, changes of the mode, what guards did, missed periods.
 * @param {Page.Event[]} events @param {[number, number][]} misses  When, and how many.
 * @returns {Page.Mark[]}
 */
export function marksOf(events, misses) {
  const told = events.map((event) => ({ time: event.time, kind: kindOf(event), text: sentence(event) }));
  const late = misses.map(([time, count]) => (
    { time, kind: /** @type {const} */ ("missed"), text: `${clockText(time)} ${count} period${count > 1 ? "s" : ""} missed` }
  ));
  return [...told, ...late].sort((one, other) => one.time - other.time);
}

/** @param {Page.Event} event @returns {Page.Mark["kind"]} */
function kindOf({ command, asked, who }) {
  if (asked.startsWith("mode")) return "mode";
  return command || who || asked ? "command" : "guard";
}

/**
 * The last mark within some pixels of a time; null: none.
 * @param {Page.Mark[]} marks @param {number} time @param {number} pixel  s.
 */
export function markAt(marks, time, pixel) {
  return marks.findLast((mark) => Math.abs(mark.time - time) <= MARK_DISTANCE * pixel) ?? null;
}
