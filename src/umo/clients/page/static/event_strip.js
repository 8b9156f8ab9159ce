/** The strip on the time axis in which the marks stand: the mouse, or a touch, on one tells what happened. */

import { pixelRatio } from "./canvas.js";
import { el, setText } from "./dom.js";
import { STRIP_HEIGHT } from "./glyphs.js";
import { clusterAt, linesOf } from "./marks.js";

const TIP_WIDTH = 360;  // CSS pixels, as style.css has it

export class EventStrip {
  /** @param {HTMLElement} plot  In which it stands. */
  constructor(plot) {
    /** @type {import("./chart.js").Chart | null} */
    this._chart = null;
    this._strip = el("div", { className: "event-strip", "aria-hidden": "true" });
    this._tip = el("div", { className: "tip", role: "tooltip", hidden: true });
    plot.append(this._strip, this._tip);
    const told = (/** @type {PointerEvent} */ event) => this._tell(event.clientX - this._strip.getBoundingClientRect().left);
    this._strip.addEventListener("pointermove", told);
    this._strip.addEventListener("pointerdown", told);
    this._strip.addEventListener("pointerleave", () => this.hide());
  }

  /** Stand below the curves of this chart. @param {import("./chart.js").Chart} chart */
  place(chart) {
    const { left, top, width, height } = chart.plot.bbox;
    const scale = pixelRatio();
    this._chart = chart;
    Object.assign(this._strip.style, { left: `${left / scale}px`, top: `${(top + height) / scale}px`, width: `${width / scale}px`, height: `${STRIP_HEIGHT}px` });
  }

  /** @param {number} x  CSS pixels from the left edge of the curves. */
  _tell(x) {
    const found = this._chart && clusterAt(this._chart.clusters, this._chart.timeAt(x), this._chart.pixel);
    this._tip.hidden = !found;
    if (!found) return;
    setText(this._tip, linesOf(found).join("\n"));
    const room = /** @type {HTMLElement} */ (this._strip.parentElement);
    const left = Math.min(Math.max(this._strip.offsetLeft + x - 20, 4), room.clientWidth - TIP_WIDTH - 4);
    Object.assign(this._tip.style, { left: `${Math.max(left, 4)}px`, bottom: `${room.clientHeight - this._strip.offsetTop + 4}px` });
  }

  hide() { this._tip.hidden = true; }
}
