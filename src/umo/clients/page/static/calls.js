/** What became of the last call of an action, whoever has called it; shown where it is called. */

import { plain, unquoted } from "./client.js";
import { el, setText } from "./dom.js";
import { lasting, readable } from "./presentation.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 * @typedef {{path: string, state: string, text: string, who: string, began: number, ended: number | null}} Call
 *   `began`, `ended`: s on the cycle's clock.
 */

const SHOWN = 120;  // s for which the end of a call is shown

/**
 * The last call of one of these actions: as the machine's events tell it, or, where it never came to the machine, as this page knows it.
 * @param {string[]} paths @param {Page.Event[]} events @param {import("./client.js").Asked[]} asked @returns {Call | null}
 */
export function lastCall(paths, events, asked) {
  const last = events.findLast(({ path, command, asked: what }) => command && paths.includes(path) && what.startsWith("call "));
  const told = last ? events.filter(({ command }) => command === last.command) : [];
  const found = last ? fromEvents(told) : null;
  const own = asked.find(({ path, call }) => call && paths.includes(path));
  if (!own || (found && own.command !== null)) return found;  // the machine has it
  if (found && own.at <= found.began) return found;
  return { path: own.path, state: own.state, text: own.text, who: "", began: own.at, ended: own.state === "sent" || own.state === "begun" ? null : own.at };
}

/** @param {Page.Event[]} told  All of one command. @returns {Call} */
function fromEvents(told) {
  const [first] = told;
  const last = told[told.length - 1];
  return { path: last.path, state: last.state, text: last.text, who: last.who, began: first.time, ended: last.state === "begun" ? null : last.time };
}

/** A call in words; "": it has ended long ago. @param {Call} call @param {number} now  s on the cycle's clock. @param {string} own  The name of this page's client. */
export function callWords(call, now, own = "") {
  const { path, state, text, began, ended, who } = call;
  const by = who && who !== own ? ` (${who})` : "";
  if (ended === null) return `${state === "sent" ? "sent" : `runs for ${lasting(Math.max(0, now - began))}`}${text ? `: ${text}` : ""}${by}`;
  if (now - ended > SHOWN) return "";
  const took = ended - began >= 1 ? ` after ${lasting(ended - began)}` : "";
  const said = state === "done" ? unquoted(text) : plain(text).replace(`${path}: `, "");
  return `${state}${took}${said ? `: ${said}` : ""}${by}`;
}

/** The line of an action: what it does, and, for a while, what became of its last call. Its room stays the same. */
export class CallLine {
  /** @param {string} help @param {string[]} paths @param {{named?: boolean, quiet?: boolean}} how  `named`: the action is named; `quiet`: that it is done is not told. */
  constructor(help, paths, { named = false, quiet = false } = {}) {
    this._help = help;
    this._paths = paths;
    this._named = named;
    this._quiet = quiet;
    this.element = el("small", { className: "call", textContent: help, title: help });
  }

  /** Whether it runs. @param {Feed} feed @param {Client} client @param {string} [why]  Why it cannot be called now, before what it does. */
  refresh({ events, state, ended }, client, why = "") {
    const call = lastCall(this._paths, events, client.asked);
    const told = call && !ended && !(this._quiet && call.state === "done");
    const text = told ? callWords(call, state?.time ?? 0, client.leased ? client.holder : "") : "";
    const name = call && this._named ? `${readable(call.path.slice(call.path.lastIndexOf(".") + 1))}: ` : "";
    const help = [why, this._help].filter(Boolean).join(". ");
    setText(this.element, text ? name + text : help);
    this.element.title = text ? `${name}${text}\n${help}`.trim() : help;
    this.element.dataset.state = text && call ? (call.ended === null ? "begun" : call.state) : "";
    return Boolean(call && call.state === "begun" && call.ended === null && !ended);
  }
}
