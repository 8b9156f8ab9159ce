/** How lanes are drawn: their names, the width of their axes, and where their curves end. */

import { colour, css, font, line, names, pixelRatio } from "./canvas.js";

const MIN_AXIS_WIDTH = 50;  // CSS pixels

/** @typedef {{left: number, top: number, width: number, height: number}} Box  Pixels of the canvas. */
/** @typedef {import("./axes.js").Axis} Axis */

/** The colour of its trace; that of several traces is neutral. @param {Axis} axis */
export const colourOf = ({ traces }) => (traces.length === 1 ? colour(traces[0].colour) : css("--text-dim"));

/**
 * The unit of a lane and its traces, each in its colour.
 * @param {CanvasRenderingContext2D} ctx @param {Axis} axis @param {Box} box @param {number} free  CSS pixels on the right that stay free.
 */
export function nameLane(ctx, axis, { left, top, width }, free) {
  if (axis.lane) line(ctx, top, left, left + width, css("--line"), true);
  ctx.font = font(11);
  /** @type {[string, string][]} */
  const texts = axis.traces.map(({ path, colour: number }) => [path, colour(number)]);
  if (axis.unit) texts.unshift([`[${axis.unit}]`, colourOf(axis)]);
  names(ctx, texts, left + 6 * pixelRatio(), top + 13 * pixelRatio(), left + width - free * pixelRatio());
}

/** The axes are as wide as their widest number so far: the plot does not jump to and fro. */
export function growing() {
  let most = MIN_AXIS_WIDTH;
  return (/** @type {any} */ plot, /** @type {string[] | null} */ values, /** @type {number} */ number) => {
    const { font: [set], ticks, gap } = plot.axes[number];
    plot.ctx.font = set;
    const widths = (values ?? []).map((text) => plot.ctx.measureText(text).width / pixelRatio());
    return (most = Math.max(most, Math.ceil(ticks.size + gap + 4 + Math.max(0, ...widths))));
  };
}

/** The lane without its gaps. @param {Box} lane @param {[number, number][]} gaps  Pixels. */
export function laneClip({ left, top, width, height }, gaps) {
  const path = new Path2D();
  let from = left;
  for (const [begin, end] of [...gaps, /** @type {[number, number]} */ ([left + width, left + width])]) {
    if (begin > from) path.rect(from, top, begin - from, height);
    from = Math.max(from, end);
  }
  return path;
}
