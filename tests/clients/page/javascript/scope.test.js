/** The scope's numbers: buffer, lanes, colours, cursors. node --test, without a browser. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { axesOf, declaredRange, inLane, laneSplits, numberedPart, rangeOf, rangesFromAddress, rangesToAddress, rangeText, refusal, splitsOf, splitTexts } from "../../../../src/umo/clients/page/static/axes.js";
import { Buffer, doubled, lowerBound } from "../../../../src/umo/clients/page/static/buffer.js";
import { coloursOf, fromAddress, toAddress } from "../../../../src/umo/clients/page/static/colours.js";
import { Cursors } from "../../../../src/umo/clients/page/static/cursors.js";
import { laneClip } from "../../../../src/umo/clients/page/static/lanes.js";
import { duration, lasting, numberText, scaleTexts, valueText, wallDay, wallTime } from "../../../../src/umo/clients/page/static/presentation.js";

const f64 = (...numbers) => Float64Array.from(numbers);
const trace = (path, look, more = {}) => ({ path, index: 0, colour: 0, entry: { path, look, ...more } });
const rounded = (least, most, share) => [least - share * (most - least), most + share * (most - least)];

test("points of messages are joined: the last one is sent again, old ones are dropped", () => {
  const buffer = new Buffer(1);
  const first = f64(1, 2, 3);
  const one = [first];
  buffer.take({ from: -1, times: f64(0, 1, 2), low: one, high: one });
  const more = [f64(30, 4)];
  buffer.take({ from: 2, times: f64(2, 3), low: more, high: more }, 1);
  assert.deepEqual([...buffer.times], [0, 1, 2, 3]);  // one point before the oldest stays: the line begins at the edge
  assert.deepEqual([...buffer.low[0]], [1, 2, 30, 4]);
  assert.equal(buffer.low, buffer.high);
  buffer.take({ from: 4, times: f64(4), low: [f64(0)], high: [f64(8)] }, 3);
  assert.deepEqual([...buffer.times], [2, 3, 4]);
  assert.deepEqual([...buffer.high[0]], [30, 4, 8]);
  assert.equal(buffer.last, 4);
});

test("a value at a time is that of the nearest point; none is null", () => {
  const buffer = new Buffer(1);
  assert.equal(buffer.at(0, 1), null);
  buffer.take({ from: -1, times: f64(0, 1), low: [f64(0, NaN)], high: [f64(4, NaN)] });
  assert.equal(buffer.at(0, 0.4), 2);
  assert.equal(buffer.at(0, 0.6), null);
  assert.equal(buffer.at(0, -9), 2);
});

test("lowerBound is the first index that is not before", () => {
  const times = f64(0, 1, 1, 2);
  for (const [time, index] of [[-1, 0], [0, 0], [0.5, 1], [1, 1], [1.5, 3], [2, 3], [3, 4]]) assert.equal(lowerBound(times, time), index);
});

test("a line passes the least and the greatest value of each point, with gaps where there is none", () => {
  assert.deepEqual([...doubled(f64(1, 3), f64(2, 4))], [1, 2, 3, 4]);
  const same = f64(1, NaN, 2);
  assert.deepEqual(doubled(same, same), [1, null, 2]);
});

test("removing a trace does not recolour the others; a new one gets the lowest number that is free", () => {
  let colours = coloursOf(["a", "b", "c"]);
  assert.deepEqual([...colours.values()], [0, 1, 2]);
  colours = coloursOf(["b", "c"], colours);
  assert.deepEqual([colours.get("b"), colours.get("c")], [1, 2]);
  colours = coloursOf(["b", "c", "d"], colours);
  assert.equal(colours.get("d"), 0);
});

test("colours stand in the address when they are not in order", () => {
  assert.equal(toAddress(new Map([["a", 0], ["b", 1]])), null);
  assert.equal(toAddress(new Map([["b", 1], ["c", 2]])), "1.2");
  assert.deepEqual([...fromAddress(["b", "c"], "1.2")], [["b", 1], ["c", 2]]);
  for (const text of [null, "", "1", "1.1", "1.2.3", "x.y", "-1.2"]) assert.equal(fromAddress(["b", "c"], text).size, 0);
});

test("clicks set A, then B, then move the nearer one; a double click leaves both as they were", () => {
  const cursors = new Cursors();
  cursors.click(1);
  assert.deepEqual(cursors.times, [1, null]);
  assert.equal(cursors.between, null);
  cursors.click(5);
  cursors.click(4);
  assert.deepEqual(cursors.times, [1, 4]);
  cursors.click(2);
  assert.deepEqual(cursors.times, [2, 4]);
  cursors.undo();
  assert.deepEqual(cursors.times, [1, 4]);
  cursors.set(0, 9);
  cursors.move(-0.5);
  assert.deepEqual(cursors.times, [8.5, 4]);
  assert.deepEqual(cursors.between, [4, 8.5]);
  cursors.clear();
  cursors.move(1);
  assert.deepEqual(cursors.times, [null, null]);
});

test("traces of one unit share a lane with their names; units are in the order of their first traces", () => {
  const traces = [trace("z.position", "mm"), trace("motor", "V"), trace("z.setpoint", "mm"), trace("count", "")];
  const axes = axesOf(traces);
  assert.deepEqual(axes.map(({ name, lane, lanes }) => [name, lane, lanes]), [["z.position, z.setpoint [mm]", 0, 3], ["motor [V]", 1, 3], ["count", 2, 3]]);
  assert.equal(new Set(axes.map(({ scale }) => scale)).size, 3);
  const many = Array.from({ length: 9 }, (_, i) => trace(`zones.${i}.temperature`, "degC"));
  assert.deepEqual(axesOf(many).map(({ name, lanes }) => [name, lanes]), [["9 traces [degC]", 1]]);
  assert.deepEqual(axesOf([]), []);
});

test("an axis covers its values; about a constant it is a band between round numbers", () => {
  assert.deepEqual(rangeOf(null, null, rounded), [null, null]);
  assert.deepEqual(rangeOf(0, 10, rounded), [-1, 11]);
  assert.deepEqual(rangeOf(0, 0, rounded), [-1, 1]);
  const [least, most] = rangeOf(227, 227, rounded);
  assert.ok(least < 227 && most > 227 && most - least < 114);
  assert.deepEqual(rangeOf(1e-300, 1e-300, rounded).every(Number.isFinite), true);
});

test("the declared range is that of all traces of an axis, if each has one", () => {
  const [axis] = axesOf([trace("a", "V", { minimum: -10, maximum: 10 }), trace("b", "V", { minimum: 0, maximum: 24 })]);
  assert.deepEqual(declaredRange(axis), [-10, 24]);
  const [other] = axesOf([trace("a", "V", { minimum: -10, maximum: 10 }), trace("error", "V")]);
  assert.equal(declaredRange(other), null);
});

test("in a lane a trace fills its part of the height, and no other", () => {
  for (const lanes of [2, 3, 7]) {
    for (let lane = 0; lane < lanes; lane++) {
      const [bottom, top] = inLane([10, 30], { lane, lanes });
      const share = (value) => (value - bottom) / (top - bottom);  // from below
      assert.ok(share(10) > (lanes - 1 - lane) / lanes && share(30) < (lanes - lane) / lanes);
    }
  }
  assert.deepEqual(inLane([10, 30], { lane: 0, lanes: 1 }), [10, 30]);
});

test("a lane has round numbers within it, more of them where it is high", () => {
  for (const [least, most] of [[0, 1], [-3, 17], [740, 765], [1e-6, 3e-6], [-150000, 120000]]) {
    for (const steps of [2, 3, 10]) {
      const splits = laneSplits([least, most], steps);
      assert.ok(splits.length >= 1 && splits.length <= steps + 1, String(splits));
      assert.ok(splits.every((value) => value >= least - 1e-9 * (most - least) && value <= most + 1e-9 * (most - least)));
      assert.ok(scaleTexts(splits).every((text) => text.length < 8), String(scaleTexts(splits)));
    }
    assert.ok(laneSplits([least, most], 10).length > laneSplits([least, most], 2).length);
  }
  for (const none of [[1, 1], [2, 1], [NaN, 1]]) assert.deepEqual(laneSplits(none, 3), []);
});

test("a named value has a lane of its own with the names of its states, as many as there is room for", () => {
  const states = { 0: "idle", 1: "running", 4: "being aborted by hand" };
  const [numbers, one, other] = axesOf([trace("count", ""), trace("a.state", "", { states }), trace("b.state", "", { states })]);
  assert.deepEqual([numbers.key, one.key, other.key], ["", "=a.state", "=b.state"]);
  assert.deepEqual(splitsOf(one, [-0.5, 4.5], 3), [0, 1, 4]);
  assert.deepEqual(splitTexts(one, [0, 1, 4]), ["idle", "running", "being abort…"]);
  assert.deepEqual(splitsOf(one, [-0.5, 1.5], 3), [0, 1]);
  assert.equal(splitsOf(one, [-0.5, 4.5], 1).length, 2);
  assert.deepEqual(splitsOf(one, [0.1, 0.9], 3), []);
  assert.deepEqual(splitTexts(numbers, splitsOf(numbers, [0, 4], 2)), ["0", "2", "4"]);
});

test("the curves of a lane end at its edges and have the gaps of their values", () => {
  globalThis.Path2D = /** @type {any} */ (class {
    constructor() { this.rects = []; }
    rect(...rect) { this.rects.push(rect); }
  });
  const lane = { left: 10, top: 50, width: 100, height: 20 };
  const clip = (gaps) => /** @type {any} */ (laneClip(lane, gaps)).rects;
  assert.deepEqual(clip([]), [[10, 50, 100, 20]]);
  assert.deepEqual(clip([[20, 30], [60, 60.5]]), [[10, 50, 10, 20], [30, 50, 30, 20], [60.5, 50, 49.5, 20]]);
  assert.deepEqual(clip([[0, 30], [100, 200]]), [[30, 50, 70, 20]]);
  assert.deepEqual(clip([[10, 110]]), []);
});

