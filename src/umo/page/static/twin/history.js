/** Values of the past: a coarse window over all that the server keeps, a fine one about the time that is shown. */

const MOST = 1_500_000; // numbers in a window
const FINE = { before: 4, after: 8, rate: 100 }; // s, s, samples a second

export class History {
  /** @param {object} feed of the page @param {object[]} entries path and unit, or states, of each value */
  constructor(feed, entries) {
    this.feed = feed;
    this.paths = entries.map((entry) => entry.path);
    this.column = new Map(this.paths.map((path, i) => [path, i]));
    this.binary = entries.map((entry) => "one" in entry);
    this.coarse = this.fine = null;
    this.asking = false;
  }

  /** Ask for what is needed to show time `t`; resolves to true when something new has come. */
  async load(t) {
    if (this.asking || covers(this.fine, t)) return false;
    this.asking = true;
    try {
      const kept = this.feed.range();
      if (!covers(this.coarse, t)) this.coarse = await this.#window(kept.start, kept.stop, 2000);
      const start = Math.max(kept.start, t - FINE.before);
      const stop = Math.min(kept.stop, t + FINE.after);
      this.fine = await this.#window(start, stop, Math.ceil((stop - start) * FINE.rate));
      return true;
    } finally {
      this.asking = false;
    }
  }

  /** The value at a time: between two samples on a straight line, a state as it was before. Null: not loaded. */
  at(path, t) {
    const window = covers(this.fine, t) ? this.fine : this.coarse;
    if (!window || !window.times.length) return null;
    const { times } = window;
    const column = window.columns[this.column.get(path)];
    const i = Math.max(after(times, t) - 1, 0);
    const value = column[i];
    const next = column[i + 1];
    if (this.binary[this.column.get(path)] || !(times[i + 1] > times[i]) || !Number.isFinite(next) || t < times[i])
      return value;
    return value + ((next - value) * (t - times[i])) / (times[i + 1] - times[i]);
  }

  async #window(start, stop, width) {
    const most = Math.max(50, Math.floor(MOST / this.paths.length));
    const got = await this.feed.window({ paths: this.paths, start, stop, width: Math.min(Math.max(width, 1), most) });
    return { start, stop, times: got.times, columns: middles(got, this.binary) };
  }
}

/** One number for each minimum and maximum: the mean, of a state the higher level. */
export function middles({ low, high }, binary) {
  return low.map((column, i) => (binary[i] ? high[i] : column.map((value, j) => (value + high[i][j]) / 2)));
}

function covers(window, t) {
  return Boolean(window) && t >= window.start && t <= window.stop;
}

/** The number of times that are at most t. */
function after(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
