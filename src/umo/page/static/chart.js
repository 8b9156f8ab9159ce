/** The drawing of the scope: uPlot for numbers, lanes for states, two cursors and the trigger over both. */

import { Buffer, doubled, lowerBound } from "./buffer.js";
import { el, isBinary, unitOf } from "./dom.js";

const uPlot = window.uPlot;
const LANE = 22;  // CSS pixels
const CONSTANT = 1e-9;  // of the value: a smaller change is none
const NARROW = 600;  // CSS pixels below which only two units have an axis
export const COLOURS = 8;

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const colour = (trace) => css(`--trace-${trace % COLOURS}`);

/**
 * @param {HTMLElement} element
 * @param {{path: string, entry: object, index: number}[]} traces  `index`: place in the buffer and number of the colour
 * @param {{onZoom: (from: number, to: number) => void}} hooks
 */
export class Chart {
  constructor(element, traces, hooks) {
    this.traces = traces;
    this.numbers = traces.filter(({ entry }) => !isBinary(entry));
    this.states = traces.filter(({ entry }) => isBinary(entry));
    this.buffer = new Buffer(traces.length);
    this.range = [0, 1];
    this.cursors = [null, null];
    this.trigger = null;
    this._hooks = hooks;
    this._element = element;
    this._lanes = el("canvas", { className: "lanes", "aria-hidden": "true" });
    this._observer = new ResizeObserver(() => this._resize());
    this._make();
    this._observer.observe(element);
  }

