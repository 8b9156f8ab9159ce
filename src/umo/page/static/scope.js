/** The scope: objects and signals against time. */

import { Chart } from "./chart.js";
import { coloursOf, fromAddress, toAddress } from "./colours.js";
import { address, el, setText, tracesOfAddress } from "./dom.js";
import { EventStrip } from "./event_strip.js";
import { gestures } from "./gestures.js";
import { Legend } from "./legend.js";
import { clusterAt, linesOf, marksOf } from "./marks.js";
import { clockText, isBinary, unitOf, wallTime } from "./presentation.js";
import { Ranges } from "./ranges.js";
import { savePicture, saveSamples } from "./saving.js";
import { ScopeBar } from "./scope_bar.js";
import { Trigger, WAITING } from "./trigger.js";

const MIN_SPAN = 0.002;
const FIRST_TRACES = { numbers: 4, states: 2 };  // traces where none was chosen
const MAX_TRACES = 32;
const MEASURE_PAUSE = 1000;  // ms
const SETTLE_TIME = 120;  // ms without a change of the view before its history is asked for
const CURSOR_STEP = 0.01;  // of the time shown: a cursor moved by a key

export class View {
  /** @param {HTMLElement} element @param {import("./feed.js").Feed} feed */
  constructor(element, feed) {
    this.feed = feed;
    this.span = Number(address.get("span")) || 10;
    /** @type {[number, number] | null} While it stands still. */
    this.view = null;
    /** @type {string[]} */
    this.paths = [];
    /** @type {number | null} Where a triggered picture begins. */
    this._from = null;
    /** @type {(() => void)[]} */
    this._closing = [];
    /** @type {number | null} */
    this._drawn = null;
    /** @type {{close: () => void} | null} */
    this._subscription = null;
    this.trigger = new Trigger(feed, () => this._subscribe());
    this.bar = new ScopeBar(feed.entries.map(({ path }) => path), this.trigger.element, {
      add: (path) => this._added(path), pause: () => this.pause(), span: (seconds) => this._spanned(seconds), live: () => this.live(), look: () => this._show(this.paths),
      clear: () => this._clear(), picture: () => savePicture(feed, this.chart, this.bar.wall), samples: () => saveSamples(feed, this.paths, this.chart.range),
    });
    this._plot = el("div", { className: "plot" });
    this.ranges = new Ranges(this._plot, () => this.chart.draw());
    this.events = new EventStrip(this._plot);
    this._hover = el("span", { className: "hint hover" });
    this.legend = new Legend(feed, (path) => { this._show(this.paths.filter((other) => other !== path)); });
    element.append(this.bar.element, this._plot, this._hover, this.legend.element);
    const chosen = (tracesOfAddress() ?? firstTraces(feed)).filter((path) => feed.entry(path)).slice(0, MAX_TRACES);
    this._colours = fromAddress(chosen, address.get("colours"));
    /** @type {Chart} */
    this.chart = this._show(chosen, null);
    const key = (/** @type {KeyboardEvent} */ event) => this._key(event);
    const theme = () => { this._show(this.paths); };
    document.addEventListener("keydown", key);
    window.addEventListener("theme", theme);
    this._closing.push(
      () => document.removeEventListener("keydown", key),
      () => window.removeEventListener("theme", theme),
      feed.on("state", () => this._onState()),
      feed.on("connection", () => this._subscribe()),
    );
    this._timer = setInterval(() => this._measure(), MEASURE_PAUSE);
  }

  /** Draw these traces from now on. @param {string[]} paths @param {Chart | null} before @returns {Chart} */
  _show(paths, before = this.chart) {
    this.paths = [...new Set(paths)];
    this._colours = coloursOf(this.paths, this._colours);
    this._colours = new Map(this.paths.map((path) => [path, this._colours.get(path) ?? 0]));
    address.set({ traces: this.paths.join(",") || "-", colours: toAddress(this._colours), span: String(this.span) });
    before?.destroy();
    const traces = this.paths.map((path, index) => (
      { path, index, entry: /** @type {Page.Entry} */ (this.feed.entry(path)), colour: this._colours.get(path) ?? 0 }
    ));
    const wall = () => (this.bar.wall ? this.feed.state?.utc ?? null : null);
    const chart = new Chart(this._plot, traces, { declared: this.bar.declared, fixed: this.ranges.fixed, wall }, {
      zoom: (from, to) => this._still([from, to]), placed: (placed) => this._placed(placed),
    });
    this.chart = chart;
    if (before) chart.cursors = before.cursors;
    chart.marks = this._marks();
    gestures(chart.plot.over, {
      zoom: (factor, share) => this._zoom(factor, share),
      pan: (share) => this._pan(share),
      click: (x) => this._moved(() => chart.cursors.click(chart.timeAt(x))),
      undoClick: () => this._moved(() => chart.cursors.undo()),
      live: () => this.live(),
      hover: (x) => this._hovered(x === null ? null : chart.timeAt(x)),
    });
    this.legend.show(chart);
    this.trigger.choices(this.paths);
    this._fillSpans();
    this._subscribe();
    if (this.view) this._settle(0);
    return chart;
  }

