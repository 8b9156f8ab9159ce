/** Values of the past: a coarse window over all that the server keeps, a fine one about the time that is shown. */

import { isBinary } from "../presentation.js";

const MAX_NUMBERS = 1_500_000; // numbers in a window
const MAX_PATHS = 64; // paths that the server takes at once
const COARSE = 2000; // samples
const FINE = { before: 4, after: 8, rate: 100 }; // s, s, samples a second

/** @typedef {{start: number, stop: number, of: Map<string, {times: Float64Array, values: ArrayLike<number>}>}} Window */

export class History {
  /** @param {import("../feed.js").Feed} feed @param {Page.Entry[]} entries path and unit, or states, of each value */
  constructor(feed, entries) {
    this.feed = feed;
    this.entries = entries;
    this.binary = new Map(entries.map((entry) => [entry.path, isBinary(entry)]));
    /** @type {Window | null} */
    this.coarse = null;
    /** @type {Window | null} */
    this.fine = null;
    this.asking = false;
  }

  /** Ask for what is needed to show time `t`; resolves to true when something new has come. @param {number} t */
  async load(t) {
    if (this.asking || covers(this.fine, t)) return false;
    this.asking = true;
    try {
      const kept = this.feed.range();
      if (!covers(this.coarse, t)) this.coarse = await this.#window(kept.start, kept.stop, COARSE);
      const start = Math.max(kept.start, t - FINE.before);
      const stop = Math.min(kept.stop, t + FINE.after);
      this.fine = await this.#window(start, stop, Math.ceil((stop - start) * FINE.rate));
      return true;
    } finally {
      this.asking = false;
    }
  }

  /** The value at a time: between two samples on a straight line, a state as it was before. NaN: not loaded. @param {string} path @param {number} t */
  at(path, t) {
    const window = covers(this.fine, t) ? this.fine : this.coarse;
    const found = window?.of.get(path);
    const times = found?.times ?? new Float64Array(0);
    const values = found?.values ?? [];
    if (!times.length) return NaN;
    const i = Math.max(countUntil(times, t) - 1, 0);
    const steps = this.binary.get(path) || t < times[i] || !(times[i + 1] > times[i]) || !Number.isFinite(values[i + 1]);
    if (steps) return values[i];
    return values[i] + ((values[i + 1] - values[i]) * (t - times[i])) / (times[i + 1] - times[i]);
  }

  /** @param {number} start @param {number} stop @param {number} width @returns {Promise<Window>} */
  async #window(start, stop, width) {
    const most = Math.max(50, Math.floor(MAX_NUMBERS / this.entries.length));
    const asked = { start, stop, width: Math.min(Math.max(width, 1), most) };
    const parts = [];
    for (let i = 0; i < this.entries.length; i += MAX_PATHS) parts.push(this.entries.slice(i, i + MAX_PATHS));
    const got = await Promise.all(
      parts.map((part) => this.feed.window({ ...asked, paths: part.map((entry) => entry.path) })),
    );
    const of = new Map();
    parts.forEach((part, i) => {
      const values = middles(part, got[i]);
      part.forEach(({ path }, j) => of.set(path, { times: got[i].times, values: values[j] }));
    });
    return { start, stop, of };
  }
}

/** One number for each minimum and maximum: the mean, of a state the higher level. @param {Page.Entry[]} entries @param {{low: Float64Array[], high: Float64Array[]}} points */
export function middles(entries, { low, high }) {
  return entries.map((entry, i) => (isBinary(entry) ? high[i] : low[i].map((value, j) => (value + high[i][j]) / 2)));
}

/** @param {Window | null} window @param {number} t @returns {window is Window} */
function covers(window, t) {
  return window !== null && t >= window.start && t <= window.stop;
}

/** How many of the times are at most t. @param {Float64Array} times @param {number} t */
function countUntil(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
