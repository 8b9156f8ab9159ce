/** The messages of the server, and what they make of a page's state. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Feed, joined, unpack } from "../../../../src/umo/clients/page/static/feed.js";

globalThis.WebSocket ??= /** @type {any} */ ({ OPEN: 1 });  // this node has none

/** As umo/clients/page/subscriptions.py packs it. */
function packed(head, rows) {
  const text = new TextEncoder().encode(JSON.stringify(head));
  const padding = (8 - ((4 + text.length) % 8)) % 8;
  const buffer = new ArrayBuffer(4 + text.length + padding + 8 * rows.flat().length);
  new DataView(buffer).setUint32(0, text.length + padding, true);
  new Uint8Array(buffer, 4).set(text);
  new Uint8Array(buffer, 4 + text.length, padding).fill(32);
  new Float64Array(buffer, 4 + text.length + padding).set(rows.flat());
  return buffer;
}

test("a binary message is unpacked, with equal values once", () => {
  const { head, points } = unpack(packed({ id: 3, count: 2, traces: 2, same: true }, [[0, 1], [5, 6], [7, 8]]));
  assert.equal(head.id, 3);
  assert.deepEqual(points.low.map((row) => [...row]), [[5, 6], [7, 8]]);
  assert.equal(points.low, points.high);
  const both = unpack(packed({ id: 3, count: 1, traces: 1, same: false }, [[0], [5], [7]])).points;
  assert.deepEqual([both.low[0][0], both.high[0][0]], [5, 7]);
});

const DESCRIPTION = { type: "description", name: "press", run: "r1", objects: [{ path: "motor", unit: "V" }], signals: [{ path: "error", unit: "V" }] };
const state = (more) => JSON.stringify({ type: "state", run: "r1", number: 1, stage: "running", ages: {}, start: 0, stop: 1, full: true, values: {}, ...more });

test("states are put together from what has changed; events and misses stay until new ones come", () => {
  const feed = new Feed();
  let states = 0;
  feed.on("state", () => { states += 1; });
  feed._text(DESCRIPTION);
  feed._text(JSON.parse(state({ values: { 0: [1.5, 300, 0], 1: [0.1] }, events: [{ text: "x" }], misses: [[1, 2]] })));
  feed._text(JSON.parse(state({ full: false, number: 2, values: { 0: [2.5, 500, 3] } })));
  assert.equal(states, 2);
  assert.deepEqual(feed.latest("motor"), { value: 2.5, raw: 500, quality: 3, time: undefined });
  assert.equal(feed.latest("error")?.value, 0.1);
  assert.equal(feed.latest("nothing"), null);
  assert.deepEqual([feed.events.length, feed.misses], [1, [[1, 2]]]);
  assert.deepEqual(feed.changed, [0]);
  assert.equal(feed.ended, false);
});

test("what happened stays known though the server tells the last events only", () => {
  const event = (time, text) => ({ time, text, path: "", command: 0, state: "none" });
  const [a, b, c, d, e] = [event(1, "a"), event(2, "b"), event(2, "c"), event(2, "d"), event(3, "e")];
  assert.deepEqual(joined([a, b, c], [c, d, e]), [a, b, c, d, e]);  // of one moment, too
  assert.deepEqual(joined([a], [d, e]), [a, d, e]);
  assert.deepEqual(joined([a, b], []), [a, b]);
  const many = Array.from({ length: 1200 }, (_, i) => event(i, "m"));
  assert.deepEqual(joined(many.slice(0, 1000), many.slice(950, 1050)).map(({ time }) => time), many.slice(50, 1050).map(({ time }) => time));
  const feed = new Feed();
  feed._text(DESCRIPTION);
  feed._text(JSON.parse(state({ misses: [[1, 2], [3, 1]] })));
  feed._text(JSON.parse(state({ misses: [[3, 1], [4, 5]] })));
  assert.deepEqual(feed.misses, [[1, 2], [3, 1], [4, 5]]);
});

test("a page that shows a station takes nothing of another one, which the server may send before it knows", () => {
  for (const wanted of ["oven", ""]) {
    const feed = new Feed();
    feed.wanted = wanted;
    feed._text(DESCRIPTION);
    feed._text(JSON.parse(state({})));
    assert.deepEqual([feed.wanted, feed.station, feed.state], [wanted, null, null]);
  }
  const feed = new Feed();
  feed._text(DESCRIPTION);
  feed.watch("oven");
  feed._text(JSON.parse(state({})));
  assert.equal(feed.state, null);
});

test("a page that comes back tells the folder of its station, and shows no other one of that name", () => {
  const feed = new Feed();
  const sent = [];
  feed._send = (message) => sent.push(message);
  feed.connected = true;
  feed._text({ type: "stations", stations: [{ name: "press", place: "/a" }, { name: "oven", place: "/c" }] });
  feed._text({ ...DESCRIPTION, place: "/a" });
  feed._choose();
  feed._text({ type: "stations", stations: [{ name: "press", place: "/b" }] });
  assert.equal(feed.station, null);
  feed.watch("press");
  feed.watch("oven");  // not known any longer
  assert.deepEqual(sent.map(({ name, place }) => [name, place]), [["press", "/a"], ["press", "/b"], ["oven", null]]);
});

test("another run begins with nothing known of the one before", () => {
  const feed = new Feed();
  feed._text(DESCRIPTION);
  feed._text(JSON.parse(state({ values: { 0: [1.5, 300, 0] }, events: [{ text: "x" }] })));
  feed._text({ ...DESCRIPTION, run: "r2" });  // of the same name: the station has started again
  assert.deepEqual([feed.latest("motor"), feed.events, feed.state], [null, [], null]);
});

test("a command that cannot be sent is an error, and answers go to who has asked", async () => {
  const feed = new Feed();
  await assert.rejects(feed.command({ do: "stop" }), /no connection/);
  feed.connected = true;
  let begun = false;
  const answer = feed.command({ do: "call" }, () => { begun = true; });
  feed._text({ type: "answer", id: 1, state: "begun" });
  feed._text({ type: "answer", id: 1, state: "done", text: "" });
  assert.equal((await answer).state, "done");
  assert.equal(begun, true);
  const failed = feed.measure({ paths: [], start: 0, stop: 1 });
  feed._text({ type: "error", id: 2, text: "no station is chosen" });
  await assert.rejects(failed, /no station is chosen/);
});
