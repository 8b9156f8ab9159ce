/** The machine: every object with value, quality, age, raw and wiring; what guards, clients and the loop did. */

import { address, el, setText, tracesOfAddress } from "./dom.js";
import { generalised, linesOf } from "./folding.js";
import { Panel } from "./panel.js";
import { Row } from "./row.js";

const COLUMNS = { raw: "Raw", wiring: "Wiring", range: "Range" };

/** @type {Record<string, number>} CSS pixels from which a column is shown unless the address says otherwise. */
const ROOMY = { raw: Infinity, wiring: 1000, range: 1400 };

export class View {
  /** @param {HTMLElement} element @param {import("./feed.js").Feed} feed */
  constructor(element, feed) {
    this.feed = feed;
    this.paths = feed.entries.map(({ path }) => path);
    /** @type {Set<string>} */
    this._unfolded = new Set();
    /** @type {Row[]} */
    this._rows = [];
    /** @type {Map<number, Row[]>} */
    this._byPlace = new Map();
    /** @type {number[]} Places of values that were old. */
    this._old = [];
    this._forbidden = "";
    this._ended = false;
    this._width = element.clientWidth;
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._body = el("tbody");
    this._table = el("table", { className: "objects" }, this._head(), this._body);
    const options = Object.entries(COLUMNS).map(([name, title]) => this._option(name, title));
    this._hint = el("span", { className: "hint" });
    this._panel = new Panel(feed);
    element.append(
      el("div", { className: "bar" }, this._filter, ...options, this._hint),
      el("div", { className: "columns" }, el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Objects and signals" }, this._table), this._panel.element),
    );
    this._fill();
    this._off = feed.on("state", () => this._refresh());
    if (feed.state) this._refresh(true);
  }

  _head() {
    const heads = [["", "quality"], ["object or signal", ""], ["value", "value"], ["age", "age"], ["raw", "raw"], ["wiring", "wiring"], ["range", "range"], ["scope", ""]];
    return el("thead", {}, el("tr", {}, ...heads.map(([textContent, className]) => el("th", { textContent, className, scope: "col" }))));
  }

  /** A column that is shown on demand, or where there is room. @param {string} name @param {string} title */
  _option(name, title) {
    const show = () => {
      this._table.classList.toggle(`with-${name}`, box.checked);
      address.set({ [name]: box.checked === byItself ? null : box.checked ? "1" : "0" });
    };
    const byItself = this._width >= ROOMY[name];
    const box = el("input", { type: "checkbox", checked: byItself ? address.get(name) !== "0" : address.get(name) === "1", onchange: show });
    queueMicrotask(show);
    return el("label", {}, box, title);
  }

  /** The lines that pass the filter; families as the user has unfolded them. */
  _fill() {
    const wanted = this._filter.value.trim().toLowerCase();
    const places = this.paths.map((_, place) => place).filter((place) => !wanted || this._text(place).includes(wanted));
    this._rows = [];
    this._byPlace = new Map();
    this._body.replaceChildren();
    /** @type {string | null} */
    let group = null;
    for (const line of linesOf(places.map((place) => this.paths[place]))) {
      if (line.group !== group) this._group(group = line.group);
      this._lines({ ...line, places: line.places.map((at) => places[at]) });
    }
    setText(this._hint, wanted ? `${places.length} of ${this.paths.length}` : "");
  }

  /** @param {number} place */
  _text(place) {
    const wire = this.feed.entries[place].wire ?? "";
    return `${this.paths[place]} ${wire}`.toLowerCase();
  }

  /** @param {string} name */
  _group(name) {
    const textContent = name || (this.feed.description?.station ?? "");
    this._body.append(el("tr", { className: "group" }, el("th", { colSpan: 8, scope: "rowgroup", textContent })));
  }

  /** A line; of a family that is unfolded, its members too. @param {import("./folding.js").Line} line */
  _lines(line) {
    const family = line.places.length > 1 ? generalised(this.paths[line.places[0]]) : "";
    const open = this._unfolded.has(family);
    this._append(line.name, line.places, { family, open, inside: false });
    if (family && open) for (const place of line.places) this._append(this.paths[place], [place], { family: "", open: false, inside: true });
  }

  /** @param {string} name @param {number[]} places @param {{family: string, open: boolean, inside: boolean}} how */
  _append(name, places, how) {
    const act = how.family ? () => this._fold(how.family) : () => this._toScope(this.paths[places[0]]);
    const row = new Row(this.feed, name, places, how, act);
    this._rows.push(row);
    for (const place of places) this._byPlace.set(place, [...(this._byPlace.get(place) ?? []), row]);
    this._body.append(row.element);
    row.mark(tracesOfAddress() ?? []);
    if (this.feed.state) row.refresh();
  }

  /** @param {string} family */
  _fold(family) {
    if (!this._unfolded.delete(family)) this._unfolded.add(family);
    this._fill();
  }

  _filtered() {
    address.set({ filter: this._filter.value.trim() });
    this._fill();
  }

  /** Put an object on the scope, or take it off. @param {string} path */
  _toScope(path) {
    const traces = (tracesOfAddress() ?? []).filter((known) => this.feed.entry(known));
    const off = traces.includes(path);
    const now = off ? traces.filter((other) => other !== path) : [...traces, path];
    address.set({ traces: now.join(",") || "-" });
    setText(this._hint, `${path} is ${off ? "off" : "on"} the scope`);
    for (const row of this._rows) row.mark(now);
  }

  /** Rows of values that have changed, and of those that are old or inhibited. */
  _refresh(all = false) {
    const { state, ended } = this.feed;
    if (!state) return;
    const forbidden = JSON.stringify([state.inhibited, state.by_client]);
    const others = all || state.full || forbidden !== this._forbidden || ended !== this._ended;
    this._forbidden = forbidden;
    this._ended = ended;
    const touched = new Set(others ? this._rows : []);
    const old = Object.keys(state.ages).map(Number);
    const places = [...this.feed.changed, ...old, ...this._old];
    this._old = old;
    for (const place of places) for (const row of this._byPlace.get(place) ?? []) touched.add(row);
    for (const row of touched) row.refresh();
    this._panel.refresh();
  }

  close() { this._off(); }
}