  /** The lanes have got another place. @param {Chart} chart */
  _placed(chart) {
    this.ranges.place(chart);
    this.events.place(chart);
  }

  _fillSpans() { this.bar.fill(this.view ? Number((this.view[1] - this.view[0]).toPrecision(3)) : this.span); }

  // Live data ------------------------------------------------------------------------------------------

  _subscribe() {
    this._subscription?.close();
    this._subscription = null;
    this.bar.standsStill(this.view !== null);
    if (this.view || !this.paths.length) return;
    const request = { paths: this.paths, span: this.span, width: this.chart.width };
    const trigger = this.trigger.request;
    this.bar.hint = this.trigger.hint;
    this._subscription = this.feed.subscribe(trigger ? { ...request, trigger } : request, (points) => this._take(points));
  }

  /** Points from the server. @param {Page.Points} points */
  _take(points) {
    const { chart } = this;
    if (points.trigger !== undefined) {
      chart.trigger = points.trigger;
      this.bar.hint = `triggered at ${this._moment(points.trigger)}`;
    } else if (points.from < 0) chart.trigger = null;
    chart.buffer.take(points, points.times[points.times.length - 1] - this.span);
    this._from = points.trigger === undefined ? null : points.start ?? null;
    this._drawSoon();
  }

  /** With the next picture of the browser. */
  _drawSoon() { this._drawn ??= requestAnimationFrame(() => this._draw()); }

  _draw() {
    this._drawn = null;
    const began = performance.now();
    const last = this.chart.buffer.last;
    if (this.view) this.chart.draw(this.view);
    else if (this._from !== null) this.chart.draw([this._from, this._from + this.span]);
    else if (last !== null) this.chart.draw([last - this.span, last]);
    queueMicrotask(() => {  // after uPlot's, which draws
      performance.measure("umo-scope", { start: began, end: performance.now() });
      performance.clearMeasures("umo-scope");
    });
  }

  _onState() {
    this.legend.refresh();
    this.bar.clockIsKnown(typeof this.feed.state?.utc === "number");
    if (this.bar.hint === WAITING) this.bar.hint = this.trigger.hint;  // the run may have ended
    const marks = this._marks();
    if (marks.length === this.chart.marks.length && marks.at(-1)?.text === this.chart.marks.at(-1)?.text) return;
    this.chart.marks = marks;
    this._drawSoon();
  }

  _marks() { return marksOf(this.feed.events, this.feed.misses); }

  // What is shown --------------------------------------------------------------------------------------

  /** Stand still, or go on. */
  pause() {
    if (this.view) this.live();
    else this._still(this.chart.range);
  }

  live() {
    this.view = null;
    this._from = null;
    this._fillSpans();
    this._subscribe();
  }

  /** @param {[number, number]} view */
  _still([from, to]) {
    const { start, stop } = this.feed.range();
    const span = Math.min(Math.max(to - from, MIN_SPAN), Math.max(stop - start, MIN_SPAN));
    const begin = Math.min(Math.max(from, start), Math.max(stop - span, start));
    const was = this.view;
    this.view = [begin, begin + span];
    if (!was) this._subscribe();
    this._fillSpans();
    this.chart.draw(this.view);
    this._settle(SETTLE_TIME);
  }

  /** Ask for the history of the view when it has not changed for a while. @param {number} wait */
  _settle(wait) {
    clearTimeout(this._settling);
    this._settling = setTimeout(async () => {
      if (!this.view || !this.paths.length) return;
      const [start, stop] = this.view;
      const chart = this.chart;
      try {
        const points = await this.feed.window({ paths: this.paths, start: start - 0.01 * (stop - start), stop: stop + 0.01 * (stop - start), width: chart.width });
        if (chart !== this.chart || !this.view || this.view[0] !== start || this.view[1] !== stop) return;
        chart.buffer.take({ ...points, from: -1 });
        this._draw();
      } catch (error) { this.bar.hint = String(error instanceof Error ? error.message : error); }
    }, wait);
  }

