/** The points of a scope: those of the server's messages put together. */

export class Buffer {
  /** @param {number} traces  How many. */
  constructor(traces) {
    this.times = new Float64Array(0);
    this.low = Array.from({ length: traces }, () => new Float64Array(0));
    this.high = this.low;
  }

  /** Replace what is at or after `from` by new points; drop what is before `oldest`. @param {Page.Points} points */
  take({ from, times, low, high }, oldest = -Infinity) {
    const keep = from < 0 ? 0 : lowerBound(this.times, from);
    const first = Math.min(Math.max(0, lowerBound(this.times, oldest) - 1), keep);
    const join = (/** @type {Float64Array} */ old, /** @type {Float64Array} */ added) => {
      const all = new Float64Array(keep - first + added.length);
      all.set(old.subarray(first, keep));
      all.set(added, keep - first);
      return all;
    };
    const joined = low.map((added, trace) => join(this.low[trace], added));
    this.high = high === low && this.high === this.low ? joined : high.map((added, trace) => join(this.high[trace], added));
    this.low = joined;
    this.times = join(this.times, times);
  }

  get last() { return this.times.length ? this.times[this.times.length - 1] : null; }

  /** The middle of the least and greatest value of a trace at a time; null: none. @param {number} trace @param {number} time */
  at(trace, time) {
    const index = Math.min(lowerBound(this.times, time), this.times.length - 1);
    if (index < 0) return null;
    const before = index > 0 && time - this.times[index - 1] < this.times[index] - time ? index - 1 : index;
    const value = (this.low[trace][before] + this.high[trace][before]) / 2;
    return Number.isFinite(value) ? value : null;
  }
}

/** The index of the first time that is not before `time`. @param {ArrayLike<number>} times @param {number} time */
export function lowerBound(times, time) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** For a line through the least and the greatest value of each point: every point twice. @param {Float64Array} low @param {Float64Array} high */
export function doubled(low, high) {
  if (low === high) return withGaps(low);
  const all = new Float64Array(2 * low.length);
  for (let i = 0; i < low.length; i++) {
    all[2 * i] = low[i];
    all[2 * i + 1] = high[i];
  }
  return withGaps(all);
}

/** uPlot draws a gap where there is null. @param {Float64Array} numbers */
function withGaps(numbers) {
  for (let i = 0; i < numbers.length; i++) {
    if (Number.isNaN(numbers[i])) return Array.from(numbers, (value) => (Number.isNaN(value) ? null : value));
  }
  return numbers;
}
