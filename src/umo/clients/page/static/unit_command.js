/** A command of a part with states: its button, and why it cannot be given now. */

import { allow, el, setText } from "./dom.js";
import { inSentence, readable } from "./presentation.js";

const MAX_NAMED = 2;  // states that are named as those in which a command is possible

/** Which commands are possible in manual mode. @param {Page.Unit} unit */
export function inManual({ in_manual: names }) {
  return `Manual mode: only ${names.length > 1 ? `${names.slice(0, -1).join(", ")} and ` : ""}${names[names.length - 1]}`;
}

export class UnitCommand {
  /** @param {import("./client.js").Client} client @param {Page.Unit} unit @param {string} name @param {string} part  Its name. @param {Page.Action | undefined} action */
  constructor(client, unit, name, part, action) {
    this._client = client;
    this._unit = unit;
    this._name = name;
    this._help = action?.help ?? "";
    this.apart = Boolean(action?.apart);
    const path = `${unit.path}.${name}`;
    const words = `${readable(name)} ${inSentence(part)}`;
    this._states = el("small", { "aria-hidden": "true" });  // the tooltip says it in more words
    this.element = el("button", { type: "button", "data-command": name, "aria-label": words, onclick: () => client.ask({ do: "call", path, arguments: {} }, words) },
      this.apart ? words : readable(name), this._states);  // the header has a button that ends the run: what is stopped here is named
  }

  /** @param {string} number  Of the state. */
  refresh(number) {
    const elsewhere = statesOf(this._unit, this._name, number);
    const barrier = this._client.barrier() || (this._client.manual && !this._unit.in_manual.includes(this._name) ? "Not in manual mode" : "");
    setText(this._states, elsewhere);
    allow(this.element, [barrier, elsewhere && `${readable(this._name)} is possible ${elsewhere}`].filter(Boolean).join(". "), this._help);
  }
}

/** In which states a command is possible: `in Idle`, or, of many, `not in Stopped`; "": in this one. @param {Page.Unit} unit @param {string} name @param {string} number */
export function statesOf({ commands, states }, name, number) {
  const possible = Object.keys(commands[name]);
  if (possible.includes(number)) return "";
  if (possible.length > MAX_NAMED) return `not in ${readable(states[number] ?? "unknown")}`;
  return `in ${possible.map((each) => readable(states[each])).join(", ")}`;
}