test("the numbers of a lane are those of its own part of the scale", () => {
  const place = { lane: 1, lanes: 3 };
  const [least, most] = numberedPart(inLane([10, 30], place), place, 0.05);
  assert.ok(least <= 10 && most >= 30 && most - least < 24);
  assert.deepEqual(numberedPart([10, 30], { lane: 0, lanes: 1 }, 0.05), [10, 30]);
});

test("ranges that were typed stand in the address by unit; what is no range is left out", () => {
  const fixed = new Map([["mm", [-5, 20.5]], ["m/s²", [0, 1e-7]], ["", [0, 3]], ["%, of all", [0, 100]]]);
  assert.deepEqual([...rangesFromAddress(rangesToAddress(fixed))], [...fixed]);
  assert.equal(rangesToAddress(new Map()), null);
  for (const text of [null, "", "mm", "1:2", "2:1:mm", "1:1:mm", "x:2:mm", "1e400:2:mm", "1:2:%E0%A4%A", "-1e308:1e308:mm", ":::", "1:e:mm"]) assert.equal(rangesFromAddress(text).size, 0, String(text));
  assert.deepEqual([...rangesFromAddress("5:4:mm,0:24:V")], [["V", [0, 24]]]);
});

test("two numbers that are no range are refused with a reason", () => {
  assert.equal(refusal(-1, 1), "");
  assert.match(refusal(NaN, 1), /two numbers/);
  assert.match(refusal(1, 1), /below/);
  assert.match(refusal(1, 1 + 1e-12), /close/);
  assert.equal(rangeText([-5, 20]), "-5 to 20");
  assert.equal(rangeText([1000000.1, 1000000.2]), "1000000.1 to 1000000.2");
});

