/** Beside the objects: the run, who has control, the newest black box, the events. */

import { el, setText } from "./dom.js";
import { listed, sentence } from "./marks.js";

const MAX_EVENTS = 100;  // shown

export class Panel {
  /** @param {import("./feed.js").Feed} feed */
  constructor(feed) {
    this._feed = feed;
    this._facts = el("dl");
    /** @type {Map<string, [HTMLElement, HTMLElement]>} */
    this._values = new Map();
    this._box = el("pre", { className: "box" });
    this._events = el("ol", { className: "events" });
    this._eventsTitle = el("h2", { textContent: "Events", hidden: true });
    this._shown = "";
    this.element = el("aside", { tabIndex: 0, "aria-label": "Run, black box, events" }, el("h2", { textContent: "Run" }), this._facts,
      el("h2", { textContent: feed.description?.recording ? "Recording" : "Last black box of this run" }), this._box, this._eventsTitle, this._events);
  }

  refresh() {
    const { state } = this._feed;
    if (!state) return;
    for (const [name, text] of Object.entries(state.facts)) this._fact(name, text, name === "end" && state.ending?.failed);
    setText(this._box, state.box || "none; a black box is written when a period is missed in real time");
    this._show(this._feed.events);
  }

  /** @param {string} name @param {string} value */
  _fact(name, value, failed = false) {
    let parts = this._values.get(name);
    if (!parts) {
      parts = [el("dt", { textContent: name }), el("dd", { "data-fact": name })];
      this._facts.append(...parts);
      this._values.set(name, parts);
    }
    const [title, cell] = parts;
    title.hidden = cell.hidden = !value;
    cell.classList.toggle("failed", failed);
    setText(cell, value);
  }

  /** The newest first. @param {Page.Event[]} events */
  _show(events) {
    const shown = listed(events).slice(-MAX_EVENTS).reverse().map(sentence);
    const text = shown.join("\n");
    if (text === this._shown) return;
    this._shown = text;
    this._eventsTitle.hidden = !shown.length;
    this._events.replaceChildren(...shown.map((textContent) => el("li", { textContent })));
  }
}
