/** The lanes of the chart: one for each unit, its range, and the numbers beside it. */

import { isNumber, scaleTexts, statesOf, unitOf } from "./presentation.js";

const CONSTANT_SHARE = 1e-9;  // of the value: a smaller change is none
const LANE_GAP = 0.06;  // of a lane: free above and below its traces
const MAX_NAME_LENGTH = 28;  // characters of an axis' name
const MAX_STATE_LENGTH = 12;  // characters of a state beside its axis

/**
 * @typedef {{key: string, scale: string, unit: string, name: string, traces: Page.Trace[], lane: number, lanes: number}} Axis
 *   `key`: the unit, or the path of a named value; `lane` counts from the top.
 * @typedef {[least: number, most: number]} Range
 */

/** A lane for each unit and for each named value, in the order of the traces. @param {Page.Trace[]} traces @returns {Axis[]} */
export function axesOf(traces) {
  const keyOf = (/** @type {Page.Trace} */ { path, entry }) => (isNumber(entry) ? unitOf(entry) : `=${path}`);
  const keys = [...new Set(traces.map(keyOf))];
  return keys.map((key, lane) => {
    const those = traces.filter((trace) => keyOf(trace) === key);
    return { key, scale: `u:${key}`, unit: unitOf(those[0].entry), name: named(those), traces: those, lane, lanes: keys.length };
  });
}

/** `z.encoder, z.setpoint [um]`; as many names as there is room for. @param {Page.Trace[]} traces */
function named(traces) {
  const unit = unitOf(traces[0].entry);
  const names = traces.map(({ path }) => path);
  const all = names.join(", ");
  const text = all.length <= MAX_NAME_LENGTH ? all : names.length > 1 ? `${names.length} traces` : `…${all.slice(1 - MAX_NAME_LENGTH)}`;
  return unit ? `${text} [${unit}]` : text;
}

/**
 * The range of an axis: all values with some space; about a constant a band between round numbers.
 * @param {number | null} least @param {number | null} most
 * @param {(least: number, most: number, share: number, extra: boolean) => [number | null, number | null]} round  uPlot's.
 * @returns {Range | [null, null]}
 */
export function rangeOf(least, most, round) {
  if (least === null || most === null || !Number.isFinite(least) || !Number.isFinite(most)) return [null, null];
  const size = Math.max(Math.abs(least), Math.abs(most));
  if (most - least > size * CONSTANT_SHARE) return /** @type {Range} */ (round(least, most, 0.1, true));
  if (!size) return [-1, 1];
  const step = 10 ** Math.floor(Math.log10(size)) / 10;
  return [(Math.floor(least / step) - 2) * step, (Math.ceil(most / step) + 2) * step];
}

/** The declared range of all traces of an axis; null if one has none. @param {Axis} axis @returns {Range | null} */
export function declaredRange({ traces }) {
  const ends = traces.flatMap(({ entry }) => [entry.minimum, entry.maximum]);
  if (!ends.every((end) => end !== undefined && Number.isFinite(end))) return null;
  const numbers = /** @type {number[]} */ (ends);
  const [least, most] = [Math.min(...numbers), Math.max(...numbers)];
  return least < most ? [least, most] : null;
}

/**
 * The range of a scale over the whole height, in which `range` fills its lane.
 * @param {Range} range @param {{lane: number, lanes: number}} place @returns {Range}
 */
export function inLane([least, most], { lane, lanes }) {
  if (lanes === 1) return [least, most];
  const height = (most - least) / (1 - 2 * LANE_GAP);
  const bottom = least - LANE_GAP * height - (lanes - 1 - lane) * height;
  return [bottom, bottom + lanes * height];
}

/**
 * The part of a scale that is a lane, where numbers stand.
 * @param {Range} scale @param {{lane: number, lanes: number}} place @param {number} share  Of a lane: without numbers above and below. @returns {Range}
 */
export function numberedPart([least, most], { lane, lanes }, share) {
  const height = (most - least) / lanes;
  const bottom = least + (lanes - 1 - lane) * height;
  const edge = lanes === 1 ? 0 : share * height;
  return [bottom + edge, bottom + height - edge];
}

/** Round numbers in a lane. @param {Range} range @param {number} steps  From one to the next, at most; from 2. @returns {number[]} */
export function laneSplits([least, most], steps) {
  if (!(most > least)) return [];
  const step = 10 ** Math.floor(Math.log10((most - least) / steps));
  const wide = [1, 2, 5, 10].map((factor) => factor * step).find((each) => (most - least) / each <= steps) ?? 10 * step;
  const found = [];
  const first = Math.ceil(least / wide - 1e-9);
  for (let number = first; number * wide <= most + wide * 1e-9 && found.length <= steps + 1; number += 1) found.push(number * wide);
  return found;
}

/**
 * The numbers beside a lane: round ones, or those of the names of a value.
 * @param {Axis} axis @param {Range} range @param {number} steps  At most.
 */
export function splitsOf({ traces: [{ entry }] }, range, steps) {
  if (isNumber(entry)) return laneSplits(range, steps);
  const known = Object.keys(statesOf(entry)).map(Number).filter((number) => number >= range[0] && number <= range[1]).sort((a, b) => a - b);
  const every = Math.ceil(known.length / (steps + 1));
  return known.filter((_, place) => place % every === 0);
}

/** What stands beside a lane at these. @param {Axis} axis @param {number[]} splits @returns {string[]} */
export function splitTexts({ traces: [{ entry }] }, splits) {
  return isNumber(entry) ? scaleTexts(splits) : splits.map((number) => shortened(statesOf(entry)[String(number)] ?? ""));
}

/** @param {string} text */
const shortened = (text) => (text.length > MAX_STATE_LENGTH ? `${text.slice(0, MAX_STATE_LENGTH - 1)}…` : text);

/** Why this cannot be the range of an axis; "": it can. @param {number} least @param {number} most */
export function refusal(least, most) {
  if (!Number.isFinite(least) || !Number.isFinite(most)) return "give two numbers";
  if (!(least < most)) return "the least must be below the greatest";
  const size = Math.max(Math.abs(least), Math.abs(most));
  return most - least > size * CONSTANT_SHARE && Number.isFinite(most - least) ? "" : "the two limits are too close together, or too far apart";
}

/** Ranges that were typed, for the address: `-5:20:mm,0:24:V`; null: none. @param {Map<string, Range>} fixed  By key of the axis. */
export function rangesToAddress(fixed) {
  return [...fixed].map(([key, [least, most]]) => `${least}:${most}:${encodeURIComponent(key)}`).join(",") || null;
}

/** What is no range is left out. @param {string | null} text @returns {Map<string, Range>} */
export function rangesFromAddress(text) {
  /** @type {Map<string, Range>} */
  const found = new Map();
  for (const part of (text ?? "").split(",")) {
    const [, least, most, key] = /^([-+\d.e]+):([-+\d.e]+):(.*)$/.exec(part) ?? [];
    if (least === undefined || refusal(Number(least), Number(most))) continue;
    try { found.set(decodeURIComponent(key), [Number(least), Number(most)]); } catch { /* no key */ }
  }
  return found;
}

/** A range in words: `-5 to 20`. @param {Range} range */
export const rangeText = (range) => scaleTexts(range).join(" to ");
