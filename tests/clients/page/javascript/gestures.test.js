/** Wheel, clicks and touch on a plot that only listens. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { gestures } from "../../../../src/umo/clients/page/static/gestures.js";

/** A plot of 1000 pixels, and what was done to it. */
function plot() {
  const over = new EventTarget();
  Object.assign(over, { clientWidth: 1000, getBoundingClientRect: () => ({ left: 100 }) });
  const done = [];
  const act = Object.fromEntries(["zoom", "pan", "click", "undoClick", "live", "hover"].map((name) => [name, (...given) => done.push([name, ...given])]));
  gestures(over, act);
  const send = (type, more = {}, at = 0) => {
    const event = new Event(type, { cancelable: true });
    for (const [name, value] of Object.entries({ clientX: 0, pointerId: 1, pointerType: "mouse", deltaX: 0, deltaY: 0, shiftKey: false, timeStamp: at, ...more })) {
      Object.defineProperty(event, name, { value });
    }
    over.dispatchEvent(event);
  };
  const click = (x, at) => {
    send("pointerdown", { clientX: x + 100 }, at);
    send("pointerup", { clientX: x + 100 }, at);
  };
  return { done, send, click };
}

test("a click sets a cursor, a drag does not", () => {
  const { done, send, click } = plot();
  click(250, 1000);
  send("pointerdown", { clientX: 300 });
  send("pointerup", { clientX: 340 });
  assert.deepEqual(done, [["click", 250]]);
});

test("a double click undoes its first click and goes live; no cursor is set twice", () => {
  const { done, click } = plot();
  click(250, 1000);
  click(252, 1150);
  assert.deepEqual(done, [["click", 250], ["undoClick"], ["live"]]);
  click(252, 1300);  // a third one is a click again
  assert.deepEqual(done.at(-1), ["click", 252]);
});

test("two clicks that are slow or apart are two clicks", () => {
  const { done, click } = plot();
  click(250, 1000);
  click(250, 2000);
  click(400, 2100);
  assert.deepEqual(done.map(([name]) => name), ["click", "click", "click"]);
});

test("the wheel zooms about its place; with Shift, or sideways, it moves", () => {
  const { done, send } = plot();
  send("wheel", { deltaY: 100, clientX: 350 });
  send("wheel", { deltaY: 100, shiftKey: true });
  send("wheel", { deltaX: 50 });
  assert.equal(done[0][0], "zoom");
  assert.ok(done[0][1] > 1 && done[0][2] === 0.25);
  assert.deepEqual(done.slice(1), [["pan", 0.1], ["pan", 0.05]]);
});

test("one finger moves, two zoom", () => {
  const { done, send } = plot();
  const touch = (type, pointerId, clientX) => send(type, { pointerId, clientX, pointerType: "touch" });
  touch("pointerdown", 1, 300);
  touch("pointermove", 1, 200);
  assert.deepEqual(done, [["pan", 0.1]]);
  touch("pointerdown", 2, 400);
  touch("pointermove", 2, 600);
  assert.equal(done[1][0], "zoom");
  assert.equal(done[1][1], 0.5);  // twice as far apart
});

test("a mouse that only moves is told, and when it leaves", () => {
  const { done, send } = plot();
  send("pointermove", { clientX: 150 });
  send("pointerleave");
  assert.deepEqual(done, [["hover", 50], ["hover", null]]);
});
