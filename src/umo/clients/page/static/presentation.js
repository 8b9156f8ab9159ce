/** How values look, as umo/objects/presentation has it; the server gives each entry its digits and its unit as it is shown. A test compares the two. */

const NO_VALUE = "-";
const SIGNIFICANT_DIGITS = 6;
const MAX_FIXED = 1e21;  // size from which on no digits after the point are shown
const MAX_DIGITS = 99;  // after the point
const FEW_STEPS = 1e4;  // steps of a scale from 0 that six significant digits tell apart
const MAX_RUN = 1e10;  // s: 300 years

/** A number that ends in a half of its last digit, which is rounded to the even one, as Python does. @param {string} longer  With the digit that is too much, which is 5. @param {string} text  Rounded away from 0. */
function even(longer, text) {
  const shorter = longer.slice(0, -1).replace(/\.$/, "");
  return Number(shorter[shorter.length - 1]) % 2 ? text : shorter;
}

/** @param {number} value @param {number} digits  After the point. */
function fixed(value, digits) {
  const isHalf = Math.abs(value * 2 ** (digits + 1)) % 2 === 1;
  const text = isHalf ? even(value.toFixed(digits + 1), value.toFixed(digits)) : value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** Six significant digits and a power of ten. @param {number} value @returns {[string, number]} */
function scientific(value) {
  const unit = 10 ** (Math.floor(Math.log10(Math.abs(value))) - SIGNIFICANT_DIGITS + 1);
  const [mantissa, power] = value.toExponential(SIGNIFICANT_DIGITS - 1).split("e");
  const isHalf = unit > 1 && Math.abs(value) % unit === unit / 2;
  return [isHalf ? even(value.toExponential(SIGNIFICANT_DIGITS).split("e")[0], mantissa) : mantissa, Number(power)];
}

/** @param {string} text */
const withoutZeros = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);

/** A number with so many digits after the point; null: six significant digits. @param {number | null | undefined} value @param {number | null} [digits] */
export function numberText(value, digits = null) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NO_VALUE;
  if (digits !== null && Math.abs(value) < MAX_FIXED) return fixed(value, digits);
  const [mantissa, exponent] = scientific(value);
  if (exponent < -4 || exponent >= 9) return `${withoutZeros(mantissa)}e${exponent}`;
  return withoutZeros(fixed(value, Math.max(SIGNIFICANT_DIGITS - 1 - exponent, 0)));
}

const WITH_POINT = /(?<![\w.])-?(\d+\.\d+)(?:e[-+]?\d+)?(?![\w.])/g;
const SURE_DIGITS = 15;  // that every float has

/** A text whose numbers with more digits than a float surely has (0.30000000000000004) are shown as a number by itself is (0.3). @param {string} text */
export function withShortNumbers(text) {
  return text.replace(WITH_POINT, (found, digits) => (digits.replace(".", "").replace(/^0+/, "").length > SURE_DIGITS ? numberText(Number(found)) : found));
}

/** The numbers beside a scale, evenly spaced: six significant digits; where these do not do, as many as the step has. @param {number[]} levels @returns {string[]} */
export function scaleTexts(levels) {
  const step = levels.length > 1 ? Number(Math.abs(levels[1] - levels[0]).toPrecision(6)) : Infinity;
  if (levels.every((level) => Math.abs(level) < FEW_STEPS * step)) return levels.map((level) => numberText(level));
  let digits = 0;
  while (digits < MAX_DIGITS && Number(step.toFixed(digits)) !== step) digits += 1;
  return levels.map((level) => numberText(level, digits));
}

/** The unit as it is shown. @param {{look?: string} | null | undefined} about */
export const unitOf = (about) => about?.look ?? "";
/** Whether it is a level: 0 and 1 are its two states. @param {Page.Entry | null | undefined} entry */
export const isBinary = (entry) => Boolean(entry && "one" in entry);
/** Whether it has more states than two, or such of other numbers. @param {Page.Entry} entry */
export const isNamed = (entry) => Boolean(entry.states);
/** @param {Page.Entry | null | undefined} entry */
export const isNumber = (entry) => !isBinary(entry) && !entry?.states;
/** The names of its states by number; none: it is a number. @param {Page.Entry | null | undefined} entry @returns {Record<string, string>} */
export const statesOf = (entry) => (isBinary(entry) ? { 0: entry?.zero ?? NO_VALUE, 1: entry?.one ?? NO_VALUE } : entry?.states ?? {});
/** @param {Page.Entry} entry @param {number} value */
export const stateText = (entry, value) => statesOf(entry)[String(isBinary(entry) ? Number(value > 0.5) : value)] ?? numberText(value);

