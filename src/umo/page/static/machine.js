/** The machine: every object with value, quality, age, raw and wiring; what guards, hands and the loop did. */

import { address, el, setText, tracesOfAddress } from "./dom.js";
import { generalised, linesOf } from "./folding.js";
import { Panel } from "./panel.js";
import { Row } from "./row.js";

const COLUMNS = { raw: "Raw", wiring: "Wiring", range: "Range" };

let machine = null;

export function mount(element, feed) { machine = new Machine(element, feed); }

export function unmount() {
  machine?.close();
  machine = null;
}

class Machine {
  constructor(element, feed) {
    this.feed = feed;
    this.paths = feed.entries.map(({ path }) => path);
    this._unfolded = new Set();
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._body = el("tbody");
    this._table = el("table", { className: "objects" }, this._head(), this._body);
    const options = Object.entries(COLUMNS).map(([name, title]) => this._option(name, title));
    this._hint = el("span", { className: "hint" });
    this._panel = new Panel(feed);
    element.append(
      el("div", { className: "bar" }, this._filter, ...options, this._hint),
      el("div", { className: "columns" }, el("div", { className: "scroll" }, this._table), this._panel.element),
    );
    this._fill();
    this._off = feed.on("state", () => this._refresh());
    if (feed.state) this._refresh(true);
  }

  _head() {
    const heads = [["", "quality"], ["object or signal", ""], ["value", "value"], ["age", "age"], ["raw", "raw"], ["wiring", "wiring"], ["range", "range"], ["scope", ""]];
    return el("thead", {}, el("tr", {}, ...heads.map(([textContent, className]) => el("th", { textContent, className, scope: "col" }))));
  }

  /** A column that is shown on demand. */
  _option(name, title) {
    const show = () => {
      this._table.classList.toggle(`with-${name}`, box.checked);
      address.set({ [name]: box.checked ? "1" : null });
    };
    const box = el("input", { type: "checkbox", checked: address.get(name) === "1", onchange: show });
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
    let group = null;
    for (const line of linesOf(places.map((place) => this.paths[place]))) {
      if (line.group !== group) this._group(group = line.group);
      this._lines({ ...line, places: line.places.map((at) => places[at]) });
    }
    setText(this._hint, wanted ? `${places.length} of ${this.paths.length}` : "");
  }

  _text(place) {
    const wire = this.feed.entries[place].wire ?? "";
    return `${this.paths[place]} ${wire}`.toLowerCase();
  }

  _group(name) {
    this._body.append(el("tr", { className: "group" }, el("th", { colSpan: 8, scope: "rowgroup", textContent: name || this.feed.description.station })));
  }

  /** A line; of a family that is unfolded, its members too. */
  _lines(line) {
    const family = line.places.length > 1 ? generalised(this.paths[line.places[0]]) : "";
    const open = this._unfolded.has(family);
    this._append(line.name, line.places, { family, open, inside: false });
    if (family && open) for (const place of line.places) this._append(this.paths[place], [place], { family: "", open: false, inside: true });
  }

  _append(name, places, how) {
    const act = how.family ? () => this._fold(how.family) : () => this._toScope(this.paths[places[0]]);
    const row = new Row(this.feed, name, places, how, act);
    this._rows.push(row);
    for (const place of places) this._byPlace.set(place, [...(this._byPlace.get(place) ?? []), row]);
    this._body.append(row.element);
    row.mark(tracesOfAddress() ?? []);
    if (this.feed.state) row.refresh();
  }

  _fold(family) {
    if (!this._unfolded.delete(family)) this._unfolded.add(family);
    this._fill();
  }

  _filtered() {
    address.set({ filter: this._filter.value.trim() });
    this._fill();
  }

  /** Put an object on the scope, or take it off. */
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
    const { state } = this.feed;
    const touched = new Set(all || state.full ? this._rows : []);
    const places = [...this.feed.changed, ...Object.keys(state.ages).map(Number), ...(this._old ?? [])];
    this._old = Object.keys(state.ages).map(Number);
    const inhibited = JSON.stringify(state.inhibited ?? {});
    if (inhibited !== this._inhibited) for (const row of this._rows) touched.add(row);
    this._inhibited = inhibited;
    for (const place of places) for (const row of this._byPlace.get(place) ?? []) touched.add(row);
    for (const row of touched) row.refresh();
    this._panel.refresh();
  }

  close() { this._off(); }
}

