/** The numbers of the chart: which traces share an axis, over which range, and the numbers beside it. */

import { unitOf } from "./presentation.js";

const CONSTANT_SHARE = 1e-9;  // of the value: a smaller change is none
const LANE_GAP = 0.06;  // of a lane: free above and below its trace
const MAX_NAME_LENGTH = 28;  // characters of an axis' name
/** Units that have an axis of their own on a narrow screen; with more, each trace gets a lane. */
export const NARROW_UNITS = 2;

/**
 * @typedef {{scale: string, unit: string, name: string, traces: Page.Trace[], lane: number, lanes: number}} Axis
 *   `lane` counts from the top; without lanes it is 0 of 1.
 */

/**
 * The axes of some traces: one for each unit, or a lane for each trace.
 * @param {Page.Trace[]} traces @param {boolean} inLanes @returns {Axis[]}
 */
export function axesOf(traces, inLanes) {
  if (inLanes) {
    return traces.map((trace, lane) => (
      { scale: `t:${trace.path}`, unit: unitOf(trace.entry), name: named([trace]), traces: [trace], lane, lanes: traces.length }
    ));
  }
  const units = [...new Set(traces.map(({ entry }) => unitOf(entry)))];
  return units.map((unit) => {
    const those = traces.filter(({ entry }) => unitOf(entry) === unit);
    return { scale: `u:${unit}`, unit, name: named(those), traces: those, lane: 0, lanes: 1 };
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
 * @returns {[number, number] | [null, null]}
 */
export function rangeOf(least, most, round) {
  if (least === null || most === null || !Number.isFinite(least) || !Number.isFinite(most)) return [null, null];
  const size = Math.max(Math.abs(least), Math.abs(most));
  if (most - least > size * CONSTANT_SHARE) return /** @type {[number, number]} */ (round(least, most, 0.1, true));
  if (!size) return [-1, 1];
  const step = 10 ** Math.floor(Math.log10(size)) / 10;
  return [(Math.floor(least / step) - 2) * step, (Math.ceil(most / step) + 2) * step];
}

/** The declared range of all traces of an axis; null if one has none. @param {Axis} axis @returns {[number, number] | null} */
export function declaredRange({ traces }) {
  const ends = traces.flatMap(({ entry }) => [entry.minimum, entry.maximum]);
  if (!ends.every((end) => end !== undefined && Number.isFinite(end))) return null;
  const numbers = /** @type {number[]} */ (ends);
  const [least, most] = [Math.min(...numbers), Math.max(...numbers)];
  return least < most ? [least, most] : null;
}

/**
 * The range of a scale over the whole height, in which `range` fills its lane.
 * @param {[number, number]} range @param {{lane: number, lanes: number}} place @returns {[number, number]}
 */
export function inLane([least, most], { lane, lanes }) {
  if (lanes === 1) return [least, most];
  const height = (most - least) / (1 - 2 * LANE_GAP);
  const bottom = least - LANE_GAP * height - (lanes - 1 - lane) * height;
  return [bottom, bottom + lanes * height];
}

/** Round numbers in a lane, about three. @param {[number, number]} range @returns {number[]} */
export function laneSplits([least, most]) {
  const step = 10 ** Math.floor(Math.log10((most - least) / 2));
  const wide = [1, 2, 5, 10].map((factor) => factor * step).find((each) => (most - least) / each <= 3.5) ?? 10 * step;
  const found = [];
  const first = Math.ceil(least / wide - 1e-9);
  for (let number = first; number * wide <= most + wide * 1e-9; number += 1) found.push(number * wide);
  return found;
}