  /** Axes by unit: the first two on the left, the others on the right. */
  _make() {
    const units = [...new Set(this.numbers.map(({ entry }) => unitOf(entry)))];
    const text = css("--text-dim");
    const grid = { stroke: css("--grid"), width: 1 };
    const narrow = this._element.clientWidth < NARROW;
    const axis = (unit, place) => ({
      scale: `u:${unit}`, side: place < (narrow ? 1 : 2) ? 3 : 1, label: unit || " ", stroke: text, gap: 3,
      size: growing(), labelSize: 18, labelGap: 3, show: !narrow || place < 2,
      grid: place === 0 ? grid : { show: false }, ticks: grid, font: "11px system-ui", labelFont: "12px system-ui",
      values: (_, splits) => splits.map((value) => (Math.abs(value) >= 1e7 ? value.toExponential(2) : String(Number(value.toPrecision(8))))),
    });
    const options = {
      width: 300, height: 200, legend: { show: false }, padding: [10, null, 0, null], pxAlign: false,
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false },
      scales: { x: { time: false, range: () => this.range }, ...Object.fromEntries(units.map((unit) => [`u:${unit}`, { range }])) },
      axes: [
        { stroke: text, grid, ticks: grid, font: "11px system-ui", size: 30, values: (_, splits) => splits.map((value) => `${Number(value.toFixed(6))} s`) },
        ...units.map(axis),
      ],
      series: [{}, ...this.numbers.map(({ path, entry, index }) => ({
        label: path, scale: `u:${unitOf(entry)}`, stroke: colour(index), width: 1.25, points: { show: false },
        dash: index >= COLOURS ? [6, 3] : undefined,
      }))],
      hooks: { draw: [() => this._marks()], setSelect: [(plot) => this._selected(plot)] },
    };
    this.plot = new uPlot(options, [[], ...this.numbers.map(() => [])], this._element);
    this._element.append(this._lanes);
    this._resize();
  }

  _resize() {
    const width = this._element.clientWidth;
    const height = this._element.clientHeight;
    if (width < 50 || height < 50) return;
    this._laneHeight = this.states.length * LANE;
    this.plot.setSize({ width, height: Math.max(120, height - this._laneHeight) });
    const scale = window.devicePixelRatio;
    this._lanes.width = width * scale;
    this._lanes.height = this._laneHeight * scale;
    this._lanes.style.height = `${this._laneHeight}px`;
    this.draw();
  }

  /** Pixels of the plot. */
  get width() { return Math.max(50, Math.round(this.plot.bbox.width / window.devicePixelRatio)); }

  /** Draw the buffer between two times. */
  draw(range = this.range) {
    this.range = range;
    const { times, low, high } = this.buffer;
    const same = low === high;
    const data = [same ? times : doubled(times, new Float64Array(times))];
    for (const { index } of this.numbers) data.push(doubled(low[index], same ? low[index] : high[index]));
    this.plot.setData(data, true);
  }

  /** The time at a horizontal place in the plot (CSS pixels from its left edge). */
  timeAt(x) { return this.plot.posToVal(x, "x"); }

  _selected(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const times = [this.timeAt(left), this.timeAt(left + width)];
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this._hooks.onZoom(...times);
  }

  /** Cursors and the trigger; then the lanes. */
  _marks() {
    const { ctx, bbox } = this.plot;
    const lines = [...this.cursors.map((time, i) => [time, css("--cursor"), "AB"[i]]), [this.trigger, css("--bad"), "T"]];
    ctx.save();
    for (const [time, stroke, name] of lines) {
      if (time === null || time < this.range[0] || time > this.range[1]) continue;
      const x = this.plot.valToPos(time, "x", true);
      line(ctx, x, bbox.top, bbox.top + bbox.height, stroke);
      ctx.fillStyle = stroke;
      ctx.font = `${12 * window.devicePixelRatio}px system-ui`;
      ctx.fillText(name, x + 4, bbox.top + 12 * window.devicePixelRatio);
    }
    ctx.restore();
    this._drawLanes(lines);
  }

  _drawLanes(lines) {
    const ctx = this._lanes.getContext("2d");
    const { left, width } = this.plot.bbox;
    const height = LANE * window.devicePixelRatio;
    const place = (time) => left + ((time - this.range[0]) / (this.range[1] - this.range[0])) * width;
    ctx.clearRect(0, 0, this._lanes.width, this._lanes.height);
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, 0, width, this._lanes.height);
    ctx.clip();
    this.states.forEach(({ index }, lane) => this._drawStates(ctx, index, lane * height, height, place));
    for (const [time, stroke] of lines) if (time !== null) line(ctx, place(time), 0, this._lanes.height, stroke);
    ctx.restore();
    ctx.fillStyle = css("--text");
    ctx.font = `${11 * window.devicePixelRatio}px system-ui`;
    this.states.forEach(({ path, entry }, lane) => {
      ctx.fillText(`${path} (bar: ${entry.one})`, left + 4, (lane + 0.68) * height, width);
    });
  }

  /** A bar while the state is the electrical 1, a half-high one where it changed within a pixel. */
  _drawStates(ctx, trace, top, height, place) {
    const { times, low, high } = this.buffer;
    ctx.fillStyle = css("--grid");
    ctx.fillRect(0, top + height - 1, this._lanes.width, 1);
    ctx.fillStyle = colour(trace);
    const end = Math.min(times.length, lowerBound(times, this.range[1]) + 1);
    for (let i = Math.max(0, lowerBound(times, this.range[0]) - 1); i < end;) {
      const [least, most] = [low[trace][i], high[trace][i]];
      let next = i + 1;
      while (next < end && low[trace][next] === least && high[trace][next] === most) next++;
      if (most > 0.5) {
        ctx.globalAlpha = least > 0.5 ? 0.55 : 0.3;
        const x = place(times[i]);
        ctx.fillRect(x, top + 3, Math.max(1, place(times[Math.min(next, times.length - 1)]) - x), height - 6);
      }
      i = next;
    }
    ctx.globalAlpha = 1;
  }

  /** The picture with a line of text above, as PNG. @returns {Promise<Blob>} */
  picture(title) {
    const { canvas } = this.plot.ctx;
    const scale = window.devicePixelRatio;
    const head = 26 * scale + 18 * scale * Math.ceil(this.traces.length / 4);
    const all = el("canvas", { width: canvas.width, height: head + canvas.height + this._lanes.height });
    const ctx = all.getContext("2d");
    ctx.fillStyle = css("--panel");
    ctx.fillRect(0, 0, all.width, all.height);
    ctx.fillStyle = css("--text");
    ctx.font = `600 ${13 * scale}px system-ui`;
    ctx.fillText(title, 10 * scale, 18 * scale);
    ctx.font = `${12 * scale}px system-ui`;
    this.traces.forEach(({ path, index }, i) => {
      ctx.fillStyle = colour(index);
      ctx.fillText(`— ${path}`, (10 + (i % 4) * (all.width / scale - 20) / 4) * scale, (38 + 18 * Math.floor(i / 4)) * scale);
    });
    ctx.drawImage(canvas, 0, head);
    if (this._lanes.height) ctx.drawImage(this._lanes, 0, head + canvas.height);
    return new Promise((done) => { all.toBlob(done, "image/png"); });
  }

  destroy() {
    this._observer.disconnect();
    this.plot.destroy();
    this._lanes.remove();
  }
}

/** An axis is as wide as its widest number so far: the plot does not jump to and fro. */
function growing() {
  let most = 0;
  return (plot, values, number) => {
    const { font, ticks, gap } = plot.axes[number];
    plot.ctx.font = font[0];
    const widths = (values ?? []).map((text) => plot.ctx.measureText(text).width / window.devicePixelRatio);
    return (most = Math.max(most, Math.ceil(ticks.size + gap + Math.max(0, ...widths))));
  };
}

/** The range of an axis: all values with some space; about a constant a band between round numbers. */
function range(_, least, most) {
  if (!Number.isFinite(least)) return [null, null];
  const size = Math.max(Math.abs(least), Math.abs(most));
  if (most - least > size * CONSTANT) return uPlot.rangeNum(least, most, 0.1, true);
  if (!size) return [-1, 1];
  const step = 10 ** Math.floor(Math.log10(size)) / 10;
  return [(Math.floor(least / step) - 2) * step, (Math.ceil(most / step) + 2) * step];
}

function line(ctx, x, top, bottom, stroke) {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = window.devicePixelRatio;
  ctx.beginPath();
  ctx.moveTo(x, top);
  ctx.lineTo(x, bottom);
  ctx.stroke();
}
