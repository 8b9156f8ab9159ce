/** The table below the scope: a line for each trace with its value, the cursors, and the measured values. */

import { colour } from "./canvas.js";
import { el, setText } from "./dom.js";
import { clockText, duration, isBinary, numberText, stateText, unitOf, valueText, wallTime } from "./presentation.js";

/** @typedef {Record<string, number> | null} Measured */

const MEASURED = [["minimum", "min"], ["maximum", "max"], ["mean", "mean"], ["rms", "rms"], ["frequency", "frequency"]];
const READ = ["minimum", "maximum"];  // values as they were read, with their digits

export class Legend {
  /** @param {import("./feed.js").Feed} feed @param {(path: string) => void} remove */
  constructor(feed, remove) {
    this._feed = feed;
    this._remove = remove;
    this._body = el("tbody");
    /** @type {{row: HTMLElement, cells: HTMLElement[]}[]} */
    this._rows = [];
    this._now = el("th", { textContent: "value", scope: "col" });
    const heads = ["A", "B", "B - A", ...MEASURED.map(([, title]) => title), ""].map((title) => el("th", { textContent: title, scope: "col" }));
    this._time = el("caption");
    this.element = el("div", { className: "legend", tabIndex: 0, role: "region", "aria-label": "Values of the traces" },
      el("table", {}, this._time, el("thead", {}, el("tr", {}, el("th", { textContent: "trace", scope: "col" }), this._now, ...heads)), this._body));
  }

  /** @param {import("./chart.js").Chart} chart */
  show(chart) {
    this._chart = chart;
    this._rows = chart.traces.map((trace) => this._row(trace));
    this._body.replaceChildren(...this._rows.map(({ row }) => row));
    this.refresh();
  }

  /** @param {Page.Trace} trace */
  _row({ path, entry, colour: number }) {
    const swatch = el("i", { className: "swatch" });
    swatch.style.background = colour(number);
    const cells = Array.from({ length: isBinary(entry) ? 4 : 4 + MEASURED.length }, () => el("td"));
    if (isBinary(entry)) cells.push(el("td", { colSpan: MEASURED.length }));
    const close = el("button", { textContent: "×", title: `Remove ${path}`, "aria-label": `Remove ${path}`, onclick: () => this._remove(path) });
    const row = el("tr", { "data-path": path }, el("th", { scope: "row" }, swatch, path), ...cells, el("td", {}, close));
    return { row, cells };
  }

  /** Values now and at the cursors. */
  refresh() {
    if (!this._chart) return;
    const { cursors, buffer, traces } = this._chart;
    const { times } = cursors;
    setText(this._now, this._feed.ended ? "last value" : "value");
    setText(this._time, this._caption(times));
    traces.forEach(({ path, entry, index }, i) => {
      const { cells } = this._rows[i];
      const [a, b] = times.map((time) => (time === null ? null : buffer.at(index, time)));
      setText(cells[0], valueText(entry, this._feed.latest(path)?.value));
      setText(cells[1], times[0] === null ? "" : valueText(entry, a));
      setText(cells[2], times[1] === null ? "" : valueText(entry, b));
      const differ = !isBinary(entry) && a !== null && b !== null;
      setText(cells[3], differ ? `${numberText(b - a, entry.digits)} ${unitOf(entry)}`.trimEnd() : "");
    });
  }

  /** @param {(number | null)[]} times */
  _caption([a, b]) {
    const utc = this._feed.state?.utc;
    const at = (/** @type {string} */ name, /** @type {number | null} */ time) => {
      if (time === null) return "";
      const clock = wallTime(utc, time);
      return `${name}: ${clockText(time, 4)}${clock && ` (${clock})`}`;
    };
    const both = a !== null && b !== null;
    const measured = both ? `B - A: ${duration(b - a)} (${numberText(1 / Math.abs(b - a))} Hz); measured between the cursors` : "measured over the time shown";
    return [at("A", a), at("B", b), measured].filter(Boolean).join("; ");
  }

  /** @param {Measured[]} values  Per trace. */
  measured(values) {
    this._chart?.traces.forEach(({ entry }, i) => {
      const cells = this._rows[i].cells.slice(4);
      words(entry, values[i]).forEach((text, k) => setText(cells[k], text));
    });
  }
}

/** What was measured, cell by cell; of a state: the share of time and the changes. @param {Page.Entry} entry @param {Measured} found */
function words(entry, found) {
  if (!isBinary(entry)) return MEASURED.map(([name]) => (found?.[name] == null ? "" : numberText(found[name], READ.includes(name) ? entry.digits : null) + (name === "frequency" ? " Hz" : "")));
  return [found ? `${stateText(entry, 1)} ${numberText(100 * found.on, 1)} % of the time, changes: ${found.changes}` : ""];
}
