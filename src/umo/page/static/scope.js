/** The scope: objects and signals against time. */

import { Chart } from "./chart.js";
import { address, duration, el, isBinary, save, setText, tracesOfAddress, unitOf } from "./dom.js";
import { gestures } from "./gestures.js";
import { Legend } from "./legend.js";
import { Trigger } from "./trigger.js";

const SPANS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300];  // s
const SHORTEST = 0.002;
const FIRST = { numbers: 4, states: 2 };  // traces where none was chosen
const MOST = 32;
const MEASURE = 1000;  // ms
const SETTLE = 120;  // ms without a change of the view before its history is asked for

let scope = null;

export function mount(element, feed) { scope = new Scope(element, feed); }

export function unmount() {
  scope?.close();
  scope = null;
}

class Scope {
  constructor(element, feed) {
    this.feed = feed;
    this.span = Number(address.get("span")) || 10;
    this.view = null;  // [from, to] while it stands still
    this._closing = [];
    this._build(element);
    const chosen = tracesOfAddress() ?? firstTraces(feed);
    this._show(chosen.filter((path) => feed.entry(path)).slice(0, MOST));
    const key = (event) => this._key(event);
    const theme = () => this._show(this.paths);
    document.addEventListener("keydown", key);
    window.addEventListener("theme", theme);
    this._closing.push(
      () => document.removeEventListener("keydown", key),
      () => window.removeEventListener("theme", theme),
      feed.on("state", () => this.legend.refresh()),
      feed.on("connection", () => this._subscribe()),
    );
    this._timer = setInterval(() => this._measure(), MEASURE);
  }

  _build(element) {
    const button = (text, title, onclick) => el("button", { textContent: text, title, onclick });
    this._paths = el("datalist", { id: "paths" }, ...this.feed.entries.map(({ path }) => el("option", { value: path })));
    this._add = el("input", { type: "search", placeholder: "Add object or signal", list: "paths", "aria-label": "Add object or signal" });
    this._add.addEventListener("change", () => this._added());
    this._pause = button("Pause", "Space", () => this.pause());
    this._spans = el("select", { title: "Time shown", "aria-label": "Time shown", onchange: () => this._spanned(Number(this._spans.value)) });
    this.trigger = new Trigger(this.feed, () => this._subscribe());
    this._plot = el("div", { className: "plot" });
    this._hint = el("span", { className: "hint" });
    this.legend = new Legend(this.feed, (path) => this._show(this.paths.filter((other) => other !== path)));
    element.append(
      el("div", { className: "bar" }, this._add, this._paths, this._pause, this._spans,
        button("Live", "Home", () => this.live()), this.trigger.element,
        button("Clear cursors", "Esc", () => this._clear()), button("PNG", "Save as a picture", () => this._picture()),
        button("CSV", "Save every sample of the time shown", () => this._csv()), this._hint),
      this._plot, this.legend.element,
    );
  }

  /** Draw these traces from now on. */
  _show(paths) {
    this.paths = [...new Set(paths)];
    address.set({ traces: this.paths.join(",") || "-", span: String(this.span) });
    const cursors = this.chart?.cursors;
    this.chart?.destroy();
    const traces = this.paths.map((path, index) => ({ path, index, entry: this.feed.entry(path) }));
    this.chart = new Chart(this._plot, traces, { onZoom: (from, to) => this._zoomTo(from, to) });
    if (cursors) this.chart.cursors = cursors;
    gestures(this.chart.plot.over, {
      zoom: (factor, share) => this._zoom(factor, share),
      pan: (share) => this._pan(share),
      click: (x) => this._cursor(this.chart.timeAt(x)),
      live: () => this.live(),
    });
    this.legend.show(this.chart);
    this.trigger.choices(this.paths);
    this._fillSpans();
    this._subscribe();
    if (this.view) this._settle(0);
  }

  _fillSpans() {
    const spans = SPANS.includes(this.span) ? SPANS : [...SPANS, this.span].sort((a, b) => a - b);
    this._spans.replaceChildren(...spans.map((span) => el("option", { value: String(span), textContent: duration(span) })));
    this._spans.value = String(this.span);
  }

  // Live data ------------------------------------------------------------------------------------------

  _subscribe() {
    this._subscription?.close();
    this._subscription = null;
    setText(this._pause, this.view ? "Continue" : "Pause");
    if (this.view || !this.paths.length) return;
    const request = { paths: this.paths, span: this.span, width: this.chart.width };
    const trigger = this.trigger.request;
    setText(this._hint, trigger ? "waiting for the trigger" : "");
    this._subscription = this.feed.subscribe(trigger ? { ...request, trigger } : request, (points) => this._take(points));
  }

  /** Points from the server: drawn with the next picture of the browser. */
  _take(points) {
    const { chart } = this;
    if (points.trigger !== undefined) {
      chart.trigger = points.trigger;
      setText(this._hint, `triggered at ${points.trigger.toFixed(4)} s`);
    } else if (points.from < 0) chart.trigger = null;
    chart.buffer.take(points, points.times[points.times.length - 1] - this.span);
    this._from = points.trigger === undefined ? null : points.start;
    this._drawn ??= requestAnimationFrame(() => this._draw());
  }

  _draw() {
    this._drawn = null;
    const began = performance.now();
    const last = this.chart.buffer.last;
    if (this.view) this.chart.draw(this.view);
    else if (this._from !== null && this._from !== undefined) this.chart.draw([this._from, this._from + this.span]);
    else if (last !== null) this.chart.draw([last - this.span, last]);
    queueMicrotask(() => {  // after uPlot's, which draws
      performance.measure("umo-scope", { start: began, end: performance.now() });
      performance.clearMeasures("umo-scope");
    });
  }

