/** The times below the chart. node --test, without a browser. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { dayText, machineLabels, wallLabels, wallSplits, wallTexts } from "../../../../src/umo/clients/page/static/time_axis.js";

const UTC = new Date(2026, 10, 22, 9, 5, 7, 250).getTime() / 1e3;

test("times of the wall clock stand at round ones, as many as there is room for", () => {
  const times = wallSplits(UTC, [0, 20], 900);
  assert.deepEqual(times, [0.75, 2.75, 4.75, 6.75, 8.75, 10.75, 12.75, 14.75, 16.75, 18.75]);
  assert.deepEqual(wallTexts(UTC, times).slice(0, 2), ["09:05:08", "09:05:10"]);
  assert.ok(wallSplits(UTC, [0, 300], 300).length <= 4);
});

test("a short stretch has times with as many digits as they need", () => {
  assert.deepEqual(wallTexts(UTC, wallSplits(UTC, [0, 0.4], 400)), ["09:05:07.3", "09:05:07.4", "09:05:07.5", "09:05:07.6"]);
  const shortest = wallSplits(UTC, [0, 0.002], 1000);
  assert.deepEqual(wallTexts(UTC, shortest), ["09:05:07.250", "09:05:07.251", "09:05:07.252"]);
});

test("a time that a float cannot have is still a round one", () => {
  for (const [utc, from] of [[1881184907.383, 327959.785], [1711523487.05, 862841.031], [1713000352.554, 224595.341], [1863115409.271, 709405.287]]) {
    const texts = wallTexts(utc, wallSplits(utc, [from, from + 0.5], 800));
    assert.ok(texts.length >= 4 && texts.every((text) => /^\d\d:\d\d:\d\d\.\d$/.test(text)), String(texts));
  }
});

test("an empty stretch, or one without a width, has few times and no endless list", () => {
  for (const [range, width] of [[[1, 1], 500], [[0, 300], 0], [[5, 4], 500]]) assert.ok(wallSplits(UTC, range, width).length <= 2);
});

test("the first time has the day and the zone below it, another one the day where it begins", () => {
  const midnight = new Date(2026, 10, 23).getTime() / 1e3;
  assert.match(dayText(midnight, 0), /^2026-11-23, UTC[+-]\d\d:\d\d$/);
  const labels = wallLabels(midnight, [-10, 0, 10]);
  assert.match(labels[0], /^23:59:50\n2026-11-22, UTC/);
  assert.deepEqual(labels.slice(1), ["00:00:00\n2026-11-23", "00:00:10"]);
});

test("times of the station are in s", () => {
  assert.deepEqual(machineLabels([0, 2.5, 5]), ["0 s", "2.5 s", "5 s"]);
});
