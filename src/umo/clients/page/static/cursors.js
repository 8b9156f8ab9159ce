/** The two cursors of the scope: s on the station's clock, null where one is not set. */

/** @typedef {[number | null, number | null]} Pair */

export class Cursors {
  constructor() {
    /** @type {Pair} */
    this.times = [null, null];
    /** @type {Pair} */
    this._before = [null, null];
    /** Which one was set last. */
    this.last = 0;
  }

  /** Set A, then B; then the nearer one moves. @param {number} time */
  click(time) {
    const [a, b] = this.times;
    if (a === null) this.set(0, time);
    else if (b === null) this.set(1, time);
    else this.set(Math.abs(time - a) <= Math.abs(time - b) ? 0 : 1, time);
  }

  /** @param {number} which @param {number} time */
  set(which, time) {
    this._before = [...this.times];
    this.times[which] = time;
    this.last = which;
  }

  /** Move the one that was set last. @param {number} seconds */
  move(seconds) {
    const time = this.times[this.last];
    if (time !== null) this.set(this.last, time + seconds);
  }

  /** As before the last click, which was the first of a double click. */
  undo() { this.times = [...this._before]; }

  clear() {
    this._before = [...this.times];
    this.times = [null, null];
  }

  /** From the earlier to the later one; null unless both are set. @returns {[number, number] | null} */
  get between() {
    const [a, b] = this.times;
    return a === null || b === null ? null : a <= b ? [a, b] : [b, a];
  }
}
