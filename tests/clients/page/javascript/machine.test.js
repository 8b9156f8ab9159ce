/** Folding, parts, qualities, the status line, tabs, undo: what the page shows of a machine. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { folded, generalised, linesOf } from "../../../../src/umo/clients/page/static/folding.js";
import { filtered, groupsOf, partsOf } from "../../../../src/umo/clients/page/static/parts.js";
import { inSentence, readable, shownQuality, valueText } from "../../../../src/umo/clients/page/static/presentation.js";
import { nameOf, runAfter, troublesOf } from "../../../../src/umo/clients/page/static/stations.js";
import { faultsOf, forbidden, statusOf } from "../../../../src/umo/clients/page/static/status.js";
import { nextTab } from "../../../../src/umo/clients/page/static/tabs.js";
import { loadsAt } from "../../../../src/umo/clients/page/static/twin/loads.js";
import { statesOf } from "../../../../src/umo/clients/page/static/unit_command.js";
import { Undo } from "../../../../src/umo/clients/page/static/undo.js";

const QUALITIES = [["●", "good"], ["▲", "out of range"], ["◇", "unreferenced"], ["◔", "stale"], ["✕", "bad"]];
const zones = (count) => Array.from({ length: count }, (_, i) => [`zones.${i}.heater`, `zones.${i}.temperature`]).flat();

test("like objects of a list share a line, under the heading of their list", () => {
  assert.equal(generalised("zones.12.heater"), "zones.*.heater");
  assert.equal(folded([0, 7, 1, 2].map((i) => `zones.${i}.heater`)), "zones[0..2, 7].heater");
  const lines = linesOf(["fan", ...zones(1000), "z.encoder", "z.motor"]);
  assert.deepEqual(lines.map(({ name }) => name), ["fan", "zones[0..999].heater", "zones[0..999].temperature", "z.encoder", "z.motor"]);
  assert.deepEqual(lines.map(({ group }) => group), ["", "zones", "zones", "z", "z"]);
  assert.equal(lines[1].places.length, 1000);
});

test("two of a kind are not folded", () => {
  assert.deepEqual(linesOf(["axes.0.motor", "axes.1.motor"]).map(({ name, group }) => [name, group]), [["axes.0.motor", "axes"], ["axes.1.motor", "axes"]]);
});

const actuator = (path) => ({ path, actuator: true });
const description = {
  station: "furnace",
  objects: [actuator("conveyor.motor"), ...zones(1000).map((path) => (path.endsWith("heater") ? actuator(path) : { path, unit: "degC" }))],
  actions: [{ path: "soak", help: "", arguments: [], harmless: true, dead_man: false }],
  tunables: [{ path: "zones.3.controller.gain" }, { path: "limit" }],
  units: [],
  books: [],
};

test("a part is a compound with what can be done there; like parts of a list are one group", () => {
  const parts = partsOf(description);
  assert.equal(parts.length, 1002);
  assert.deepEqual(parts[0].tunables.map(({ name }) => name), ["limit"]);
  const third = parts.find(({ path }) => path === "zones.3");
  assert.deepEqual(third.tunables.map(({ name }) => name), ["controller.gain"]);  // a law's number stands with the part that has the law
  const groups = groupsOf(parts);
  assert.deepEqual(groups.map(({ title, family, parts: own }) => [title, family, own.length]), [["furnace", "", 1], ["conveyor", "", 1], ["zones[0..999]", "zones.*", 1000]]);
});

test("the commands of a state machine stand with its states, not in a part of their own", () => {
  const start = { path: "zones.3.unit.start", help: "", arguments: [], harmless: true, dead_man: false };
  const actions = [...description.actions, start];
  assert.ok(partsOf({ ...description, actions }).some(({ path }) => path === "zones.3.unit"));
  assert.ok(!partsOf({ ...description, actions, units: [{ path: "zones.3.unit" }] }).some(({ path }) => path === "zones.3.unit"));
});

test("a filter leaves the parts that it names", () => {
  const parts = partsOf(description);
  assert.deepEqual(filtered(parts, "zones.17.").map(({ path }) => path), ["zones.17"]);
  assert.deepEqual(filtered(parts, "soak").map(({ path }) => path), [""]);
  assert.equal(filtered(parts, "").length, 1002);
});

test("a quality that is not good has a sign and a word; after the end nothing is good", () => {
  assert.deepEqual(shownQuality(0, QUALITIES, false), { sign: "●", word: "", kind: "good" });
  assert.deepEqual(shownQuality(2, QUALITIES, false), { sign: "◇", word: "unreferenced", kind: "unreferenced" });
  assert.equal(shownQuality(0, QUALITIES, true).kind, "last");
  assert.notEqual(shownQuality(0, QUALITIES, true).sign, "●");
  assert.equal(shownQuality(4, QUALITIES, true).kind, "bad");
});

const KNOWN = { connected: true, refused: false, unheard: 0, station: "press", period: 0.01, state: { stage: "running", silent: 0, ending: null } };
const ended = (ending) => statusOf({ ...KNOWN, state: { stage: "ended", silent: 9, ending } });

test("each end says its cause, and a failure is one", () => {
  assert.deepEqual(statusOf(KNOWN), { kind: "", text: "", seconds: "" });
  assert.deepEqual([ended(null).kind, ended(null).text], ["ended", "press has ended."]);
  assert.deepEqual([ended({ failed: false, text: "stopped by Ann" }).kind, ended({ failed: false, text: "stopped by Ann" }).text], ["ended", "press has ended: stopped by Ann."]);
  const failed = ended({ failed: true, text: "GripError: no part." });
  assert.deepEqual([failed.kind, failed.text], ["failed", "press failed: GripError: no part."]);
});

test("a frame is missed after ten periods: a slow station is in order meanwhile", () => {
  const slow = (silent) => statusOf({ ...KNOWN, period: 6, state: { stage: "running", silent, ending: null } }).text;
  assert.deepEqual([slow(59), slow(61)], ["", "No new frame"]);
});

test("a family in words counts what is known", () => {
  const binary = { path: "lamp", one: "ON", zero: "OFF" };
  const said = [[1, null, 1], [null, 0, 0], [null, 1, 0], [null, null], [1]].map((values) => valueText(binary, ...values));
  assert.deepEqual(said, ["ON", "OFF", "1 ON, 1 OFF", "-", "ON"]);
  const number = { path: "level", look: "m" };
  assert.deepEqual([[null, 2, 3], [null, 2], [null, null], [null]].map((values) => valueText(number, ...values)), ["2 to 3 m", "2 m", "-", "-"]);
});

test("silence is said with its seconds, and told once without them", () => {
  const silent = statusOf({ ...KNOWN, state: { stage: "running", silent: 7.4, ending: null } });
  assert.deepEqual([silent.kind, silent.text, silent.seconds], ["warn", "No new frame", " for 7 s."]);
  assert.equal(statusOf({ ...KNOWN, unheard: 3 }).text, "Nothing heard from the server");
  assert.match(statusOf({ ...KNOWN, connected: false }).text, /connection to the server is lost/);
  assert.match(statusOf({ ...KNOWN, connected: false, refused: true }).text, /refuses this page/);
});

test("a path is read as a heading, and within a sentence", () => {
  assert.deepEqual(["sorter.light_barrier", "reactors.0", "zones[0..999]", "soak", ""].map(readable), ["Sorter light barrier", "Reactors 0", "Zones 0..999", "Soak", ""]);
  assert.deepEqual(["reactors.0", "X1.belt"].map(inSentence), ["reactors 0", "X1 belt"]);
});

test("a command names the states in which it is possible, or, of many, the one in which it is not", () => {
  const unit = { states: { 2: "stopped", 4: "idle", 17: "complete" }, commands: { start: { 4: 3 }, reset: { 2: 15, 17: 15 }, stop: { 3: 7, 4: 7, 6: 7 } } };
  assert.deepEqual([statesOf(unit, "start", "4"), statesOf(unit, "start", "2"), statesOf(unit, "reset", "4")], ["", "in Idle", "in Stopped, Complete"]);
  assert.deepEqual([statesOf(unit, "stop", "2"), statesOf(unit, "stop", "")], ["not in Stopped", "not in Unknown"]);
});

test("equipment in fault is told once, with its reason, and the first few of many", () => {
  assert.deepEqual(faultsOf(undefined), { shown: [], more: 0 });
  const faults = { a: "too hot", b: "no feed", c: "stuck", d: "stuck" };
  const { shown, more } = faultsOf(faults);
  assert.deepEqual([shown.length, more, shown[0]], [3, 1, { path: "a", text: "✖ A is in fault: too hot" }]);
  assert.deepEqual(forbidden({ "a.heater": "a is in fault", "b.valve": "door open" }, faults), ["door open (1 actuator)"]);
});

test("what forbids actuators is said once for each reason", () => {
  assert.deepEqual(forbidden(undefined), []);
  assert.deepEqual(forbidden({ a: "stop pressed", b: "stop pressed", c: "door open" }), ["stop pressed (2 actuators)", "door open (1 actuator)"]);
});

test("arrow keys lead around the tabs", () => {
  assert.deepEqual(["ArrowRight", "ArrowLeft", "Home", "End", "Enter"].map((key) => nextTab(key, 3, 4)), [0, 2, 0, 3, null]);
  assert.equal(nextTab("ArrowLeft", 0, 4), 3);
});

test("undo leads back change by change, for each number by itself", () => {
  const undo = new Undo();
  assert.equal(undo.last("gain"), null);
  undo.push("gain", 0.5);
  undo.push("gain", 0.7);
  undo.push("window", 25);
  assert.equal(undo.last("gain"), 0.7);
  undo.pop("gain");
  assert.equal(undo.last("gain"), 0.5);
  undo.pop("gain");
  undo.pop("gain");
  assert.deepEqual([undo.last("gain"), undo.last("window")], [null, 25]);
  for (let i = 0; i < 100; i++) undo.push("gain", i);
  assert.equal(undo.last("gain"), 99);
});

test("loads on a belt are as long as they passed the sensor, and travel with it", () => {
  const times = [0, 1, 2, 3, 4];
  const load = { level: 1, factor: 0.5, offset: 0, over: 10 };
  assert.deepEqual(loadsAt(load, times, [0, 1, 1, 0, 0], [1, 1, 1, 1, 1], 4), [[1.5, 0.5]]);
  assert.deepEqual(loadsAt(load, times, [1, 1, 0, 0, 0], [1, 1, 1, 1, 1], 4), []);  // it came at a time that is not known
  assert.deepEqual(loadsAt({ ...load, over: 1 }, times, [0, 1, 0, 0, 0], [1, 1, 1, 1, 1], 4), []);  // it has left the belt
});

test("of a station whose run has ended, another run that goes on is found", () => {
  const line = (name, station, stage, place = `/a/${station}`) => ({ name, station, stage, place, wiring: "" });
  const lines = [line("press", "press", "ended"), line("oven", "oven", "running"), line("press (pid 7)", "press", "running")];
  assert.equal(runAfter(lines, "press")?.name, "press (pid 7)");
  assert.equal(runAfter([...lines.slice(0, 2), line("press (pid 7)", "press", "ended")], "press"), null);
  assert.equal(runAfter(lines, "lathe"), null);
  const elsewhere = line("press (pid 8)", "press", "running", "/b/press");
  assert.equal(runAfter([lines[0], elsewhere], "press"), null);  // another machine
  assert.equal(nameOf(elsewhere, [lines[0], elsewhere]), "press (pid 8) in /b/press");
  assert.equal(nameOf(lines[1], [...lines, elsewhere]), "oven");
});

const LINE = { name: "press", station: "press", place: "", stage: "running", wiring: "rig" };

test("the list of stations tells what is wrong in each, the faults first", () => {
  assert.deepEqual(troublesOf({ ...LINE, faults: ["z: a fault"], alarms: ["tank.full: too full"] }), [["failed", "✕ z: a fault"], ["warn", "▲ tank.full: too full"]]);
  assert.deepEqual(troublesOf(LINE), []);
  assert.deepEqual(troublesOf({ ...LINE, changed: "it runs the former a.py" }), [["warn", "▲ it runs the former a.py"]]);
});