  /** @param {number} factor @param {number} share */
  _zoom(factor, share) {
    if (!this.view) {
      this._spanned(Math.min(Math.max(Number((this.span * factor).toPrecision(3)), 0.01), 300));
      return;
    }
    const [from, to] = this.view;
    const middle = from + (to - from) * share;
    this._still([middle - (middle - from) * factor, middle + (to - middle) * factor]);
  }

  /** @param {number} share */
  _pan(share) {
    const [from, to] = this.view ?? this.chart.range;
    this._still([from + share * (to - from), to + share * (to - from)]);
  }

  /** @param {number} span */
  _spanned(span) {
    this.span = span;
    address.set({ span: String(span) });
    if (this.view) {
      const middle = (this.view[0] + this.view[1]) / 2;
      this._still([middle - span / 2, middle + span / 2]);
      return;
    }
    this._fillSpans();
    clearTimeout(this._settling);
    this._settling = setTimeout(() => this._subscribe(), SETTLE_TIME);
  }

  /** The cursors have changed by this. @param {() => void} act */
  _moved(act) {
    act();
    this.chart.draw();
    this.legend.refresh();
    this._measure();
  }

  _clear() { this._moved(() => this.chart.cursors.clear()); }

  /** Set a cursor in the middle, by a key. @param {number} which */
  _setCursor(which) {
    const [from, to] = this.chart.range;
    this._moved(() => this.chart.cursors.set(which, (from + to) / 2));
  }

  /** @param {number} share  Of the time shown. */
  _moveCursor(share) {
    const [from, to] = this.chart.range;
    this._moved(() => this.chart.cursors.move(share * (to - from)));
  }

  /** Where the mouse is: the time, and what happened there. @param {number | null} time */
  _hovered(time) {
    const mark = time === null ? null : clusterAt(this.chart.clusters, time, this.chart.pixel);
    setText(this._hover, time === null ? "" : [this._moment(time), ...(mark ? linesOf(mark) : [])].join(" · "));
  }

  /** @param {number} time */
  _moment(time) {
    const clock = wallTime(this.feed.state?.utc, time);
    return `${clockText(time, 4)}${clock && ` (${clock})`}`;
  }

  /** @param {string} path */
  _added(path) {
    const found = this.feed.entry(path) ? [path] : this.feed.entries.map((entry) => entry.path).filter((known) => known.startsWith(`${path}.`));
    if (!found.length) this.bar.hint = `no object or signal ${path}`;
    else this._show([...this.paths, ...found].slice(0, MAX_TRACES));
  }

  // Measured values, keys --------------------------------------------------------------------------------

  async _measure() {
    const chart = this.chart;
    if (this._measuring || !this.paths.length || !this.feed.connected || document.hidden) return;
    const [start, stop] = chart.cursors.between ?? chart.range;
    this._measuring = true;
    try {
      const { values } = await this.feed.measure({ paths: this.paths, start, stop });
      if (chart === this.chart) this.legend.measured(values);
    } catch { /* the connection is being made again */ } finally { this._measuring = false; }
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    const target = /** @type {Element} */ (event.target);
    if (target.matches("input, select, textarea, button, [role=tab]") && event.key !== "Escape") return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {Record<string, () => void>} */
    const acts = {
      " ": () => this.pause(), "+": () => this._zoom(0.5, 0.5), "-": () => this._zoom(2, 0.5), Home: () => this.live(),
      ArrowLeft: () => this._pan(-0.1), ArrowRight: () => this._pan(0.1), Escape: () => this._clear(),
      a: () => this._setCursor(0), b: () => this._setCursor(1), ",": () => this._moveCursor(-CURSOR_STEP), ".": () => this._moveCursor(CURSOR_STEP),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  close() {
    clearInterval(this._timer);
    clearTimeout(this._settling);
    if (this._drawn) cancelAnimationFrame(this._drawn);
    this._subscription?.close();
    for (const end of this._closing) end();
    this.chart.destroy();
  }
}

/** @param {import("./feed.js").Feed} feed */
function firstTraces(feed) {
  const numbers = feed.entries.filter((entry) => !isBinary(entry) && unitOf(entry)).slice(0, FIRST_TRACES.numbers);
  const states = feed.entries.filter(isBinary).slice(0, FIRST_TRACES.states);
  return [...numbers, ...states].map(({ path }) => path);
}
