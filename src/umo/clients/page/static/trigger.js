/** The controls of the trigger. */

import { el, setText } from "./dom.js";
import { isBinary, numberText, unitOf } from "./presentation.js";

export const WAITING = "waiting for the trigger";
const KINDS = { "": "none", rising: "rising edge", falling: "falling edge", above: "above", below: "below" };

export class Trigger {
  /** @param {import("./feed.js").Feed} feed @param {() => void} changed */
  constructor(feed, changed) {
    this._feed = feed;
    const option = (/** @type {string[]} */ [value, textContent]) => el("option", { value, textContent });
    this._kind = el("select", { "aria-label": "Trigger" }, ...Object.entries(KINDS).map(option));
    this._path = el("select", { "aria-label": "Trigger on" });
    this._level = el("input", { type: "number", step: "any", value: "0.5", "aria-label": "Trigger level" });
    this._unit = el("span", { className: "unit" });
    this._leveled = el("label", {}, "level", this._level, this._unit);
    this._before = el("input", { type: "number", min: "0", max: "100", value: "50", "aria-label": "Shown before the trigger, %" });
    this._single = el("input", { type: "checkbox" });
    this._more = el("span", { className: "bar", hidden: true }, el("label", {}, "on", this._path), this._leveled,
      el("label", { title: "Share of the time shown that is before the trigger" }, "before", this._before, el("span", { className: "unit", textContent: "%" })),
      el("label", { title: "Stop after the first" }, this._single, "once"));
    for (const control of [this._kind, this._path, this._level, this._before, this._single]) {
      control.addEventListener("change", () => {
        if (control === this._kind || control === this._path) this._suggest();
        changed();
      });
    }
    this.element = el("span", { className: "bar trigger" }, el("label", {}, "trigger", this._kind), this._more);
  }

  /** The traces that it may wait for. @param {string[]} paths */
  choices(paths) {
    const before = this._path.value;
    this._path.replaceChildren(...paths.map((path) => el("option", { value: path, textContent: path })));
    if (paths.includes(before)) this._path.value = before;
  }

  /** The present value, as a level to begin with. */
  _suggest() {
    this._more.hidden = !this._kind.value;
    const entry = this._feed.entry(this._path.value);
    const value = this._feed.latest(this._path.value)?.value;
    if (!entry) return;
    this._leveled.hidden = isBinary(entry);
    setText(this._unit, unitOf(entry));
    this._level.value = isBinary(entry) ? "0.5" : numberText(value ?? 0, entry.digits);
  }

  /** Whether it is waited for, in words; empty: there is none. */
  get hint() {
    if (!this.request) return "";
    return this._feed.ended ? "the run has ended: no trigger comes" : WAITING;
  }

  /** For the subscription; null: none. */
  get request() {
    if (!this._kind.value || !this._path.value) return null;
    return {
      path: this._path.value, kind: this._kind.value, level: Number(this._level.value) || 0,
      before: Number(this._before.value) / 100, single: this._single.checked,
    };
  }
}
