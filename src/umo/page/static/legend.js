/** The table below the scope: a line for each trace with its value, the cursors, and the measured values. */

import { colour } from "./chart.js";
import { duration, el, isBinary, setText, shortNumber, shown, unitOf } from "./dom.js";

const MEASURED = [["minimum", "min"], ["maximum", "max"], ["mean", "mean"], ["rms", "rms"], ["frequency", "frequency"]];

export class Legend {
  /** @param {(path: string) => void} remove */
  constructor(feed, remove) {
    this._feed = feed;
    this._remove = remove;
    this._body = el("tbody");
    const heads = ["trace", "value", "A", "B", "B - A", ...MEASURED.map(([, title]) => title), ""];
    this._time = el("caption");
    this.element = el("div", { className: "legend" },
      el("table", {}, this._time, el("thead", {}, el("tr", {}, ...heads.map((title) => el("th", { textContent: title, scope: "col" })))), this._body));
  }

  show(chart) {
    this._chart = chart;
    this._rows = chart.traces.map((trace) => this._row(trace));
    this._body.replaceChildren(...this._rows.map(({ row }) => row));
    this.refresh();
  }

  _row({ path, entry, index }) {
    const swatch = el("i", { className: "swatch" });
    swatch.style.background = colour(index);
    const cells = Array.from({ length: isBinary(entry) ? 4 : 4 + MEASURED.length }, () => el("td"));
    if (isBinary(entry)) cells.push(el("td", { colSpan: MEASURED.length }));
    const close = el("button", { textContent: "×", title: `Remove ${path}`, "aria-label": `Remove ${path}`, onclick: () => this._remove(path) });
    const row = el("tr", { "data-path": path }, el("th", { scope: "row" }, swatch, path), ...cells, el("td", {}, close));
    return { row, cells };
  }

  /** Values now and at the cursors. */
  refresh() {
    const { cursors, buffer, traces } = this._chart;
    const [a, b] = cursors;
    const both = a !== null && b !== null;
    setText(this._time, both ? `B - A: ${duration(b - a)} (${shortNumber(1 / Math.abs(b - a))} Hz); measured between the cursors` : "measured over the time shown");
    traces.forEach(({ path, entry, index }, i) => {
      const { cells } = this._rows[i];
      const at = cursors.map((time) => (time === null ? null : buffer.at(index, time)));
      setText(cells[0], shown(entry, this._feed.latest(path)?.value));
      cursors.forEach((time, k) => setText(cells[1 + k], time === null ? "" : shown(entry, at[k])));
      const differ = both && !isBinary(entry) && at[0] !== null && at[1] !== null;
      setText(cells[3], differ ? `${shortNumber(at[1] - at[0])} ${unitOf(entry)}` : "");
    });
  }

  /** @param {(object | null)[]} values  Per trace. */
  measured(values) {
    this._chart.traces.forEach(({ entry }, i) => {
      const cells = this._rows[i].cells.slice(4);
      words(entry, values[i]).forEach((text, k) => setText(cells[k], text));
    });
  }
}

/** What was measured, cell by cell; of a state: the share of time and the changes. */
function words(entry, found) {
  if (!isBinary(entry)) return MEASURED.map(([name]) => (found?.[name] == null ? "" : `${shortNumber(found[name])}${name === "frequency" ? " Hz" : ""}`));
  return [found ? `${entry.one} ${(100 * found.on).toFixed(1)} % of the time, changes: ${found.changes}` : ""];
}
