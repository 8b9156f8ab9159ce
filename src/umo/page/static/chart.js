/** The drawing of the scope: uPlot for numbers, bars for states; cursors, the trigger and marks over both. */

import { axesOf, declaredRange, inLane, laneSplits, NARROW_UNITS, rangeOf } from "./axes.js";
import { Buffer, doubled, lowerBound } from "./buffer.js";
import { Cursors } from "./cursors.js";
import { el } from "./dom.js";
import { isBinary, scaleTexts } from "./presentation.js";

const { uPlot } = window;
const BAR_HEIGHT = 22;  // CSS pixels of a state
const NARROW_WIDTH = 600;  // CSS pixels below which the page is narrow
const MIN_LANE_HEIGHT = 64;  // CSS pixels
const LANE_AXIS_WIDTH = 62;  // CSS pixels beside the lanes: their axes stand in one place, for which the last one makes room
const FONT = "11px system-ui";
const COLOURS = 8;
const MARKS = { command: "--accent", mode: "--cursor", missed: "--bad", guard: "--warn" };
const SIGNS = { command: "▾", mode: "M", missed: "!", guard: "⊘" };

/** @param {string} name */
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
/** @param {number} number */
export const colour = (number) => css(`--trace-${number % COLOURS}`);

export class Chart {
  /**
   * @param {HTMLElement} element @param {Page.Trace[]} traces
   * @param {{lanes: boolean, declared: boolean}} how  `lanes`: each number has its own; `declared`: axes show the
   *   declared ranges.
   * @param {(from: number, to: number) => void} onZoom
   */
  constructor(element, traces, how, onZoom) {
    this.traces = traces;
    this.numbers = traces.filter(({ entry }) => !isBinary(entry));
    this.states = traces.filter(({ entry }) => isBinary(entry));
    this.buffer = new Buffer(traces.length);
    /** @type {[number, number]} */
    this.range = [0, 1];
    this.cursors = new Cursors();
    /** @type {number | null} */
    this.trigger = null;
    /** @type {Page.Mark[]} */
    this.marks = [];
    this._how = how;
    this._onZoom = onZoom;
    this._element = element;
    this._bars = el("canvas", { className: "bars", "aria-hidden": "true" });
    this._observer = new ResizeObserver(() => this._resize());
    this.plot = this._make();
    this._element.append(this._bars);
    this._resize();
    this._observer.observe(element);
  }

