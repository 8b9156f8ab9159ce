/** What happened: its kind, its words, and marks that stand together. node --test, without a browser. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { clusterAt, clustersOf, kindOf, KINDS, linesOf, listed, marksOf, sentence } from "../../../../src/umo/clients/page/static/marks.js";

const event = (more) => ({ time: 0, path: "", text: "", who: "", command: 0, state: "none", asked: "", ...more });
const mark = (time, kind = "command") => ({ time, kind, text: `at ${time}` });

test("what happened is marked by what it was, in the order of time", () => {
  const events = [
    event({ time: 2, asked: "mode manual", command: 3, who: "ann", state: "done" }),
    event({ time: 5, path: "z.jog", asked: "call z.jog", command: 4, who: "ann", state: "done" }),
    event({ time: 6, path: "z.motor", text: "inhibited: the door is open" }),
  ];
  const marks = marksOf(events, [[3, 2], [7, 1]]);
  assert.deepEqual(marks.map(({ time, kind }) => [time, kind]), [[2, "mode"], [3, "missed"], [5, "command"], [6, "guard"], [7, "missed"]]);
  assert.deepEqual([marks[1].text, marks[4].text], ["3.000 s 2 periods missed", "7.000 s 1 period missed"]);
  assert.equal(sentence(events[2]), "6.000 s z.motor: inhibited: the door is open");
});

test("alarms, faults, interlocks and ends have kinds of their own", () => {
  const alarm = (text, more = {}) => event({ path: "tank.high", asked: "alarm", text, ...more });
  const cases = [
    ["alarm", alarm("unacknowledged (high): too full")], ["alarm", alarm("bad unacknowledged (high): too full; cannot be evaluated: x")],
    ["over", alarm("returned (high): too full")], ["over", alarm("normal (high): too full")], ["over", alarm("latched unacknowledged (high): too full")],
    ["command", alarm("acknowledged (high): too full", { who: "ann" })], ["command", alarm("shelved (high): too full", { who: "ann" })],
    ["alarm", alarm("shelved active (high): too full")], ["over", alarm("shelved (high): too full")], ["command", alarm("shelved active (high): too full", { who: "ann" })],
    ["fault", event({ path: "z", text: "in fault: DriverError", asked: "fault" })], ["over", event({ path: "z", text: "fault cleared" })],
    ["fault", event({ path: "driver plc", text: "is away: no answer" })], ["over", event({ path: "driver plc", text: "is back after 2 s" })],
    ["guard", event({ path: "z.motor", text: "inhibited until acknowledged: the door is open" })], ["guard", event({ path: "z.motor", text: "command expired: not written for 1 s, default sent" })],
    ["guard", event({ text: "the door is open: 12 actuators inhibited" })], ["guard", event({ text: "12 commands expired: not written for 1 s, defaults sent" })],
    ["told", event({ path: "filler.unit", text: "state: execute" })], ["command", event({ who: "ann", asked: "stop", state: "done" })],
    ["fault", event({ asked: "end", state: "failed", text: "ValueError" })], ["mode", event({ asked: "end", state: "done", text: "done" })],
  ];
  for (const [kind, told] of cases) assert.equal(kindOf(told), kind, sentence(told));
  assert.ok(cases.every(([kind]) => kind in KINDS));
});

test("the list of events leaves out that a client takes or gives back its lease, but not a take-over or a refusal", () => {
  const command = (asked, state = "done") => event({ asked, state, command: 1, who: "ann" });
  const kept = [command("lease over=True"), command("lease", "refused"), command("mode manual"), command("write z 1"), event({ text: "lease" })];
  assert.deepEqual(listed([command("lease"), ...kept, command("give back")]), kept);
});

test("marks close to each other are one, of the gravest kind, and stay together while the picture moves on", () => {
  const marks = [mark(1), mark(1.01, "alarm"), mark(1.02, "told"), mark(3), mark(3.25), mark(3.27)];
  const clusters = clustersOf(marks, 0.01);  // within 0.26 s
  assert.deepEqual(clusters.map(({ marks: { length }, kind }) => [length, kind]), [[3, "alarm"], [2, "command"], [1, "command"]]);
  assert.equal(clusters[0].time, 1);
  assert.deepEqual(clustersOf([...marks, mark(9)], 0.01).slice(0, 3), clusters);
  assert.deepEqual(clustersOf([], 0.01), []);
});

test("the nearest mark is told, with a few of its events; far from all there is none", () => {
  const clusters = clustersOf([...Array.from({ length: 9 }, (_, i) => mark(1 + i / 1000)), mark(2)], 0.01);
  assert.deepEqual(linesOf(clusterAt(clusters, 1.92, 0.01)), ["at 2"]);
  const lines = linesOf(clusterAt(clusters, 1.1, 0.01));
  assert.deepEqual([lines.length, lines[0], lines.at(-1)], [7, "at 1", "and 3 more"]);
  assert.equal(clusterAt(clusters, 1.5, 0.01), null);
  assert.equal(clusterAt([], 1.5, 0.01), null);
});