  // What is shown --------------------------------------------------------------------------------------

  /** Stand still, or go on. */
  pause() {
    if (this.view) this.live();
    else this._still(this.chart.range);
  }

  live() {
    this.view = null;
    this._from = null;
    this._subscribe();
  }

  _still([from, to]) {
    const { start, stop } = this.feed.range();
    const span = Math.min(Math.max(to - from, SHORTEST), Math.max(stop - start, SHORTEST));
    const begin = Math.min(Math.max(from, start), Math.max(stop - span, start));
    const was = this.view;
    this.view = [begin, begin + span];
    if (!was) this._subscribe();
    this.chart.draw(this.view);
    this._settle(SETTLE);
  }

  /** Ask for the history of the view when it has not changed for a while. */
  _settle(wait) {
    clearTimeout(this._settling);
    this._settling = setTimeout(async () => {
      const [start, stop] = this.view ?? [];
      if (start === undefined || !this.paths.length) return;
      const chart = this.chart;
      try {
        const points = await this.feed.window({ paths: this.paths, start: start - 0.01 * (stop - start), stop: stop + 0.01 * (stop - start), width: chart.width });
        if (chart !== this.chart || !this.view || this.view[0] !== start || this.view[1] !== stop) return;
        chart.buffer.take({ ...points, from: -1 });
        this._draw();
      } catch (error) { setText(this._hint, error.message); }
    }, wait);
  }

  _zoomTo(from, to) { this._still([from, to]); }

  _zoom(factor, share) {
    if (!this.view) {
      this._spanned(Math.min(Math.max(Number((this.span * factor).toPrecision(3)), 0.01), 300));
      return;
    }
    const [from, to] = this.view;
    const middle = from + (to - from) * share;
    this._still([middle - (middle - from) * factor, middle + (to - middle) * factor]);
  }

  _pan(share) {
    const [from, to] = this.view ?? this.chart.range;
    this._still([from + share * (to - from), to + share * (to - from)]);
  }

  _spanned(span) {
    this.span = span;
    address.set({ span: String(span) });
    this._fillSpans();
    if (this.view) {
      const middle = (this.view[0] + this.view[1]) / 2;
      this._still([middle - span / 2, middle + span / 2]);
      return;
    }
    clearTimeout(this._settling);
    this._settling = setTimeout(() => this._subscribe(), SETTLE);
  }

  /** Click: cursor A, then B; then the nearer one moves. */
  _cursor(time) {
    const { cursors } = this.chart;
    const free = cursors.indexOf(null);
    const nearer = Math.abs(time - cursors[0]) <= Math.abs(time - cursors[1]) ? 0 : 1;
    cursors[free < 0 ? nearer : free] = time;
    this._redraw();
    this._measure();
  }

  _clear() {
    this.chart.cursors = [null, null];
    this._redraw();
    this._measure();
  }

  _redraw() {
    this.chart.draw();
    this.legend.refresh();
  }

  _added() {
    const path = this._add.value.trim();
    const found = this.feed.entry(path) ? [path] : this.feed.entries.map((entry) => entry.path).filter((known) => known.startsWith(`${path}.`));
    this._add.value = "";
    if (!path) return;
    if (!found.length) setText(this._hint, `no object or signal ${path}`);
    else this._show([...this.paths, ...found].slice(0, MOST));
  }

  // Measured values, files, keys -------------------------------------------------------------------------

  async _measure() {
    const chart = this.chart;
    if (this._measuring || !this.paths.length || !this.feed.connected || document.hidden) return;
    const between = chart.cursors.every((time) => time !== null);
    const [start, stop] = between ? [...chart.cursors].sort((a, b) => a - b) : chart.range;
    this._measuring = true;
    try {
      const { values } = await this.feed.measure({ paths: this.paths, start, stop });
      if (chart === this.chart) this.legend.measured(values);
    } catch { /* the connection is being made again */ } finally { this._measuring = false; }
  }

  async _picture() {
    save(`${this.feed.station}.png`, await this.chart.picture(`${this.feed.station}, ${this.chart.range.map((time) => time.toFixed(3)).join(" to ")} s`));
  }

  /** Every sample of the time shown, from the server straight into a file. */
  _csv() {
    const [start, stop] = this.chart.range;
    const query = new URLSearchParams([...this.paths.map((path) => ["path", path]), ["start", start], ["stop", stop]]);
    el("a", { href: `csv/${encodeURIComponent(this.feed.station)}?${query}`, download: `${this.feed.station}.csv` }).click();
  }

  _key(event) {
    if (event.target.matches("input, select, textarea, button") && event.key !== "Escape") return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const act = {
      " ": () => this.pause(), "+": () => this._zoom(0.5, 0.5), "-": () => this._zoom(2, 0.5), Home: () => this.live(),
      ArrowLeft: () => this._pan(-0.1), ArrowRight: () => this._pan(0.1), Escape: () => this._clear(),
    }[event.key];
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

function firstTraces(feed) {
  const numbers = feed.entries.filter((entry) => !isBinary(entry) && unitOf(entry)).slice(0, FIRST.numbers);
  const states = feed.entries.filter(isBinary).slice(0, FIRST.states);
  return [...numbers, ...states].map(({ path }) => path);
}
