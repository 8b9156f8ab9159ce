/** The machine: every object with value, quality, age, raw and wiring; what guards, clients and the loop did. */

import { address, el, setText, tracesOfAddress } from "./dom.js";
import { generalised, linesOf } from "./folding.js";
import { LeaseBar } from "./lease.js";
import { Panel } from "./panel.js";
import { clockText, wallTime } from "./presentation.js";
import { Row } from "./row.js";
import { Trouble } from "./trouble.js";

const COLUMNS = { write: "Write", extremes: "Least, greatest", raw: "Raw", wiring: "Wiring", range: "Range" };

/** @type {Record<string, number>} CSS pixels from which a column is shown unless the address says otherwise. */
const ROOMY = { write: Infinity, extremes: 700, raw: Infinity, wiring: 1500, range: 1800 };
const REST = 1.5;  // s without a pointer over the table after which rows may move
const HEADS = [
  ["", "quality"], ["object or signal", ""], ["value", "value"], ["write", "write"], ["least", "extreme"], ["greatest", "extreme"],
  ["age", "age"], ["raw", "raw"], ["wiring", "wiring"], ["range", "range"], ["scope", ""],
];

export class View {
  /** @param {HTMLElement} element @param {import("./feed.js").Feed} feed @param {import("./client.js").Client} client */
  constructor(element, feed, client) {
    this.feed = feed;
    this.client = client;
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
    this._writes = false;
    this._trouble = new Trouble();
    /** @type {number[]} The places in the group of what is not good. */
    this._first = [];
    /** Until when a pointer may still be about to hit a row, s. */
    this._touched = -Infinity;
    /** @type {Map<number, [number, number]>} */
    this._extremes = new Map();
    this._width = element.clientWidth;
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._body = el("tbody");
    this._table = el("table", { className: "objects" }, this._head(), this._body);
    this._lease = new LeaseBar(feed, client, { automatic: "Automatic mode: the actuators belong to the program.", answers: true });
    const options = Object.entries(COLUMNS).map(([name, title]) => this._option(name, title));
    this._anew = el("button", { textContent: "Anew", title: "Collect least and greatest values from now on, on this page", onclick: () => this._follow(true) });
    this._since = el("span", { className: "hint" });
    this._hint = el("span", { className: "hint told" });
    this._panel = new Panel(feed);
    const scroll = el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Objects and signals" }, this._table);
    for (const event of ["pointermove", "pointerdown", "pointerleave", "keydown"]) this._table.addEventListener(event, ({ type }) => { this._touched = type === "pointerleave" ? 0 : now(); });
    element.append(
      el("div", { className: "bar" }, this._filter, ...options, this._anew, this._since, this._hint), this._lease.element,
      el("div", { className: "columns" }, scroll, this._panel.element),
    );
    this._fill();
    this._follow(false);
    this._offs = [feed.on("state", () => this._refresh()), client.on(() => this._commanded())];
    if (feed.state) this._refresh(true);
  }

  _head() { return el("thead", {}, el("tr", {}, ...HEADS.map(([textContent, className]) => el("th", { textContent, className, scope: "col" })))); }

  /** A column that is shown on demand, or where there is room. @param {string} name @param {string} title */
  _option(name, title) {
    const show = () => {
      this._table.classList.toggle(`with-${name}`, box.checked);
      address.set({ [name]: box.checked === byItself ? null : box.checked ? "1" : "0" });
      if (name === "write") this._offer(box.checked);
      if (name === "extremes") this._anew.hidden = this._since.hidden = !box.checked || Boolean(this.feed.description?.recording);
    };
    const byItself = this._width >= ROOMY[name];
    const box = el("input", { type: "checkbox", checked: byItself ? address.get(name) !== "0" : address.get(name) === "1", onchange: show });
    queueMicrotask(show);
    return el("label", {}, box, title);
  }

  /** Fields and switches in the rows of actuators, and the lease that they need. @param {boolean} write */
  _offer(write) {
    this._lease.element.hidden = !write;
    if (write === this._writes) return;
    this._writes = write;
    this._fill();
    this._commanded();
  }

