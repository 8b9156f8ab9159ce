/** What the list of stations says before and after the server has told its stations. node --test. */

import assert from "node:assert/strict";
import { test } from "node:test";

globalThis.WebSocket ??= /** @type {any} */ ({ OPEN: 1 });
globalThis.window = { addEventListener() {} };
const element = (tag = "") => ({ tag, textContent: "", dataset: {}, parts: [], classList: { toggle() {} }, append(...parts) { this.parts.push(...parts); }, setAttribute() {}, addEventListener() {} });
globalThis.document = { addEventListener() {}, createElement: element };
globalThis.Text = class {};
const { Feed } = await import("../../../../src/umo/clients/page/static/feed.js");
const { list } = await import("../../../../src/umo/clients/page/static/stations.js");

const textOf = (part) => [part.textContent, ...part.parts.map(textOf)].filter(Boolean).join(" ");

/** @param {any} feed */
function said(feed) {
  const shown = element();
  list(shown, feed, () => {}, element());
  return textOf(shown);
}

test("nothing is said of stations until the server has told them, nor while the connection is lost", () => {
  const feed = new Feed();
  feed.start = () => {};
  assert.equal(said(feed), "Connecting to the server ...");
  feed._text({ type: "server", station: null, operate: false, version: "1" });
  assert.equal(said(feed), "Connecting to the server ...");
  feed._text({ type: "stations", stations: [] });
  assert.match(said(feed), /^No station is running\. Start one in a terminal/);
  feed._closed(1006);
  assert.equal(said(feed), "Connecting to the server ...");
  feed._closed(4401);
  assert.equal(said(feed), "");
});
