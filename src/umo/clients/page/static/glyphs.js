/** The marks on the time axis: a shape and a colour for each kind. */

import { css, font, line, pixelRatio } from "./canvas.js";

/** CSS pixels of the strip between the curves and the times, in which the marks stand. */
export const STRIP_HEIGHT = 18;
const SIZE = 4.5;  // CSS pixels from the middle of a shape to its edge
const FAINT = 0.22;  // of a line through the curves

/** @typedef {Page.Mark["kind"]} Kind */
/** @type {Record<Kind, string>} */
const COLOURS = {
  fault: "--bad", alarm: "--warn", missed: "--bad", guard: "--warn", command: "--accent", mode: "--cursor", over: "--good", told: "--text-dim",
};

/** Points of the shapes; the unit is the distance from the middle to the edge. @type {Partial<Record<Kind, [number, number][][]>>} */
const OUTLINES = {
  fault: [[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]],
  alarm: [[[0, -1.1], [1.1, 0.9], [-1.1, 0.9]]],
  missed: [[[0, -1.1], [0, 0.25]], [[0, 0.8], [0, 1.1]]],
  guard: [[[-0.7, 0.7], [0.7, -0.7]]],
  command: [[[0, 1.1], [1.1, -0.9], [-1.1, -0.9]]],
  mode: [[[-0.85, -0.85], [0.85, -0.85], [0.85, 0.85], [-0.85, 0.85]]],
};
const FILLED = ["alarm", "command", "mode", "told"];
const RADII = { guard: 1, over: 0.85, told: 0.6 };

/**
 * A shape about a point of the canvas.
 * @param {CanvasRenderingContext2D} ctx @param {Kind} kind @param {number} x @param {number} y
 */
export function drawShape(ctx, kind, x, y) {
  const unit = SIZE * pixelRatio();
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = css(COLOURS[kind]);
  ctx.lineWidth = 1.8 * pixelRatio();
  ctx.beginPath();
  for (const points of OUTLINES[kind] ?? []) points.forEach(([dx, dy], i) => (i ? ctx.lineTo(x + dx * unit, y + dy * unit) : ctx.moveTo(x + dx * unit, y + dy * unit)));
  const radius = /** @type {Partial<Record<Kind, number>>} */ (RADII)[kind];
  if (radius) {
    ctx.moveTo(x + radius * unit, y);
    ctx.arc(x, y, radius * unit, 0, 2 * Math.PI);
  }
  if (FILLED.includes(kind)) ctx.fill();
  else ctx.stroke();
  ctx.restore();
}

/**
 * The marks between two times, below the curves, with a faint line through these; beside a shape how many it stands for.
 * @param {CanvasRenderingContext2D} ctx @param {Page.Cluster[]} clusters
 * @param {{left: number, top: number, width: number, height: number}} box  Of the curves. @param {[number, number]} range  s.
 */
export function drawMarks(ctx, clusters, { left, top, width, height }, [from, to]) {
  const bottom = top + height;
  const y = bottom + (STRIP_HEIGHT / 2) * pixelRatio();
  ctx.font = font(10, 700);
  for (const { time, kind, marks } of clusters) {
    if (time < from || time > to) continue;
    const x = left + ((time - from) / (to - from)) * width;
    ctx.globalAlpha = FAINT;
    line(ctx, x, top, bottom, css(COLOURS[kind]));
    ctx.globalAlpha = 1;
    drawShape(ctx, kind, x, y);
    if (marks.length === 1) continue;
    ctx.fillStyle = css("--text");
    ctx.fillText(String(marks.length), x + (SIZE + 3) * pixelRatio(), y + 3.5 * pixelRatio());
  }
}
