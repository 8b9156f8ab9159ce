/** The alarms of a machine: those that are not normal, what is to be acknowledged first, with the verbs of each. */

import { allow, el, setText } from "./dom.js";
import { clockText, wallTime } from "./presentation.js";
import { fieldsOf, labelOf } from "./verbs.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const SIGNS = { critical: "▲▲", high: "▲", medium: "●", low: "○" };
const MAX_ROWS = 50;  // that are shown
const OF_ALL = "acknowledge alarm";  // the verb that is offered for all alarms at once
const DEFAULTS = { time: "10 min" };  // of arguments, by their kinds

/** How many alarms there are: `2 (1 active, 2 to be acknowledged), 1 shelved or out of service`. @param {Page.Alarm[]} alarms @param {number} open  To be acknowledged. */
function countsOf(alarms, open) {
  const shown = alarms.filter(({ annunciated }) => annunciated);
  const active = shown.filter((each) => each.active).length;
  const counts = shown.length ? `${shown.length} (${active} active, ${open} to be acknowledged)` : "none";
  const hidden = alarms.length - shown.length;
  return hidden ? `${counts}, ${hidden} shelved or out of service` : counts;
}

export class AlarmList {
  /** @param {Feed} feed @param {Client} client */
  constructor(feed, client) {
    this._client = client;
    this._told = "";
    this._verbs = new Map((feed.description?.verbs ?? []).filter(({ names }) => names === "alarm").map((verb) => [verb.name, verb]));
    this._count = el("h3", {});
    this._all = el("button", { textContent: "Acknowledge all", type: "button", onclick: () => this._ask(this._verbs.get(OF_ALL), "") });
    /** @type {Map<string, HTMLInputElement>} What the arguments of verbs are, by their names: one for all rows. */
    this._given = new Map([...this._verbs.values()].flatMap((verb) => verb.arguments.map((each) => [each.name, el("input", {
      value: DEFAULTS[/** @type {keyof typeof DEFAULTS} */ (each.kind)] ?? "", size: 7, title: `${each.help} ${each.range}`, "aria-label": `${labelOf(verb)}: ${each.name}`, oninput: () => this.refresh(feed),
    })])));
    this._rows = el("tbody", {});
    this.element = el("section", { className: "part alarms", "aria-label": "Alarms" },
      el("div", { className: "alarm-head" }, this._count, ...this._given.values(), this._all),
      el("div", { className: "scroll" }, el("table", {}, this._rows)));
    this.element.hidden = !feed.description?.alarms;
  }

  /** @param {Page.Verb | undefined} verb @param {string} path */
  _ask(verb, path) {
    if (verb) this._client.ask({ do: verb.name, path, ...fieldsOf(verb, this._given) }, `${verb.name} ${path || "(all)"}`);
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const alarms = feed.state?.alarms ?? [];
    const open = alarms.filter(({ asks }) => asks).length;
    setText(this._count, `Alarms: ${countsOf(alarms, open)}`);
    this.element.dataset.open = String(open > 0);
    allow(this._all, this._client.barrier() || (open ? "" : "There is nothing to acknowledge"));
    const told = JSON.stringify([alarms, this._client.barrier(), [...this._given.values()].map(({ value }) => value)]);
    if (told === this._told) return;
    this._told = told;
    this._rows.replaceChildren(...alarms.slice(0, MAX_ROWS).map((alarm) => this._row(alarm, feed)));
  }

  /** @param {Page.Alarm} alarm @param {Feed} feed */
  _row(alarm, feed) {
    const { path, priority, state, text, since, until, who } = alarm;
    const moment = (/** @type {number} */ time) => wallTime(feed.state?.utc, time) || clockText(time);
    const when = since === null ? "" : moment(since);
    const note = [alarm.note, until === null ? "" : `until ${moment(until)}`].filter(Boolean).join("; ");
    return el("tr", { "data-alarm": path, "data-state": state, "data-priority": priority },
      el("td", { className: "sign", title: priority, textContent: SIGNS[/** @type {keyof typeof SIGNS} */ (priority)] ?? "●" }),
      el("td", { className: "text", title: note }, el("strong", { textContent: text }), el("small", { textContent: ` ${path}${note ? ` · ${note}` : ""}` })),
      el("td", { textContent: `${state}${who ? ` (${who})` : ""}` }), el("td", { className: "when", textContent: when }),
      el("td", { className: "does" }, ...alarm.verbs.map((name) => this._button(this._verbs.get(name), path))));
  }

  /** @param {Page.Verb | undefined} verb @param {string} path */
  _button(verb, path) {
    if (!verb) return null;
    const given = verb.arguments.map((each) => this._given.get(each.name)?.value);
    const textContent = [labelOf(verb), ...given].filter(Boolean).join(" ");
    const button = el("button", { textContent, type: "button", "aria-label": `${textContent} ${path}`, onclick: () => this._ask(verb, path) });
    allow(button, this._client.barrier(!verb.only_manual), verb.help);
    return button;
  }
}