  /** What is not good, then the lines that pass the filter; families as the user has unfolded them. */
  _fill() {
    const wanted = this._filter.value.trim().toLowerCase();
    const places = this.paths.map((_, place) => place).filter((place) => !wanted || this._text(place).includes(wanted));
    const first = new Set(this._first);
    this._rows = [];
    this._byPlace = new Map();
    this._body.replaceChildren();
    this._section(places.filter((place) => first.has(place)), "Not good now, or shortly before");
    this._section(places.filter((place) => !first.has(place)), "");
    setText(this._hint, wanted ? `${places.length} of ${this.paths.length}` : "");
  }

  /** @param {number[]} places @param {string} title  Of all of them; "": each list has a heading of its own. */
  _section(places, title) {
    if (title && places.length) this._group(title, "trouble");
    /** @type {string | null} */
    let group = null;
    for (const line of linesOf(places.map((place) => this.paths[place]))) {
      if (!title && line.group !== group) this._group((group = line.group) || (this.feed.description?.station ?? ""));
      this._lines({ ...line, places: line.places.map((at) => places[at]) }, title);
    }
  }

  /** @param {number} place */
  _text(place) {
    const wire = this.feed.entries[place].wire ?? "";
    return `${this.paths[place]} ${wire}`.toLowerCase();
  }

  /** @param {string} textContent */
  _group(textContent, className = "") {
    this._body.append(el("tr", { className: `group ${className}`.trim() }, el("th", { colSpan: HEADS.length, scope: "rowgroup", textContent })));
  }

  /** A line; of a family that is unfolded, its members too. @param {import("./folding.js").Line} line @param {string} section */
  _lines(line, section) {
    const family = line.places.length > 1 ? section + generalised(this.paths[line.places[0]]) : "";
    const open = this._unfolded.has(family);
    this._append(line.name, line.places, { family, open, inside: false });
    if (family && open) for (const place of line.places) this._append(this.paths[place], [place], { family: "", open: false, inside: true });
  }

  /** @param {string} name @param {number[]} places @param {{family: string, open: boolean, inside: boolean}} how */
  _append(name, places, how) {
    const act = how.family ? () => this._fold(how.family) : () => this._toScope(this.paths[places[0]]);
    const row = new Row(this.feed, this.client, name, places, { ...how, write: this._writes }, act);
    this._rows.push(row);
    for (const place of places) this._byPlace.set(place, [...(this._byPlace.get(place) ?? []), row]);
    this._body.append(row.element);
    row.mark(tracesOfAddress() ?? []);
    row.showExtremes(this._extremes);
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
    const after = off ? traces.filter((other) => other !== path) : [...traces, path];
    address.set({ traces: after.join(",") || "-" });
    setText(this._hint, `${path} is ${off ? "off" : "on"} the scope`);
    for (const row of this._rows) row.mark(after);
  }

  /** The least and the greatest values: since the oldest period that the server has read, or from now on. @param {boolean} anew */
  _follow(anew) {
    this._following?.close();
    this._following = this.feed.followExtremes(anew, ({ full, since, values }) => {
      if (full) this._extremes.clear();
      for (const [place, pair] of Object.entries(values)) this._extremes.set(Number(place), pair);
      const when = since === null ? "" : wallTime(this.feed.state?.utc, since).slice(0, 8) || clockText(since);
      setText(this._since, when && `since ${when}${anew ? "" : ", the oldest period that this server has read"}`);
      const touched = full ? this._rows : Object.keys(values).flatMap((place) => this._byPlace.get(Number(place)) ?? []);
      for (const row of new Set(touched)) row.showExtremes(this._extremes);
    });
  }

  /** Rows of values that have changed, and of those that are old or inhibited. */
  _refresh(all = false) {
    const { state, ended } = this.feed;
    if (!state) return;
    this._sort();
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

  /** What is not good stands first. Rows move only while nobody is about to click on one, or writes in one. */
  _sort() {
    this._trouble.look(this.paths.map((path, place) => [place, this.feed.latest(path)?.quality ?? 0]), now());
    const { places } = this._trouble;
    if (String(places) === String(this._first) || this._table.matches(":hover") || now() - this._touched < REST || this._body.contains(document.activeElement)) return;
    this._first = places;
    this._fill();
  }

  /** The lease, the mode or an answer has changed. */
  _commanded() {
    if (!this._writes) return;
    this._lease.refresh();
    for (const row of this._rows) row.refreshControl();
  }

  close() {
    this._following?.close();
    for (const off of this._offs) off();
  }
}

const now = () => performance.now() / 1000;
