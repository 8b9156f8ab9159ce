/** What a page holds, and what it says of its commands and after the end: controls, over a machine that is told by messages. */

import assert from "node:assert/strict";
import { test } from "node:test";

const VERBS = [{ name: "write", holds: true }, { name: "call", holds: true }, { name: "tune", holds: false }];

const listeners = new Map();
globalThis.window = { addEventListener: (kind, act) => listeners.set(kind, act), removeEventListener: (kind) => listeners.delete(kind) };
globalThis.WebSocket ??= /** @type {any} */ ({ OPEN: 1 });
globalThis.Text = class {};
globalThis.document = {
  addEventListener() {},
  createElement: () => ({ textContent: "", classList: { toggle() {} }, dataset: {}, addEventListener() {}, append() {}, setAttribute() {}, setPointerCapture() {} }),
};
const { ActuatorControl, JogControl, TunableControl } = await import("../../../../src/umo/clients/page/static/controls.js");
const { Feed } = await import("../../../../src/umo/clients/page/static/feed.js");
const { Client, shownState, words: inWords } = await import("../../../../src/umo/clients/page/static/client.js");
const { Trigger } = await import("../../../../src/umo/clients/page/static/trigger.js");

/** A page of a station whose action is held; `answer` is one of the machine's, `cancelled` the event of a command. */
function page() {
  const feed = new Feed();
  const sent = [];
  feed.connected = true;
  feed.start = () => {};
  feed._send = (message) => sent.push(message);
  feed._text({ type: "description", name: "belt", run: "r1", objects: [], signals: [], verbs: VERBS });
  const client = new Client(feed);
  const control = new JogControl(client, { path: "run", help: "", arguments: [], harmless: true, dead_man: true });
  const told = async (message) => {
    feed._text({ run: "r1", stage: "running", values: {}, ...message });
    await new Promise(setImmediate);
  };
  return {
    feed, client, sent, told,
    press: () => control._buttons[0].onpointerdown({ button: 0, pointerId: 1 }),
    release: () => listeners.get("pointerup")?.(),
    answer: (id, state, command) => told({ type: "answer", id, state, text: "", command }),
    cancelled: (command) => told({ type: "state", time: 2, events: [{ time: 2, path: "run", state: "cancelled", command }] }),
  };
}

test("a press is held though the one before ends late, and is let go of when the button is", async () => {
  const { client, sent, press, release, answer, cancelled } = page();
  press();
  await answer(1, "begun", 5);
  release();
  press();
  await answer(1, "cancelled", 5);
  await answer(3, "begun", 6);
  await cancelled(5);
  assert.equal(client.holds("run"), true);
  release();
  assert.deepEqual(sent.map((each) => each.do), ["call", "let go", "call", "let go"]);
  assert.equal(client.holds("run"), false);
});

test("what the machine has let go of by itself is held no longer", async () => {
  const { client, press, answer, cancelled } = page();
  press();
  await cancelled(4);
  await answer(1, "begun", 5);
  assert.equal(client.holds("run"), true);
  await cancelled(5);
  assert.equal(client.holds("run"), false);
});

test("which actuators are held the values say, whatever events tell of their end", async () => {
  const { feed, client, told, answer } = page();
  feed._text({ type: "description", name: "belt", run: "r1", objects: ["a", "b"].map((path) => ({ path, actuator: true })), signals: [], verbs: VERBS });
  const state = (taken, ...byClient) => told({ type: "state", time: 2, taken, by_client: byClient, events: [] });
  const held = () => ["a", "b"].filter((path) => client.holds(path)).join("");
  for (const path of ["a", "b"]) {
    client.hold(path);
    client.ask({ do: "write", path, value: 1 });
  }
  await state(3);
  assert.equal(held(), "ab");  // neither has come to the machine
  await answer(1, "done", 4);
  await answer(2, "done", 5);
  await state(3);
  assert.equal(held(), "ab");  // of a period before
  await state(5, "a", "b");
  assert.equal(held(), "ab");
  await told({ type: "state", time: 3, taken: 5, by_client: ["b"], events: [{ time: 3, path: "", state: "cancelled", command: 0, text: "emergency stop: 2 released: a and c" }] });
  assert.equal(held(), "b");
  await state(5);
  assert.equal(held(), "");
});

