/** The alarms of a machine: those that are not normal, what is to be acknowledged first. */

import { allow, el, setText } from "./dom.js";
import { clockText, wallTime } from "./presentation.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const SIGNS = { critical: "▲▲", high: "▲", medium: "●", low: "○" };
const MAX_ROWS = 50;  // that are shown
const SHELF = 600;  // s

export class AlarmList {
  /** @param {Feed} feed @param {Client} client */
  constructor(feed, client) {
    this._client = client;
    this._told = "";
    this._count = el("h3", {});
    this._all = el("button", { textContent: "Acknowledge all", type: "button", onclick: () => this._ask("acknowledge alarm", "") });
    this._rows = el("tbody", {});
    this.element = el("section", { className: "part alarms", "aria-label": "Alarms" },
      el("div", { className: "alarm-head" }, this._count, this._all),
      el("div", { className: "scroll" }, el("table", {}, this._rows)));
    this.element.hidden = !feed.description?.alarms;
  }

  /** @param {string} what @param {string} path @param {unknown} [value] */
  _ask(what, path, value) {
    this._client.ask({ do: what, path, ...(value === undefined ? {} : { value }) }, `${what} ${path || "(all)"}`);
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const alarms = feed.state?.alarms ?? [];
    const open = alarms.filter(({ asks }) => asks).length;
    const standing = alarms.filter(({ annunciated }) => annunciated).length;
    setText(this._count, alarms.length ? `Alarms: ${standing} standing, ${open} to be acknowledged` : "Alarms: none");
    this.element.dataset.open = String(open > 0);
    allow(this._all, this._client.barrier() || (open ? "" : "There is nothing to acknowledge"));
    const told = JSON.stringify([alarms, this._client.barrier()]);
    if (told === this._told) return;
    this._told = told;
    this._rows.replaceChildren(...alarms.slice(0, MAX_ROWS).map((alarm) => this._row(alarm, feed)));
  }

  /** @param {Page.Alarm} alarm @param {Feed} feed */
  _row(alarm, feed) {
    const { path, priority, state, text, since, note, who, asks, resets, shelves } = alarm;
    const when = since === null ? "" : wallTime(feed.state?.utc, since) || clockText(since);
    const reason = this._client.barrier();
    const button = (/** @type {string} */ name, /** @type {string} */ what, /** @type {unknown} */ value) => (
      el("button", { textContent: name, type: "button", disabled: Boolean(reason), title: reason, "aria-label": `${name} ${path}`, onclick: () => this._ask(what, path, value) }));
    return el("tr", { "data-alarm": path, "data-state": state, "data-priority": priority },
      el("td", { className: "sign", title: priority, textContent: SIGNS[/** @type {keyof typeof SIGNS} */ (priority)] ?? "●" }),
      el("td", { className: "text", title: note }, el("strong", { textContent: text }), el("small", { textContent: ` ${path}${note ? ` · ${note}` : ""}` })),
      el("td", { textContent: `${state}${who ? ` (${who})` : ""}` }), el("td", { className: "when", textContent: when }),
      el("td", { className: "does" }, asks ? button("Acknowledge", "acknowledge alarm", undefined) : null, resets ? button("Reset", "reset alarm", undefined) : null,
        shelves ? button("Shelve 10 min", "shelve", SHELF) : state === "shelved" ? button("Unshelve", "unshelve", undefined) : null));
  }
}
