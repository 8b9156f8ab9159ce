/** The times below the chart: s on the station's clock, or the local time of the wall clock. */

import { scaleTexts, wallDay, wallTime } from "./presentation.js";

const STEPS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300];  // s
const ROUNDING = 1e-4;  // s: a Date cuts off what is less than a millisecond
const SPACE = 90;  // CSS pixels from one time to the next, at least

/**
 * Times of a stretch, at round times of the wall clock.
 * @param {number} utc  s since 1970 at the station's time 0. @param {[number, number]} range  s on the station's clock.
 * @param {number} width  CSS pixels. @returns {number[]}  s on the station's clock.
 */
export function wallSplits(utc, [from, to], width) {
  const least = ((to - from) * SPACE) / Math.max(width, SPACE);
  const step = STEPS.find((each) => each >= least) ?? 300;
  const first = Math.ceil((utc + from) / step - 1e-6);
  const count = Math.min(Math.floor((utc + to) / step + 1e-6) - first, Math.ceil((to - from) / step)) + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, i) => Number(((first + i) * step - utc).toFixed(6)));
}

/** The local times of these: `21:40:05`, with as many digits as they need. @param {number} utc @param {number[]} times @returns {string[]} */
export function wallTexts(utc, times) {
  const texts = times.map((time) => wallTime(utc, time + ROUNDING));
  const needed = Math.max(0, ...texts.map((text) => text.split(".")[1].replace(/0+$/, "").length));
  return texts.map((text) => text.slice(0, needed ? 9 + needed : 8));
}

/** The local day of a moment and its zone: `2026-11-22, UTC+01:00`. @param {number} utc @param {number} time */
export function dayText(utc, time) {
  const minutes = -new Date((utc + time) * 1e3).getTimezoneOffset();
  const [hours, rest] = [Math.trunc(Math.abs(minutes) / 60), Math.abs(minutes) % 60].map((part) => String(part).padStart(2, "0"));
  return `${wallDay(utc, time)}, UTC${minutes < 0 ? "-" : "+"}${hours}:${rest}`;
}

/** The times of the wall clock; the first one, and the first of a day, with the day below. @param {number} utc @param {number[]} times @returns {string[]} */
export function wallLabels(utc, times) {
  const days = times.map((time) => wallDay(utc, time + ROUNDING));
  return wallTexts(utc, times).map((text, i) => (days[i] === days[i - 1] ? text : `${text}\n${i ? days[i] : dayText(utc, times[i] + ROUNDING)}`));
}

/** `12.5 s`. @param {number[]} times @returns {string[]} */
export const machineLabels = (times) => scaleTexts(times).map((number) => `${number} s`);

/** Multiples of a step between two times. @param {number} from @param {number} to @param {number} step @returns {number[]} */
export function roundTimes(from, to, step) {
  const first = Math.ceil(from / step - 1e-9);
  const count = Math.min(Math.floor(to / step + 1e-9) - first + 1, 1000);
  return Array.from({ length: Math.max(count, 0) }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}