  /** The first two axes on the left, the others on the right; lanes all on the left. */
  _make() {
    const narrow = this._element.clientWidth < NARROW_WIDTH;
    const units = axesOf(this.numbers, false);
    const inLanes = this._how.lanes || (narrow && units.length > NARROW_UNITS);
    const axes = inLanes ? axesOf(this.numbers, true) : units;
    this._element.style.minHeight = inLanes ? `${axes.length * MIN_LANE_HEIGHT + this.states.length * BAR_HEIGHT + 60}px` : "";
    const text = css("--text-dim");
    const grid = { stroke: css("--grid"), width: 1 };
    return new uPlot({
      width: 300, height: 200, legend: { show: false }, padding: [14, null, 0, null], pxAlign: false,
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false },
      scales: { x: { time: false, range: () => this.range }, ...Object.fromEntries(axes.map((axis) => [axis.scale, { range: this._rangeOf(axis) }])) },
      axes: [
        { stroke: text, grid, ticks: grid, font: FONT, size: 30, values: (/** @type {unknown} */ _, /** @type {number[]} */ splits) => scaleTexts(splits).map((number) => `${number} s`) },
        ...axes.map((axis, place) => this._axis(axis, place, narrow)),
      ],
      series: [{}, ...this.numbers.map(({ path, colour: number }) => ({
        label: path, scale: axes.find(({ traces }) => traces.some((trace) => trace.path === path))?.scale, stroke: colour(number),
        width: 1.25, points: { show: false }, dash: number >= COLOURS ? [6, 3] : undefined,
      }))],
      hooks: { draw: [() => this._over()], setSelect: [(/** @type {uPlot} */ plot) => this._selected(plot)] },
    }, [[], ...this.numbers.map(() => [])], this._element);
  }

  /** @param {import("./axes.js").Axis} axis @param {number} place @param {boolean} narrow */
  _axis(axis, place, narrow) {
    const stroke = axis.traces.length === 1 ? colour(axis.traces[0].colour) : css("--text-dim");
    const grid = { stroke: css("--grid"), width: 1 };
    const inLanes = axis.lanes > 1;
    const first = place === 0 || inLanes;
    return {
      scale: axis.scale, side: inLanes || place < (narrow ? 1 : 2) ? 3 : 1, stroke, gap: 3, font: FONT,
      ...(inLanes ? { size: axis.lane === axis.lanes - 1 ? LANE_AXIS_WIDTH : 0, splits: (/** @type {uPlot} */ plot) => laneSplits(this._own(plot, axis)) } : {
        size: growing(), label: axis.name, labelSize: 18, labelGap: 3, labelFont: "12px system-ui",
      }),
      grid: first ? grid : { show: false }, ticks: grid,
      values: (/** @type {unknown} */ _, /** @type {number[]} */ splits) => scaleTexts(splits),
    };
  }

  /** The range of a scale, from those of its values that are shown. @param {import("./axes.js").Axis} axis */
  _rangeOf(axis) {
    return (/** @type {unknown} */ _, /** @type {number | null} */ least, /** @type {number | null} */ most) => {
      const [low, high] = (this._how.declared && declaredRange(axis)) || rangeOf(least, most, uPlot.rangeNum);
      const range = low === null || high === null ? [null, null] : inLane([low, high], axis);
      return /** @type {[number, number]} */ (range);  // uPlot knows that there may be none, its types do not
    };
  }

  /** The part of a scale that is its lane. @param {uPlot} plot @param {import("./axes.js").Axis} axis @returns {[number, number]} */
  _own(plot, axis) {
    const { min = 0, max = 1 } = plot.scales[axis.scale];
    const height = ((max ?? 1) - (min ?? 0)) / axis.lanes;
    const bottom = (min ?? 0) + (axis.lanes - 1 - axis.lane) * height;
    return [bottom + 0.04 * height, bottom + 0.96 * height];
  }

  _resize() {
    const width = this._element.clientWidth;
    const height = this._element.clientHeight;
    if (width < 50 || height < 50) return;
    this._barsHeight = this.states.length * BAR_HEIGHT;
    this.plot.setSize({ width, height: Math.max(120, height - this._barsHeight) });
    const scale = window.devicePixelRatio;
    this._bars.width = width * scale;
    this._bars.height = this._barsHeight * scale;
    this._bars.style.height = `${this._barsHeight}px`;
    this.draw();
  }

  /** Pixels of the plot. */
  get width() { return Math.max(50, Math.round(this.plot.bbox.width / window.devicePixelRatio)); }

  /** Seconds of a pixel. */
  get pixel() { return (this.range[1] - this.range[0]) / this.width; }

  /** Draw the buffer between two times. */
  draw(range = this.range) {
    this.range = range;
    const { times, low, high } = this.buffer;
    const same = low === high;
    /** @type {any[]} */
    const data = [same ? times : doubled(times, new Float64Array(times))];
    for (const { index } of this.numbers) data.push(doubled(low[index], same ? low[index] : high[index]));
    this.plot.setData(/** @type {any} */ (data), true);
  }

  /** The time at a horizontal place in the plot (CSS pixels from its left edge). @param {number} x */
  timeAt(x) { return this.plot.posToVal(x, "x"); }

  /** @param {uPlot} plot */
  _selected(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const [from, to] = [this.timeAt(left), this.timeAt(left + width)];
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this._onZoom(from, to);
  }

  /** Cursors, the trigger and marks; then the states; in lanes the names of the traces. */
  _over() {
    const { ctx, bbox } = this.plot;
    const scale = window.devicePixelRatio;
    const [a, b] = this.cursors.times;
    /** @type {[number | null, string, string][]} */
    const lines = [[a, css("--cursor"), "A"], [b, css("--cursor"), "B"], [this.trigger, css("--bad"), "T"]];
    ctx.save();
    this._drawMarks(ctx);
    for (const [time, stroke, name] of lines) {
      if (time === null || time < this.range[0] || time > this.range[1]) continue;
      const x = this.plot.valToPos(time, "x", true);
      line(ctx, x, bbox.top, bbox.top + bbox.height, stroke);
      ctx.fillStyle = stroke;
      ctx.font = `${12 * scale}px system-ui`;
      ctx.fillText(name, x + 4, bbox.top + 12 * scale);
    }
    if (Object.keys(this.plot.scales).some((name) => name.startsWith("t:"))) this._nameLanes(ctx);
    ctx.restore();
    this._drawBars(lines);
  }

  /** A sign above the plot for whatever happened. @param {CanvasRenderingContext2D} ctx */
  _drawMarks(ctx) {
    const { bbox } = this.plot;
    const scale = window.devicePixelRatio;
    ctx.font = `700 ${11 * scale}px system-ui`;
    ctx.textAlign = "center";
    for (const { time, kind } of this.marks) {
      if (time < this.range[0] || time > this.range[1]) continue;
      const x = this.plot.valToPos(time, "x", true);
      ctx.globalAlpha = 0.3;
      line(ctx, x, bbox.top, bbox.top + bbox.height, css(MARKS[kind]));
      ctx.globalAlpha = 1;
      ctx.fillStyle = css(MARKS[kind]);
      ctx.fillText(SIGNS[kind], x, bbox.top - 3 * scale);
    }
    ctx.textAlign = "left";
  }

  /** @param {CanvasRenderingContext2D} ctx */
  _nameLanes(ctx) {
    const { bbox } = this.plot;
    const scale = window.devicePixelRatio;
    ctx.font = `${11 * scale}px system-ui`;
    axesOf(this.numbers, true).forEach((axis) => {
      const top = bbox.top + (axis.lane * bbox.height) / axis.lanes;
      if (axis.lane) line(ctx, top, bbox.left, bbox.left + bbox.width, css("--line"), true);
      ctx.fillStyle = colour(axis.traces[0].colour);
      ctx.fillText(axis.name, bbox.left + 6 * scale, top + 13 * scale);
    });
  }

  /** @param {[number | null, string, string][]} lines */
  _drawBars(lines) {
    const ctx = /** @type {CanvasRenderingContext2D} */ (this._bars.getContext("2d"));
    const { left, width } = this.plot.bbox;
    const height = BAR_HEIGHT * window.devicePixelRatio;
    const place = (/** @type {number} */ time) => left + ((time - this.range[0]) / (this.range[1] - this.range[0])) * width;
    ctx.clearRect(0, 0, this._bars.width, this._bars.height);
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, 0, width, this._bars.height);
    ctx.clip();
    this.states.forEach((trace, at) => this._drawStates(ctx, trace, at * height, height, place));
    for (const [time, stroke] of lines) if (time !== null) line(ctx, place(time), 0, this._bars.height, stroke);
    ctx.restore();
    ctx.fillStyle = css("--text");
    ctx.font = `${11 * window.devicePixelRatio}px system-ui`;
    this.states.forEach(({ path, entry }, at) => {
      ctx.fillText(`${path} (bar: ${entry.one})`, left + 4, (at + 0.68) * height, width);
    });
  }

  /**
   * A bar while the state is the electrical 1, a half-high one where it changed within a pixel.
   * @param {CanvasRenderingContext2D} ctx @param {Page.Trace} trace @param {number} top @param {number} height
   * @param {(time: number) => number} place
   */
  _drawStates(ctx, { index, colour: number }, top, height, place) {
    const { times, low, high } = this.buffer;
    ctx.fillStyle = css("--grid");
    ctx.fillRect(0, top + height - 1, this._bars.width, 1);
    ctx.fillStyle = colour(number);
    const end = Math.min(times.length, lowerBound(times, this.range[1]) + 1);
    for (let i = Math.max(0, lowerBound(times, this.range[0]) - 1); i < end;) {
      const [least, most] = [low[index][i], high[index][i]];
      let next = i + 1;
      while (next < end && low[index][next] === least && high[index][next] === most) next++;
      if (most > 0.5) {
        ctx.globalAlpha = least > 0.5 ? 0.55 : 0.3;
        const x = place(times[i]);
        ctx.fillRect(x, top + 3, Math.max(1, place(times[Math.min(next, times.length - 1)]) - x), height - 6);
      }
      i = next;
    }
    ctx.globalAlpha = 1;
  }

  /** The picture with a line of text above, as PNG. @param {string} title @returns {Promise<Blob | null>} */
  picture(title) {
    const { canvas } = this.plot.ctx;
    const scale = window.devicePixelRatio;
    const head = 26 * scale + 18 * scale * Math.ceil(this.traces.length / 4);
    const all = el("canvas", { width: canvas.width, height: head + canvas.height + this._bars.height });
    const ctx = /** @type {CanvasRenderingContext2D} */ (all.getContext("2d"));
    ctx.fillStyle = css("--panel");
    ctx.fillRect(0, 0, all.width, all.height);
    ctx.fillStyle = css("--text");
    ctx.font = `600 ${13 * scale}px system-ui`;
    ctx.fillText(title, 10 * scale, 18 * scale, all.width - 20 * scale);
    ctx.font = `${12 * scale}px system-ui`;
    this.traces.forEach(({ path, colour: number }, i) => {
      ctx.fillStyle = colour(number);
      ctx.fillText(`— ${path}`, (10 + (i % 4) * (all.width / scale - 20) / 4) * scale, (38 + 18 * Math.floor(i / 4)) * scale);
    });
    ctx.drawImage(canvas, 0, head);
    if (this._bars.height) ctx.drawImage(this._bars, 0, head + canvas.height);
    return new Promise((done) => { all.toBlob(done, "image/png"); });
  }

  destroy() {
    this._observer.disconnect();
    this.plot.destroy();
    this._bars.remove();
  }
}

/** An axis is as wide as its widest number so far: the plot does not jump to and fro. */
function growing() {
  let most = 0;
  return (/** @type {any} */ plot, /** @type {string[] | null} */ values, /** @type {number} */ number) => {
    const { font, ticks, gap } = plot.axes[number];
    plot.ctx.font = font[0];
    const widths = (values ?? []).map((text) => plot.ctx.measureText(text).width / window.devicePixelRatio);
    return (most = Math.max(most, Math.ceil(ticks.size + gap + Math.max(0, ...widths))));
  };
}

/** @param {CanvasRenderingContext2D} ctx @param {number} at @param {number} from @param {number} to @param {string} stroke */
function line(ctx, at, from, to, stroke, level = false) {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = window.devicePixelRatio;
  ctx.beginPath();
  if (level) {
    ctx.moveTo(from, at);
    ctx.lineTo(to, at);
  } else {
    ctx.moveTo(at, from);
    ctx.lineTo(at, to);
  }
  ctx.stroke();
}
