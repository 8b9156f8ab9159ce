/** The drawing of the scope: uPlot for numbers, in lanes; bars for states; cursors, the trigger and marks over both. */

import { axesOf, declaredRange, inLane, numberedPart, rangeOf, splitsOf, splitTexts } from "./axes.js";
import { Bars } from "./bars.js";
import { Buffer, doubled } from "./buffer.js";
import { colour, css, dashes, font, line, pixelRatio } from "./canvas.js";
import { Cursors } from "./cursors.js";
import { drawMarks, STRIP_HEIGHT } from "./glyphs.js";
import { colourOf, growing, laneClip, nameLane } from "./lanes.js";
import { clustersOf } from "./marks.js";
import { isBinary } from "./presentation.js";
import { machineLabels, roundTimes, wallLabels, wallSplits } from "./time_axis.js";

/** @typedef {import("./axes.js").Axis} Axis */
/** @typedef {import("./axes.js").Range} Range */
/**
 * `declared`: axes show the declared ranges; `fixed`: those that were typed, by key of the axis; `wall`: s since 1970 at the station's
 * time 0 for an axis with local times, null: it has the station's.
 * @typedef {{declared: boolean, fixed: Map<string, Range>, wall: () => number | null}} Look
 */

const { uPlot } = window;
const MIN_LANE_HEIGHT = 64;  // CSS pixels
const NUMBER_HEIGHT = 17;  // CSS pixels from one number beside a lane to the next
const HALF_NUMBER = 7;  // CSS pixels that numbers keep from the edges of their lane
const FIXED_WIDTH = 150;  // CSS pixels of what is said of a range that was typed
const EDGE = 6;  // CSS pixels that names keep from the right
const TIMES_HEIGHT = 20;  // CSS pixels of a line of times
const DAY_HEIGHT = 14;  // CSS pixels of the day below it
const SECOND_DASH = [5, 4];  // CSS pixels, of the traces of a recording that is laid over another one
const FONT = "11px system-ui";

export class Chart {
  /**
   * @param {HTMLElement} element @param {Page.Trace[]} traces @param {Look} look
   * @param {{zoom: (from: number, to: number) => void, placed: (chart: Chart) => void}} act  `placed`: the lanes have another place.
   */
  constructor(element, traces, look, act) {
    this.traces = traces;
    this.numbers = traces.filter(({ entry }) => !isBinary(entry));
    this.axes = axesOf(this.numbers);
    this.buffer = new Buffer(traces.length);
    this.bars = new Bars(traces.filter(({ entry }) => isBinary(entry)), this.buffer);
    /** @type {[number, number]} */
    this.range = [0, 1];
    this.cursors = new Cursors();
    /** @type {number | null} */
    this.trigger = null;
    /** @type {Page.Mark[]} */
    this.marks = [];
    /** @type {Page.Cluster[]} As they were drawn. */
    this.clusters = [];
    /** @type {Map<string, Range>} The range that a lane shows, by key of the axis. */
    this.shown = new Map();
    this._look = look;
    this._act = act;
    this._placed = "";
    this._element = element;
    this._observer = new ResizeObserver(() => this._resize());
    this.plot = this._make();
    this._element.append(this.bars.canvas);
    this._resize();
    this._observer.observe(element);
  }

