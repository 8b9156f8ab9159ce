/** The scope: objects and signals against time. */

import { Chart } from "./chart.js";
import { coloursOf, fromAddress, toAddress } from "./colours.js";
import { address, el, setText, tracesOfAddress } from "./dom.js";
import { EventStrip } from "./event_strip.js";
import { gestures, keys } from "./gestures.js";
import { Legend } from "./legend.js";
import { clusterAt, linesOf, marksOf } from "./marks.js";
import { clockText, isBinary, unitOf, wallTime } from "./presentation.js";
import { Ranges } from "./ranges.js";
import { savePicture, saveSamples } from "./saving.js";
import { ScopeBar } from "./scope_bar.js";
import { TimeShown } from "./time_shown.js";
import { Trigger, WAITING } from "./trigger.js";

const FIRST_TRACES = { numbers: 4, states: 2 };  // traces where none was chosen
const MAX_TRACES = 32;
const MEASURE_PAUSE = 1000;  // ms
const CURSOR_STEP = 0.01;  // of the time shown: a cursor moved by a key

export class View {
  /** @param {HTMLElement} element @param {import("./feed.js").Feed} feed */
  constructor(element, feed) {
    this.feed = feed;
    this.time = new TimeShown(feed, { follow: () => this._subscribe(), draw: () => this._changed(), history: (stretch) => this._fetch(stretch) });
    /** @type {string[]} */
    this.paths = [];
    /** @type {(() => void)[]} */
    this._closing = [];
    /** @type {number | null} */
    this._drawn = null;
    /** @type {{close: () => void} | null} */
    this._subscription = null;
    this.trigger = new Trigger(feed, () => this._subscribe());
    this.bar = new ScopeBar(feed.entries.map(({ path }) => path), this.trigger.element, {
      add: (path) => this._added(path), pause: () => this.pause(), span: (seconds) => this.time.set(seconds), live: () => this.time.live(), look: () => this._show(this.paths),
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
    const { time } = this;
    const theme = () => { this._show(this.paths); };
    window.addEventListener("theme", theme);
    this._closing.push(
      keys({
        " ": () => this.pause(), "+": () => time.zoom(0.5, 0.5), "-": () => time.zoom(2, 0.5), Home: () => time.live(),
        ArrowLeft: () => time.pan(-0.1, this.chart.range), ArrowRight: () => time.pan(0.1, this.chart.range), Escape: () => this._clear(),
        a: () => this._setCursor(0), b: () => this._setCursor(1), ",": () => this._moveCursor(-CURSOR_STEP), ".": () => this._moveCursor(CURSOR_STEP),
      }),
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
    address.set({ traces: this.paths.join(",") || "-", colours: toAddress(this._colours), span: String(this.time.span) });
    before?.destroy();
    const traces = this.paths.map((path, index) => (
      { path, index, entry: /** @type {Page.Entry} */ (this.feed.entry(path)), colour: this._colours.get(path) ?? 0 }
    ));
    const wall = () => (this.bar.wall ? this.feed.state?.utc ?? null : null);
    const chart = new Chart(this._plot, traces, { declared: this.bar.declared, fixed: this.ranges.fixed, wall }, {
      zoom: (from, to) => this.time.stand([from, to]), placed: (placed) => this._placed(placed),
    });
    this.chart = chart;
    if (before) chart.cursors = before.cursors;
    chart.marks = this._marks();
    gestures(chart.plot.over, {
      zoom: (factor, share) => this.time.zoom(factor, share),
      pan: (share) => this.time.pan(share, chart.range),
      click: (x) => this._moved(() => chart.cursors.click(chart.timeAt(x))),
      undoClick: () => this._moved(() => chart.cursors.undo()),
      live: () => this.time.live(),
      hover: (x) => this._hovered(x === null ? null : chart.timeAt(x)),
    });
    this.legend.show(chart);
    this.trigger.choices(this.paths);
    this._subscribe();
    this.time.settle(0);
    return chart;
  }

  /** The lanes have got another place. @param {Chart} chart */
  _placed(chart) {
    this.ranges.place(chart);
    this.events.place(chart);
  }

  // Live data ------------------------------------------------------------------------------------------

  _subscribe() {
    this._subscription?.close();
    this._subscription = null;
    this.bar.fill(this.time.length);
    this.bar.standsStill(this.time.still !== null);
    if (this.time.still || !this.paths.length) return;
    const request = { paths: this.paths, span: this.time.span, width: this.chart.width };
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
    chart.buffer.take(points, points.times[points.times.length - 1] - this.time.span);
    this.time.from = points.trigger === undefined ? null : points.start ?? null;
    this._drawSoon();
  }

  /** With the next picture of the browser. */
  _drawSoon() { this._drawn ??= requestAnimationFrame(() => this._draw()); }

  _draw() {
    this._drawn = null;
    const began = performance.now();
    const range = this.time.between(this.chart.buffer.last);
    if (range) this.chart.draw(range);
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
    if (this.time.still) this.time.live();
    else this.time.stand(this.chart.range);
  }

  /** Another stretch, or span, is shown. */
  _changed() {
    this.bar.fill(this.time.length);
    if (this.time.still) this.chart.draw(this.time.still);
  }

  /** The history of what stands still. @param {[number, number]} stretch */
  async _fetch(stretch) {
    const [start, stop] = stretch;
    const chart = this.chart;
    if (!this.paths.length) return;
    try {
      const points = await this.feed.window({ paths: this.paths, start: start - 0.01 * (stop - start), stop: stop + 0.01 * (stop - start), width: chart.width });
      if (chart !== this.chart || this.time.still !== stretch) return;
      chart.buffer.take({ ...points, from: -1 });
      this._draw();
    } catch (error) { this.bar.hint = String(error instanceof Error ? error.message : error); }
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
    const second = this.feed.description?.recording?.second;
    const both = [path, ...(second ? [`${second}.${path}`] : [])].filter((known) => this.feed.entry(known));
    const found = both.length ? both : this.feed.entries.map((entry) => entry.path).filter((known) => known.startsWith(`${path}.`));
    if (!found.length) this.bar.hint = `no object or signal ${path}`;
    else this._show([...this.paths, ...found].slice(0, MAX_TRACES));
  }

  // Measured values -------------------------------------------------------------------------------------

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

  close() {
    clearInterval(this._timer);
    this.time.close();
    if (this._drawn) cancelAnimationFrame(this._drawn);
    this._subscription?.close();
    for (const end of this._closing) end();
    this.chart.destroy();
  }
}

/** @param {import("./feed.js").Feed} feed */
function firstTraces(feed) {
  const second = feed.description?.recording?.second;
  const numbers = feed.entries.filter((entry) => !isBinary(entry) && unitOf(entry)).slice(0, FIRST_TRACES.numbers / (second ? 2 : 1));
  const states = feed.entries.filter(isBinary).slice(0, FIRST_TRACES.states / (second ? 2 : 1));
  return [...numbers, ...states].flatMap(({ path }) => (second && feed.entry(`${second}.${path}`) ? [path, `${second}.${path}`] : [path]));
}
