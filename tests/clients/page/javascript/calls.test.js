/** What became of the last call of an action, in words, where it is called. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { callWords, lastCall } from "../../../../src/umo/clients/page/static/calls.js";

const event = (command, time, state, text = "", more = {}) => ({ path: "home", asked: "call home", who: "Ann", command, time, state, text, ...more });
const own = (state, at, more = {}) => ({ what: "home", path: "home", state, text: "", call: true, at, command: null, ...more });
const said = (events, asked, now, name = "") => {
  const call = lastCall(["home"], events, asked);
  return call && callWords(call, now, name);
};

test("a running action tells since when, its last progress, and whose it is", () => {
  assert.equal(said([], [], 5), null);
  const events = [event(3, 10, "begun"), event(3, 12, "begun", "searching the stop"), event(4, 13, "done", "", { path: "lamp", asked: "write lamp ON" })];
  assert.equal(said(events.slice(0, 1), [], 11), "runs for 1 s (Ann)");
  assert.equal(said(events, [], 15), "runs for 5 s: searching the stop (Ann)");
  assert.equal(said(events, [], 15, "Ann"), "runs for 5 s: searching the stop");
});

test("its end stays for a while, in words", () => {
  const done = [event(3, 10, "begun"), event(3, 14, "done", "\"found\"")];
  assert.equal(said(done, [], 15, "Ann"), "done after 4 s: found");
  assert.equal(said(done, [], 300), "");
  assert.equal(said([event(3, 10, "refused", "RangeError: home: speed: 9 m/s is outside 0 to 1")], [], 11, "Ann"), "refused: speed: 9 m/s is outside 0 to 1");
  assert.equal(said([event(3, 10, "begun"), event(3, 12, "cancelled", "by Ben")], [], 13, "Ann"), "cancelled after 2 s: by Ben");
});

test("only the last call is told, and the cancellation of a command is not taken for one", () => {
  const events = [event(3, 10, "begun"), event(3, 14, "failed", "TaskFailed: stuck"), event(5, 20, "begun"), event(6, 21, "done", "", { asked: "cancel home" })];
  assert.equal(said(events, [], 22, "Ann"), "runs for 2 s");
});

test("what never came to the machine is told as the page knows it", () => {
  assert.equal(said([], [own("sent", 3)], 4), "sent");
  const before = [event(3, 10, "begun"), event(3, 14, "done")];
  assert.equal(said(before, [own("refused", 20, { text: "bob has the role see; call needs the role operate" })], 21), "refused: bob has the role see; call needs the role operate");
  assert.equal(said(before, [own("done", 10, { command: 3 })], 15, "Ann"), "done after 4 s");
  assert.equal(said([], [own("failed", 3, { text: "no answer", command: 9 })], 4), "failed: no answer");
});
