/** What all drawings on a canvas share: colours of the theme, fonts, lines. */

const COLOURS = 8;
const NAME_GAP = 14;  // CSS pixels from one name of a lane to the next

/** Pixels of a canvas in a CSS pixel. */
export const pixelRatio = () => window.devicePixelRatio;
/** @param {number} size  CSS pixels. */
export const font = (size, weight = 400) => `${weight} ${size * pixelRatio()}px system-ui`;
/** A variable of the style sheet. @param {string} name */
export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
/** @param {number} number */
export const colour = (number) => css(`--trace-${number % COLOURS}`);
/** The dashes of a trace whose colour another one has too. @param {number} number */
export const dashes = (number) => (number >= COLOURS ? [6, 3] : undefined);

/** A vertical line; `level`: a horizontal one. @param {CanvasRenderingContext2D} ctx @param {number} at @param {number} from @param {number} to @param {string} stroke */
export function line(ctx, at, from, to, stroke, level = false) {
  ctx.strokeStyle = stroke;
  ctx.lineWidth = pixelRatio();
  ctx.beginPath();
  if (level) {
    ctx.moveTo(from, at);
    ctx.lineTo(to, at);
  } else {
    ctx.moveTo(at, from);
    ctx.lineTo(at, to);
  }
  ctx.stroke();
}

/**
 * Texts one after another, each in its colour, with an edge in the colour of the ground: they can be read on curves.
 * @param {CanvasRenderingContext2D} ctx @param {[string, string][]} texts  Each with its colour. @param {number} x @param {number} y
 * @param {number} end  Where the last one ends at the latest; the others are counted.
 */
export function names(ctx, texts, x, y, end) {
  const write = (/** @type {string} */ text, /** @type {string} */ fill) => {
    ctx.lineJoin = "round";
    ctx.lineWidth = 3 * pixelRatio();
    ctx.strokeStyle = css("--panel");
    ctx.strokeText(text, x, y);
    ctx.fillStyle = fill;
    ctx.fillText(text, x, y);
  };
  const gap = NAME_GAP * pixelRatio();
  for (const [place, [text, fill]] of texts.entries()) {
    const left = texts.length - place;
    const width = ctx.measureText(text).width;
    const room = left > 1 ? ctx.measureText(`and ${left - 1} more`).width + gap : 0;
    if (place && x + width + room > end) {
      write(`and ${left} more`, css("--text-dim"));
      return;
    }
    write(text, fill);
    x += width + gap;
  }
}