test("a time on the wall clock is local, to the millisecond; none in virtual time", () => {
  const date = new Date(2026, 10, 22, 9, 5, 7, 250);
  const utc = date.getTime() / 1e3 - 3.5;
  assert.equal(wallTime(utc, 3.5), "09:05:07.250");
  assert.equal(wallDay(utc, 3.5), "2026-11-22");
  assert.equal(wallTime(null, 3.5) + wallDay(undefined, 3.5) + wallTime(utc, NaN), "");
});

test("numbers, durations and states in words", () => {
  assert.deepEqual([1234.56, 0.00001234, 12.34567, null, NaN].map((value) => numberText(value)), ["1234.56", "1.234e-5", "12.3457", "-", "-"]);
  assert.deepEqual([9.983e-5, 1.2345, -0.0001].map((value) => numberText(value, 3)), ["0.000", "1.234", "0.000"]);
  assert.deepEqual([0.0005, 0.25, 2.34, 300].map(duration), ["500 µs", "250 ms", "2.34 s", "300 s"]);
  assert.deepEqual([5, 300, 7500].map(lasting), ["5 s", "5 min", "2 h 05 min"]);
  assert.equal(valueText({ path: "v", one: "ON", zero: "OFF" }, 1), "ON");
  assert.equal(valueText({ path: "v", one: "ON", zero: "OFF" }, null), "-");
  assert.equal(valueText({ path: "s", states: { 4: "idle", 6: "execute" } }, 6), "execute");
  assert.equal(valueText({ path: "s", states: { 4: "idle", 6: "execute" } }, 6, 4, 4, null, 7), "execute, idle, 7");
  assert.equal(valueText({ path: "m", unit: "mm/s**2", look: "mm/s²", digits: 2 }, 1.5), "1.50 mm/s²");
});
