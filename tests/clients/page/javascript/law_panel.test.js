/** The tuning of a law: which laws there are, what a set changes, and what is drawn. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { changes, lawsOf, pointsOf } from "../../../../src/umo/clients/page/static/law_panel.js";

const tunable = (path, name = path) => ({ path, name });
const set = (settings) => ({ name: "balanced", rule: "", gain_margin: 2, phase_margin: 45, overshoot: 1, settling_time: 1, settings });

test("a law is what has a tunable gain, with its numbers", () => {
  const tunables = ["z.servo.gain", "z.servo.integral_time", "z.profile.velocity", "gain"].map((path) => tunable(path, path.slice(2)));
  assert.deepEqual(lawsOf(tunables).map(({ base, name, tunables: own }) => [base, name, own.length]), [["z.servo", "servo", 2]]);
});

test("a set changes the numbers that are tunable, and no others", () => {
  const tunables = [tunable("servo.gain"), tunable("servo.integral_time")];
  assert.deepEqual(changes(set({ gain: 2, integral_time: null, filter_time: 1 }), tunables, "servo"), [["servo.gain", 2]]);
});

test("lines share one scale, and what is not known is left out", () => {
  const [first, second] = pointsOf([{ times: [0, 1, 2], values: [0, null, 10] }, { times: [0, 2], values: [10, 0] }]);
  assert.equal(first, "0.0,106.0 320.0,4.0");
  assert.equal(second, "0.0,4.0 320.0,106.0");
  assert.deepEqual(pointsOf([{ times: [], values: [] }]), [""]);
});
