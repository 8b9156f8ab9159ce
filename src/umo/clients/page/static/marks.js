/** What happened: in words, of which kind, and where it stands on the time axis. */

import { clockText, withShortNumbers } from "./presentation.js";

const MARK_DISTANCE = 26;  // CSS pixels within which marks are one: there is room for its count
const REACH = 10;  // CSS pixels beside a mark at which it is told
const MAX_TOLD = 6;  // events that a mark tells
const COMES = /^((bad )?unacknowledged|shelved active) /;  // an alarm's state that begins its text (umo/operation/alarms)
const ENDS = /^(fault cleared|is back|was initialised again)/;  // umo/cycle
const OF_LEASE = ["lease", "give back"];  // what a client asks for its lease (umo/operation/commands/verbs.py)
const GUARDED = /^(inhibited|command expired)| actuators inhibited| commands expired/;  // of one actuator, of several

/** The kinds, the gravest first, in words. */
export const KINDS = {
  fault: "fault", alarm: "alarm", missed: "periods missed", guard: "interlock or expiry", command: "command", mode: "mode, end of the run",
  over: "end of an alarm or a fault", told: "told by the machine",
};
const ORDER = /** @type {Page.Mark["kind"][]} */ (Object.keys(KINDS));

/** `12.345 s z.motor: limited (by ann): done`. @param {Partial<Page.Event>} event */
export function sentence(event) {
  const { time, path = "", text = "", who = "", asked = "", state = "" } = event;
  const when = typeof time === "number" ? clockText(time) : "";
  const what = withShortNumbers([path, asked, state && state !== "none" ? state : "", text].filter(Boolean).join(": "));
  return [when, what, who ? `(${who})` : ""].filter(Boolean).join(" ");
}

/** The events of a list: without those of a client that has only taken or given back its lease; a take-over stays. @param {Page.Event[]} events */
export const listed = (events) => events.filter(({ asked, state }) => state !== "done" || !OF_LEASE.includes(asked));

/**
 * The marks of the scope, in the order of time.
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
export function kindOf({ command, asked, who, path, text, state }) {
  if (asked.startsWith("mode")) return "mode";
  if (asked === "end" && !command) return state === "failed" ? "fault" : "mode";
  if (asked === "fault") return "fault";
  if (command || who) return "command";
  if (asked === "alarm" && COMES.test(text)) return "alarm";
  if (asked === "alarm" || ENDS.test(text)) return "over";
  if (path.startsWith("driver ")) return "fault";
  return GUARDED.test(text) ? "guard" : "told";
}

/**
 * Marks that stand close together, as one. A pair stays together while the picture moves on.
 * @param {Page.Mark[]} marks  In the order of time. @param {number} pixel  s of a CSS pixel. @returns {Page.Cluster[]}
 */
export function clustersOf(marks, pixel) {
  /** @type {Page.Mark[][]} */
  const groups = [];
  for (const mark of marks) {
    const last = groups.at(-1);
    if (last && mark.time - last[0].time <= MARK_DISTANCE * pixel) last.push(mark);
    else groups.push([mark]);
  }
  return groups.map((group) => ({ time: group[0].time, marks: group, kind: gravest(group) }));
}

/** @param {Page.Mark[]} group */
function gravest(group) {
  const kinds = new Set(group.map(({ kind }) => kind));
  return ORDER.find((kind) => kinds.has(kind)) ?? "told";
}

/** The lines that a mark tells. @param {Page.Cluster} cluster @returns {string[]} */
export function linesOf({ marks }) {
  const told = marks.slice(0, MAX_TOLD).map(({ text }) => text);
  return marks.length > MAX_TOLD ? [...told, `and ${marks.length - MAX_TOLD} more`] : told;
}

/**
 * The mark at a time, or beside it; null: none.
 * @param {Page.Cluster[]} clusters @param {number} time @param {number} pixel  s of a CSS pixel.
 */
export function clusterAt(clusters, time, pixel) {
  const away = (/** @type {Page.Cluster} */ { marks }) => Math.max(marks[0].time - time, time - marks[marks.length - 1].time, 0);
  const nearest = clusters.reduce((/** @type {Page.Cluster | null} */ best, each) => (best && away(best) <= away(each) ? best : each), null);
  return nearest && away(nearest) <= REACH * pixel ? nearest : null;
}