  _make() {
    this._element.style.minHeight = `${Math.max(220, this.axes.length * MIN_LANE_HEIGHT + this.bars.height + 80)}px`;
    return new uPlot({
      width: 300, height: 200, legend: { show: false }, padding: [8, 24, 0, null], pxAlign: false,
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false },
      scales: { x: { time: false, range: () => this.range }, ...Object.fromEntries(this.axes.map((axis) => [axis.scale, { range: this._rangeOf(axis) }])) },
      axes: [this._times(), ...this._lanes()],
      series: [{}, ...this.axes.flatMap((axis) => axis.traces.map(({ path, entry, colour: number }) => ({
        label: path, scale: axis.scale, stroke: colour(number), width: 1.25, points: { show: false }, dash: entry.second ? SECOND_DASH : dashes(number), paths: this._paths(axis),
      })))],
      hooks: { draw: [() => this._over()], setSelect: [(/** @type {uPlot} */ plot) => this._selected(plot)] },
    }, [[], ...this.numbers.map(() => [])], this._element);
  }

  /** The axis of the times, below the strip of the marks. */
  _times() {
    const grid = { stroke: css("--grid"), width: 1 };
    return {
      stroke: css("--text-dim"), grid, ticks: { ...grid, size: 4 }, font: FONT, gap: STRIP_HEIGHT - 2, lineGap: 1.2,
      size: () => STRIP_HEIGHT + TIMES_HEIGHT + (this._look.wall() === null ? 0 : DAY_HEIGHT),
      splits: (/** @type {uPlot} */ plot, /** @type {number} */ _, /** @type {number} */ from, /** @type {number} */ to, /** @type {number} */ step) => {
        const utc = this._look.wall();
        return utc === null ? roundTimes(from, to, step) : wallSplits(utc, [from, to], plot.bbox.width / pixelRatio());
      },
      values: (/** @type {unknown} */ _, /** @type {number[]} */ splits) => {
        const utc = this._look.wall();
        return utc === null ? machineLabels(splits) : wallLabels(utc, splits);
      },
    };
  }

  /** An axis for each lane, in the colour of its trace if it has one only. They stand in one place, for which the last one makes room. */
  _lanes() {
    const width = growing();
    return this.axes.map((axis) => {
      const grid = { stroke: css("--grid"), width: 1 };
      const stroke = colourOf(axis);
      const last = axis.lane === axis.lanes - 1;
      return {
        scale: axis.scale, side: 3, stroke, gap: 3, font: FONT, grid, ticks: { stroke, width: 1, size: 5 },
        size: (/** @type {any} */ plot, /** @type {string[] | null} */ values, /** @type {number} */ number) => {
          const widest = width(plot, values, number);
          return last ? widest : 0;
        },
        splits: (/** @type {uPlot} */ plot) => this._splits(plot, axis),
        values: (/** @type {unknown} */ _, /** @type {number[]} */ splits) => splitTexts(axis, splits),
      };
    });
  }

  /** @param {uPlot} plot @param {Axis} axis */
  _splits(plot, axis) {
    const { min, max } = plot.scales[axis.scale];
    const height = plot.bbox.height / pixelRatio() / axis.lanes;
    return splitsOf(axis, numberedPart([min ?? 0, max ?? 1], axis, HALF_NUMBER / height), Math.max(2, Math.floor(height / NUMBER_HEIGHT)));
  }

  /** The range of a scale, from those of its values that are shown. @param {Axis} axis */
  _rangeOf(axis) {
    return (/** @type {unknown} */ _, /** @type {number | null} */ least, /** @type {number | null} */ most) => {
      const fixed = this._look.fixed.get(axis.key) ?? (this._look.declared ? declaredRange(axis) : null);
      const [low, high] = fixed ?? rangeOf(least, most, uPlot.rangeNum);
      if (low !== null && high !== null) this.shown.set(axis.key, [low, high]);
      const range = low === null || high === null ? [null, null] : inLane([low, high], axis);
      return /** @type {[number, number]} */ (range);  // uPlot knows that there may be none, its types do not
    };
  }

  /** Lines that end where their lane ends. @param {Axis} axis @returns {any} */
  _paths(axis) {
    const draw = /** @type {(plot: uPlot, series: number, from: number, to: number) => any} */ (uPlot.paths.linear?.());
    return (/** @type {uPlot} */ plot, /** @type {number} */ series, /** @type {number} */ from, /** @type {number} */ to) => {
      const made = draw(plot, series, from, to);
      if (made && axis.lanes > 1) made.clip = laneClip(this.laneBox(axis), made.gaps ?? []);
      return made;
    };
  }

  /** Where a lane is, in pixels of the canvas. @param {Axis} axis */
  laneBox({ lane, lanes }) {
    const { left, top, width, height } = this.plot.bbox;
    return { left, top: top + (lane * height) / lanes, width, height: height / lanes };
  }

  _resize() {
    const width = this._element.clientWidth;
    const height = this._element.clientHeight;
    if (width < 50 || height < 50) return;
    this.plot.setSize({ width, height: Math.max(120, height - this.bars.height) });
    this.bars.resize(width);
    this.draw();
  }

  /** Pixels of the plot. */
  get width() { return Math.max(50, Math.round(this.plot.bbox.width / pixelRatio())); }

  /** Seconds of a pixel. */
  get pixel() { return (this.range[1] - this.range[0]) / this.width; }

  /** Draw the buffer between two times. */
  draw(range = this.range) {
    this.range = range;
    const { times, low, high } = this.buffer;
    const same = low === high;
    /** @type {any[]} */
    const data = [same ? times : doubled(times, new Float64Array(times))];
    for (const { index } of this.axes.flatMap(({ traces }) => traces)) data.push(doubled(low[index], same ? low[index] : high[index]));
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
    this._act.zoom(from, to);
  }

  /** The names of the lanes, marks, cursors and the trigger; then the states. */
  _over() {
    const { ctx, bbox } = this.plot;
    const [from, to] = this.range;
    ctx.save();
    [ctx.textAlign, ctx.textBaseline] = ["left", "alphabetic"];
    ctx.setLineDash([]);
    this.clusters = clustersOf(this.marks, this.pixel);
    drawMarks(ctx, this.clusters, bbox, this.range);
    const lines = this._lines().filter(([time]) => time >= from && time <= to);
    for (const [time, stroke, name] of lines) {
      const x = this.plot.valToPos(time, "x", true);
      line(ctx, x, bbox.top, bbox.top + bbox.height, stroke);
      ctx.fillStyle = stroke;
      ctx.font = font(12);
      ctx.fillText(name, x + 4, bbox.top + bbox.height - 5 * pixelRatio());
    }
    for (const axis of this.axes) nameLane(ctx, axis, this.laneBox(axis), this._look.fixed.has(axis.key) ? FIXED_WIDTH : EDGE);
    ctx.restore();
    this.bars.draw(bbox, this.range, lines.map(([time, stroke]) => [time, stroke]));
    const place = JSON.stringify([bbox, this.shown.size]);
    if (place !== this._placed) this._act.placed(this);
    this._placed = place;
  }

  /** @returns {[number, string, string][]} */
  _lines() {
    const [a, b] = this.cursors.times;
    const all = /** @type {[number | null, string, string][]} */ ([[a, css("--cursor"), "A"], [b, css("--cursor"), "B"], [this.trigger, css("--bad"), "T"]]);
    return /** @type {[number, string, string][]} */ (all.filter(([time]) => time !== null));
  }

  destroy() {
    this._observer.disconnect();
    this.plot.destroy();
    this.bars.canvas.remove();
  }
}