test("of a command without an answer nobody knows whether it was carried out; one that was not sent is refused", async () => {
  const { feed, client } = page();
  const asked = client.ask({ do: "call", path: "home" });
  feed._text({ type: "answer", id: 1, state: "begun", text: "" });
  feed._closed(1006);
  const { state, text } = await asked;
  assert.deepEqual([state, text], ["failed", "no answer, because the connection was lost; it is unknown whether the command was carried out"]);
  assert.equal((await client.ask({ do: "call", path: "home" })).state, "refused");
});

test("an action that lasts until it is let go of has begun when its command is done; one that is done at once is done", async () => {
  const { feed, client, answer } = page();
  feed.description.actions = [{ path: "run", dead_man: true }, { path: "home", dead_man: false }];
  for (const [i, path] of ["run", "home"].entries()) {
    client.ask({ do: "call", path });
    await answer(i + 1, "done", i + 1);
  }
  client.ask({ do: "let go", path: "run" }, "release run");
  await answer(3, "done", 3);
  assert.deepEqual(client.asked.map(inWords), ["release run: done", "call home: done", "call run: has begun"]);
  assert.deepEqual(client.asked.map(shownState), ["done", "done", "begun"]);
});

test("after the end of the run its values are marked as the last ones, and no trigger is waited for", async () => {
  const { feed, client, told } = page();
  const controls = [new ActuatorControl(client, { path: "lamp", one: "ON", zero: "OFF" }), new ActuatorControl(client, { path: "motor" }), new TunableControl(client, { path: "gain", name: "gain" })];
  const trigger = new Trigger(feed, () => {});
  trigger._path.value = "motor";
  const words = () => {
    for (const control of controls) control.refresh(feed);
    return [trigger.hint, ...controls.map(({ _word }) => _word.textContent ?? "")];
  };
  await told({ type: "state" });
  assert.deepEqual(words(), ["", "", "", ""]);
  trigger._kind.value = "rising";
  assert.equal(trigger.hint, "waiting for the trigger");
  await told({ type: "state", stage: "ended" });
  assert.deepEqual(words(), ["the run has ended: no trigger comes", "last value", "last value", "last value"]);
});

test("a jog has a button for each direction of its range, which may be without limits", () => {
  const { client } = page();
  const directions = (range) => new JogControl(client, { path: "run", help: "", arguments: range, harmless: true, dead_man: true })._buttons.length;
  const about = { name: "speed", kind: "number" };
  const ranges = [[], [{ ...about, minimum: 0, maximum: 5 }], [{ ...about, minimum: -5, maximum: 5 }], [{ ...about, minimum: null, maximum: null }]];
  assert.deepEqual(ranges.map(directions), [1, 1, 2, 2]);
});

test("the button of a jog in one direction does not have the name of the state command Hold", () => {
  const control = new JogControl(page().client, { path: "run", help: "", arguments: [], harmless: true, dead_man: true });
  assert.deepEqual(control._buttons.map(({ textContent }) => textContent), ["Hold to run"]);
});

test("what bars a page from commanding is named, the gravest first", async () => {
  const { client, feed, told } = page();
  feed._text({ type: "server", operate: true });
  const barriers = async (message, number = null) => {
    client._number = number;
    await told({ type: "state", ...message });
    return [client.barrier(), client.barrier(false)];
  };
  assert.deepEqual(await barriers({}), Array(2).fill("belt takes no commands"));
  assert.deepEqual(await barriers({ mode: "automatic", lease: { number: 0, holder: "" } }), Array(2).fill("Take control first"));
  assert.deepEqual(await barriers({ mode: "automatic", lease: { number: 1, holder: "Ben" } }), Array(2).fill("Ben has control"));
  assert.deepEqual(await barriers({ mode: "automatic", lease: { number: 2, holder: "Ann" } }, 2), ["", "In manual mode only"]);
  assert.deepEqual(await barriers({ mode: "manual", lease: { number: 2, holder: "Ann" } }, 2), ["", ""]);
  assert.deepEqual(await barriers({ stage: "ended", mode: "manual" }, 2), Array(2).fill("The run has ended"));
  feed.connected = false;
  assert.equal(client.barrier(), "The connection to the server is lost");
});
