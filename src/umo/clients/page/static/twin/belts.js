/** The past of belts, from which the loads on them are found: live, or before a time of the past. */

import { middles } from "./history.js";

const SPAN = 60; // s before the time that is shown
const AHEAD = 10; // s after it, and as much further back, so that not every time is asked for
const RATE = 50; // samples a second

/** @typedef {{times: Float64Array, low: Float64Array[], high: Float64Array[]}} Past */

export class Belts {
  /** @param {import("../feed.js").Feed} feed @param {import("./scene.js").TwinScene} scene @param {() => void} changed */
  constructor(feed, scene, changed) {
    this.feed = feed;
    this.changed = changed;
    const loads = scene.bodies.flatMap((body) => body.carried);
    this.paths = [...new Set(loads.flatMap((load) => [load.sensor, load.speed]))];
    this.speeds = [...new Set(loads.map((load) => this.paths.indexOf(load.speed)))];
    this.entries = this.paths.map((path) => /** @type {Page.Entry} */ (scene.entries.get(path)));
    /** @type {Past} */
    this.live = { times: new Float64Array(0), low: [], high: [] };
    /** @type {(Past & {stop: number, reach: number}) | null} */
    this.window = null;
    this.asking = false;
    if (!this.paths.length) return;
    const asked = { paths: this.paths, span: SPAN, width: SPAN * RATE };
    this.subscription = feed.subscribe(asked, (data) => {
      const first = !this.live.times.length;
      this.live = joined(this.live, data);
      if (first || this.speeds.some((i) => data.high[i].some((speed) => speed !== 0))) changed();
    });
  }

  /** Times and columns by path up to a time in s, null: now; null if they are not there (yet). @param {number | null} time */
  before(time) {
    if (!this.paths.length) return null;
    if (time === null) return this.#of(this.live, this.live.times.at(-1) ?? 0);
    if (!this.window || time < this.window.reach || time > this.window.stop) this.#load(time).catch(() => {}); // the page shows
    return this.window && time <= this.window.stop ? this.#of(this.window, time) : null; // that there is no connection
  }

  close() {
    this.subscription?.close();
  }

  /** @param {number} time */
  async #load(time) {
    if (this.asking) return;
    this.asking = true;
    try {
      const kept = this.feed.range();
      const start = Math.max(kept.start, time - SPAN - AHEAD);
      const stop = Math.min(kept.stop, time + AHEAD);
      const width = Math.max(1, Math.ceil((stop - start) * RATE));
      const got = await this.feed.window({ paths: this.paths, start, stop, width });
      this.window = { ...got, stop, reach: time - AHEAD };
      this.changed();
    } finally {
      this.asking = false;
    }
  }

  /** @param {Past} data @param {number} now */
  #of(data, now) {
    if (!data.times.length) return null;
    const columns = middles(this.entries, data);
    return { times: data.times, columns: new Map(this.paths.map((path, i) => [path, columns[i]])), now };
  }
}

/** What was there before `data.from`, then the data; not more than the span. @param {Past} old @param {Page.Points} data @returns {Past} */
function joined(old, data) {
  const oldest = (data.times.at(-1) ?? Infinity) - SPAN;
  const first = old.times.findIndex((t) => t >= oldest);
  const end = old.times.findIndex((t) => t >= data.from);
  const kept = (/** @type {Float64Array} */ column) => (first < 0 ? [] : column.subarray(first, end < 0 ? column.length : Math.max(end, first)));
  const join = (/** @type {Float64Array | undefined} */ column, /** @type {Float64Array} */ more) => Float64Array.of(...kept(column ?? new Float64Array(0)), ...more);
  return {
    times: join(old.times, data.times),
    low: data.low.map((more, i) => join(old.low[i], more)),
    high: data.high.map((more, i) => join(old.high[i], more)),
  };
}
