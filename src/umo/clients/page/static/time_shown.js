/** The time that the scope shows: the last seconds, those around a trigger, or a stretch that stands still. */

import { address } from "./dom.js";

const MIN_SPAN = 0.002;  // s
const LIVE_SPANS = [0.01, 300];  // s
const SETTLE_TIME = 120;  // ms without a change before the history, or another span, is asked for

/** @typedef {[from: number, to: number]} Stretch  s on the station's clock. */

export class TimeShown {
  /**
   * @param {import("./feed.js").Feed} feed
   * @param {{follow: () => void, draw: () => void, history: (stretch: Stretch) => void}} act  `follow`: what is subscribed to has
   *   changed; `draw`: what stands still has; `history`: its points are needed.
   */
  constructor(feed, act) {
    this._feed = feed;
    this._act = act;
    this.span = Number(address.get("span")) || 10;
    /** @type {Stretch | null} */
    this.still = null;
    /** @type {number | null} Where a triggered picture begins. */
    this.from = null;
  }

  /** What is to be drawn; null: nothing yet. @param {number | null} last  The time of the last point. @returns {Stretch | null} */
  between(last) {
    if (this.still) return this.still;
    if (this.from !== null) return [this.from, this.from + this.span];
    return last === null ? null : [last - this.span, last];
  }

  /** s. */
  get length() { return this.still ? Number((this.still[1] - this.still[0]).toPrecision(3)) : this.span; }

  live() {
    this.still = null;
    this.from = null;
    this._act.follow();
  }

  /** @param {Stretch} stretch */
  stand([from, to]) {
    const { start, stop } = this._feed.range();
    const span = Math.min(Math.max(to - from, MIN_SPAN), Math.max(stop - start, MIN_SPAN));
    const begin = Math.min(Math.max(from, start), Math.max(stop - span, start));
    const was = this.still;
    this.still = [begin, begin + span];
    if (!was) this._act.follow();
    this._act.draw();
    this.settle();
  }

  /** Ask for the history when what stands still has not changed for a while. */
  settle(wait = SETTLE_TIME) {
    this._later(() => {
      if (this.still) this._act.history(this.still);
    }, wait);
  }

  /** @param {number} factor @param {number} share  Of the plot's width. */
  zoom(factor, share) {
    if (!this.still) {
      const [least, most] = LIVE_SPANS;
      this.set(Math.min(Math.max(Number((this.span * factor).toPrecision(3)), least), most));
      return;
    }
    const [from, to] = this.still;
    const middle = from + (to - from) * share;
    this.stand([middle - (middle - from) * factor, middle + (to - middle) * factor]);
  }

  /** @param {number} share  Of the time shown. @param {Stretch} drawn */
  pan(share, drawn) {
    const [from, to] = this.still ?? drawn;
    this.stand([from + share * (to - from), to + share * (to - from)]);
  }

  /** Show so much, s. @param {number} span */
  set(span) {
    this.span = span;
    address.set({ span: String(span) });
    if (this.still) {
      const middle = (this.still[0] + this.still[1]) / 2;
      this.stand([middle - span / 2, middle + span / 2]);
      return;
    }
    this._act.draw();
    this._later(() => this._act.follow(), SETTLE_TIME);
  }

  /** @param {() => void} act @param {number} wait  ms. */
  _later(act, wait) {
    clearTimeout(this._waiting);
    this._waiting = setTimeout(act, wait);
  }

  close() { clearTimeout(this._waiting); }
}
