/** Beside the objects: the run, the lease, the newest black box, the events. */

import { duration, el, setText } from "./dom.js";

const EVENTS = 100;  // shown

export class Panel {
  constructor(feed) {
    this._feed = feed;
    this._facts = el("dl");
    this._values = new Map();
    this._box = el("pre", { className: "box" });
    this._events = el("ol", { className: "events" });
    this._eventsTitle = el("h2", { textContent: "Events", hidden: true });
    this.element = el("aside", {}, el("h2", { textContent: "Run" }), this._facts,
      el("h2", { textContent: "Last black box" }), this._box, this._eventsTitle, this._events);
  }

  refresh() {
    const { state, description } = this._feed;
    const [text = "", done = 0, total = 0] = state.progress ?? [];
    this._fact("station", `${description.station}${description.wiring ? ` (${description.wiring})` : ""}`);
    this._fact("state", state.stage);
    this._fact("mode", state.mode);
    this._fact("lease", holderOf(state.lease));
    this._fact("progress", text + (total ? `, ${done} of ${total}` : ""));
    this._fact("time", state.time === undefined ? "" : `${state.time.toFixed(1)} s`);
    this._fact("period", duration(description.period));
    this._fact("execution", state.execution === undefined ? "" : duration(state.execution));
    this._fact("missed periods", String(state.missed));
    this._fact("not seen by the page", state.lost ? `${state.lost} periods` : "");
    this._fact("pid", String(description.pid));
    setText(this._box, state.box || "none: one is written when a period is missed in real time");
    this._show(this._feed.events);
  }

  _fact(name, value) {
    if (!this._values.has(name)) {
      const parts = [el("dt", { textContent: name }), el("dd", { "data-fact": name })];
      this._facts.append(...parts);
      this._values.set(name, parts);
    }
    const [title, cell] = this._values.get(name);
    title.hidden = cell.hidden = !value;
    setText(cell, value ?? "");
  }

  /** The newest first. */
  _show(events) {
    const shown = events.slice(-EVENTS).reverse().map(sentence);
    const text = shown.join("\n");
    if (text === this._shown) return;
    this._shown = text;
    this._eventsTitle.hidden = !shown.length;
    this._events.replaceChildren(...shown.map((textContent) => el("li", { textContent })));
  }
}

/** `12.345 s z.motor: limited (by ann): done`. */
function sentence(event) {
  const { time, path = "", text = "", who = "", asked = "", state = "" } = event;
  const when = typeof time === "number" ? `${time.toFixed(3)} s` : "";
  const what = [path, asked, state && state !== "none" ? state : "", text].filter(Boolean).join(": ");
  return [when, what, who ? `(${who})` : ""].filter(Boolean).join(" ");
}

const holderOf = (lease) => (lease && (lease.holder ?? (typeof lease === "string" ? lease : ""))) || "";
