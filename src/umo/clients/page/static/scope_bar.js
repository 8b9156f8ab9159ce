/** The controls above the scope. */

import { address, el, setText } from "./dom.js";
import { duration } from "./presentation.js";

const SPANS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300];  // s

/**
 * What the controls do. `look`: how the axes look has changed.
 * @typedef {{add: (path: string) => void, pause: () => void, span: (seconds: number) => void, live: () => void, look: () => void,
 *   clear: () => void, picture: () => void, samples: () => void}} Acts
 */

export class ScopeBar {
  /** @param {string[]} paths  That can be added. @param {HTMLElement} trigger @param {Acts} act */
  constructor(paths, trigger, act) {
    const button = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ onclick) => el("button", { textContent: text, title, onclick });
    const switched = (/** @type {string} */ name, /** @type {string} */ value) => el("input", { type: "checkbox", checked: address.get(name) === value, onchange: () => {
      address.set({ range: this.declared ? "declared" : null, clock: this.wall ? "wall" : null });
      act.look();
    } });
    this._add = el("input", { type: "search", placeholder: "Add object or signal", list: "paths", "aria-label": "Add object or signal", onchange: () => {
      const path = this._add.value.trim();
      this._add.value = "";
      if (path) act.add(path);
    } });
    this._pause = button("Pause", "Space", act.pause);
    this._spans = el("select", { title: "Time shown", "aria-label": "Time shown", onchange: () => act.span(Number(this._spans.value)) });
    this._declared = switched("range", "declared");
    this._wall = switched("clock", "wall");
    this._clock = el("label", { title: "Local time on the time axis; without it the time of the station", hidden: true }, this._wall, "Wall clock");
    this._hint = el("span", { className: "hint" });
    this.element = el("div", { className: "bar" }, this._add, el("datalist", { id: "paths" }, ...paths.map((value) => el("option", { value }))),
      this._pause, this._spans, button("Live", "Home, or a double click", act.live), trigger,
      el("label", { title: "Fix the axes to the declared ranges" }, this._declared, "Declared range"), this._clock,
      button("Clear cursors", "Esc; A and B set one, comma and full stop move it", act.clear), button("PNG", "Save as a picture", act.picture),
      button("CSV", "Save every sample of the time shown", act.samples), this._hint);
  }

  /** Whether axes show declared ranges. */
  get declared() { return this._declared.checked; }

  /** Whether the time axis shows local times. */
  get wall() { return this._wall.checked; }

  /** Whether the run keeps the pace of the wall clock. @param {boolean} known */
  clockIsKnown(known) { this._clock.hidden = !known; }

  get hint() { return this._hint.textContent ?? ""; }
  set hint(text) { setText(this._hint, text); }

  /** @param {boolean} still */
  standsStill(still) { setText(this._pause, still ? "Continue" : "Pause"); }

  /** The time shown, also one that no choice has, as after a zoom. @param {number} span  s. */
  fill(span) {
    if (Number(this._spans.value) === span && this._spans.length) return;
    const spans = SPANS.includes(span) ? SPANS : [...SPANS, span].sort((a, b) => a - b);
    this._spans.replaceChildren(...spans.map((each) => el("option", { value: String(each), textContent: duration(each) })));
    this._spans.value = String(span);
  }
}
