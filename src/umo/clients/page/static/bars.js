/** The states on the scope: a bar for each binary object, below the curves. */

import { lowerBound } from "./buffer.js";
import { colour, css, font, line, pixelRatio } from "./canvas.js";
import { el } from "./dom.js";
import { stateText } from "./presentation.js";

const HEIGHT = 22;  // CSS pixels of a state

/** @typedef {[time: number, stroke: string]} Line */

export class Bars {
  /** @param {Page.Trace[]} states @param {import("./buffer.js").Buffer} buffer */
  constructor(states, buffer) {
    this._states = states;
    this._buffer = buffer;
    this.canvas = el("canvas", { className: "bars", "aria-hidden": "true" });
    /** CSS pixels. */
    this.height = states.length * HEIGHT;
  }

  /** @param {number} width  CSS pixels. */
  resize(width) {
    this.canvas.width = width * pixelRatio();
    this.canvas.height = this.height * pixelRatio();
    this.canvas.style.height = `${this.height}px`;
  }

  /**
   * @param {{left: number, width: number}} place  Of the curves, pixels of the canvas. @param {[number, number]} range  s.
   * @param {Line[]} lines  Cursors and the trigger.
   */
  draw({ left, width }, range, lines) {
    const ctx = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    const height = HEIGHT * pixelRatio();
    const place = (/** @type {number} */ time) => left + ((time - range[0]) / (range[1] - range[0])) * width;
    ctx.clearRect(0, 0, this.canvas.width, this.canvas.height);
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, 0, width, this.canvas.height);
    ctx.clip();
    this._states.forEach((trace, at) => this._drawState(ctx, trace, at * height, height, place, range));
    for (const [time, stroke] of lines) line(ctx, place(time), 0, this.canvas.height, stroke);
    ctx.restore();
    ctx.fillStyle = css("--text");
    ctx.font = font(11);
    this._states.forEach(({ path, entry }, at) => {
      ctx.fillText(`${path} (bar: ${stateText(entry, 1)})`, left + 4, (at + 0.68) * height, width);
    });
  }

  /**
   * A bar while the state is the electrical 1, a half-high one where it changed within a pixel.
   * @param {CanvasRenderingContext2D} ctx @param {Page.Trace} trace @param {number} top @param {number} height
   * @param {(time: number) => number} place @param {[number, number]} range
   */
  _drawState(ctx, { index, colour: number }, top, height, place, range) {
    const { times, low, high } = this._buffer;
    ctx.fillStyle = css("--grid");
    ctx.fillRect(0, top + height - 1, this.canvas.width, 1);
    ctx.fillStyle = colour(number);
    const end = Math.min(times.length, lowerBound(times, range[1]) + 1);
    for (let i = Math.max(0, lowerBound(times, range[0]) - 1); i < end;) {
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
}