/** A value with its unit, or a state; of a family from the least to the greatest, how many are in each state, or the names. @param {Page.Entry} entry @param {(number | null | undefined)[]} values */
export function valueText(entry, ...values) {
  const known = /** @type {number[]} */ (values.filter((value) => Number.isFinite(value)));
  if (!known.length) return NO_VALUE;
  if (isBinary(entry)) {
    const ones = known.filter((value) => value > 0.5).length;
    const mixed = ones > 0 && ones < known.length;
    return mixed ? `${ones} ${stateText(entry, 1)}, ${known.length - ones} ${stateText(entry, 0)}` : stateText(entry, known[0]);
  }
  if (isNamed(entry)) return [...new Set(known.map((value) => stateText(entry, value)))].join(", ");
  const [least, most] = [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))].map((value) => numberText(value, entry.digits));
  return `${least === most ? least : `${least} to ${most}`} ${unitOf(entry)}`.trimEnd();
}

/** `250 µs`, `2.5 ms`, `90 s`. @param {number} seconds */
export function duration(seconds) {
  const size = Math.abs(seconds);
  if (size === 0 || size >= 1) return `${numberText(seconds)} s`;
  return size >= 1e-3 ? `${numberText(seconds * 1e3)} ms` : `${numberText(seconds * 1e6)} µs`;
}

/** `12 s`, `3 min`, `2 h 05 min`, `3 d 4 h`; `?` for what no run has lasted. @param {number} seconds */
export function lasting(seconds) {
  if (!(Math.abs(seconds) < MAX_RUN)) return "?";
  const [minutes, hours, days] = [seconds / 60, seconds / 3600, seconds / 86400];
  if (minutes < 2) return `${fixed(seconds, 0)} s`;
  if (hours < 1) return `${fixed(minutes, 0)} min`;
  if (days < 2) return `${Math.trunc(hours)} h ${String(Math.trunc(minutes) % 60).padStart(2, "0")} min`;
  return `${Math.trunc(days)} d ${Math.trunc(hours) % 24} h`;
}

/** A path as a heading: `sorter.light_barrier` is `Sorter light barrier`. @param {string} path */
export function readable(path) {
  const text = path.replace(/(?<!\.)\.(?!\.)|_|\[/g, " ").replaceAll("]", "");
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** A path within a sentence. @param {string} path */
export const inSentence = (path) => readable(path).replace(/^./, path.charAt(0));

/** A time on the cycle's clock. @param {number} seconds */
export const clockText = (seconds, digits = 3) => `${fixed(seconds, digits)} s`;

/** @param {number} number @param {number} digits */
const padded = (number, digits) => String(number).padStart(digits, "0");

/**
 * The local time of a moment, `21:40:05.123`; "" for a run that does not keep the pace of the wall clock.
 * @param {number | null | undefined} utc  s since 1970 at the station's time 0.
 * @param {number} time  s on the station's clock.
 */
export function wallTime(utc, time) {
  if (utc === null || utc === undefined || !Number.isFinite(time)) return "";
  const date = new Date((utc + time) * 1e3);
  const clock = [date.getHours(), date.getMinutes(), date.getSeconds()].map((part) => padded(part, 2)).join(":");
  return `${clock}.${padded(date.getMilliseconds(), 3)}`;
}

/** The local day of a moment, `2026-11-22`; "" as above. @param {number | null | undefined} utc @param {number} time */
export function wallDay(utc, time) {
  if (utc === null || utc === undefined || !Number.isFinite(time)) return "";
  const date = new Date((utc + time) * 1e3);
  return `${date.getFullYear()}-${padded(date.getMonth() + 1, 2)}-${padded(date.getDate(), 2)}`;
}

/** Qualities from which a value is not the present one (umo.Quality). */
export const STALE = 3;

/**
 * A sign, a word, which is empty for a good value, and the class that colours it. After the end of a run no value is good: it is the last one before.
 * @param {number} quality @param {[string, string][]} qualities  Sign and words of each. @param {boolean} ended
 */
export function shownQuality(quality, qualities, ended) {
  const [sign, words] = qualities[quality] ?? ["?", "unknown"];
  if (ended && quality === 0) return { sign: "◌", word: "", kind: "last" };
  return { sign, word: quality > 0 ? words : "", kind: words };
}
