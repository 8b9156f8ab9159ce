/** The scope as a PNG: a title, the names of the traces, the chart, the states, the times of the wall clock, the kinds of the marks. */

import { colour, css, font, line, pixelRatio } from "./canvas.js";
import { el } from "./dom.js";
import { drawShape } from "./glyphs.js";
import { KINDS } from "./marks.js";
import { dayText, wallSplits, wallTexts } from "./time_axis.js";

const COLUMNS = 4;  // of names
const ROW = 18;  // CSS pixels of a line of names
const TITLE = 26;  // CSS pixels of the title
const CLOCK = 38;  // CSS pixels of the times of the wall clock

/**
 * @param {import("./chart.js").Chart} chart @param {string} title
 * @param {number | null} utc  s since 1970 at the station's time 0: local times are written below; null: they are not.
 * @returns {Promise<Blob | null>}
 */
export function picture(chart, title, utc) {
  const { canvas } = chart.plot.ctx;
  const bars = chart.bars.canvas;
  const scale = pixelRatio();
  const head = (TITLE + ROW * Math.ceil(chart.traces.length / COLUMNS)) * scale;
  const kinds = kindsOf(chart);
  const bottom = head + canvas.height + bars.height;
  const clock = utc === null ? 0 : CLOCK * scale;
  const all = el("canvas", { width: canvas.width, height: bottom + clock + (kinds.length ? ROW * scale : 0) });
  const ctx = /** @type {CanvasRenderingContext2D} */ (all.getContext("2d"));
  ctx.fillStyle = css("--panel");
  ctx.fillRect(0, 0, all.width, all.height);
  writeTitle(ctx, title, chart.traces);
  ctx.drawImage(canvas, 0, head);
  if (bars.height) ctx.drawImage(bars, 0, head + canvas.height);
  if (utc !== null) writeClock(ctx, chart, utc, bottom);
  writeKinds(ctx, kinds, bottom + clock);
  return new Promise((done) => { all.toBlob(done, "image/png"); });
}

/** The kinds of the marks that are in the picture. @param {import("./chart.js").Chart} chart */
function kindsOf({ clusters, range: [from, to] }) {
  const found = new Set(clusters.filter(({ time }) => time >= from && time <= to).map(({ kind }) => kind));
  return /** @type {Page.Mark["kind"][]} */ (Object.keys(KINDS)).filter((kind) => found.has(kind));
}

/** @param {CanvasRenderingContext2D} ctx @param {string} title @param {Page.Trace[]} traces */
function writeTitle(ctx, title, traces) {
  const scale = pixelRatio();
  const width = ctx.canvas.width - 20 * scale;
  ctx.fillStyle = css("--text");
  ctx.font = font(13, 600);
  ctx.fillText(title, 10 * scale, 18 * scale, width);
  ctx.font = font(12);
  traces.forEach(({ path, colour: number }, i) => {
    ctx.fillStyle = colour(number);
    ctx.fillText(`— ${path}`, 10 * scale + ((i % COLUMNS) * width) / COLUMNS, (TITLE + 12 + ROW * Math.floor(i / COLUMNS)) * scale, width / COLUMNS - 8 * scale);
  });
}

/** A second axis, in local time, with the day. @param {CanvasRenderingContext2D} ctx @param {import("./chart.js").Chart} chart @param {number} utc @param {number} top */
function writeClock(ctx, { plot: { bbox }, range, width }, utc, top) {
  const scale = pixelRatio();
  const [from, to] = range;
  const times = wallSplits(utc, range, width);
  const texts = wallTexts(utc, times);
  const dim = css("--text-dim");
  line(ctx, top + 4 * scale, bbox.left, bbox.left + bbox.width, dim, true);
  ctx.fillStyle = dim;
  ctx.font = font(11);
  ctx.fillText(`local time, ${dayText(utc, from)}`, bbox.left, top + 34 * scale, bbox.width);
  ctx.textAlign = "center";
  times.forEach((time, i) => {
    const x = bbox.left + ((time - from) / (to - from)) * bbox.width;
    line(ctx, x, top + 4 * scale, top + 8 * scale, dim);
    ctx.fillText(texts[i], x, top + 20 * scale);
  });
  ctx.textAlign = "left";
}

/** @param {CanvasRenderingContext2D} ctx @param {Page.Mark["kind"][]} kinds @param {number} top */
function writeKinds(ctx, kinds, top) {
  const scale = pixelRatio();
  ctx.font = font(11);
  let x = 16 * scale;
  for (const kind of kinds) {
    drawShape(ctx, kind, x, top + 8 * scale);
    ctx.fillStyle = css("--text");
    ctx.fillText(KINDS[kind], x + 9 * scale, top + 12 * scale);
    x += ctx.measureText(KINDS[kind]).width + 32 * scale;
  }
}
