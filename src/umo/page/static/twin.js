/** The tab "Twin": the machine in 3D, moved by the values of the station, live or of the last minutes. */

import { TwinView } from "./twin/view.js";

/** @typedef {import("./feed.js").Feed} Feed */

const NONE = "This station declares no twin. A file twin.py in its folder would: docs/howto-declare-a-twin.md.";
const LOADING = "The twin is loading\u2026";

/** @type {TwinView | null} */
let view = null;
let turn = 0;

/** Show the twin of the feed's station in an empty element. @param {HTMLElement} element @param {Feed} feed */
export async function mount(element, feed) {
  unmount();
  const mine = turn;
  if (!feed.description?.twin) {
    tell(element, NONE);
    return;
  }
  tell(element, LOADING);
  const description = await asked(feed);
  if (mine !== turn) return; // another one was mounted meanwhile, or this one unmounted
  if (description.error) tell(element, description.error);
  else view = made(element, feed, description);
}

/** Stop showing it. */
export function unmount() {
  turn += 1;
  view?.close();
  view = null;
}

/** What is shown now, or null. For tests. */
export function shown() {
  return view;
}

/** @param {Feed} feed @returns {Promise<Page.Twin>} */
async function asked(feed) {
  try {
    return await feed.json(`twin/${encodeURIComponent(feed.station ?? "")}`);
  } catch (error) {
    return /** @type {Page.Twin} */ ({ error: `The twin cannot be shown: ${words(error)}` });
  }
}

/** @param {HTMLElement} element @param {Feed} feed @param {Page.Twin} description */
function made(element, feed, description) {
  try {
    const twin = new TwinView(feed, description);
    element.replaceChildren(twin.element);
    twin.begin();
    return twin;
  } catch (error) {
    tell(element, `The twin cannot be drawn: ${words(error)}`);
    return null;
  }
}

/** @param {HTMLElement} element @param {string} text */
function tell(element, text) {
  element.replaceChildren(Object.assign(document.createElement("p"), { className: "twin-note", role: "status", textContent: text }));
}

/** @param {unknown} error */
const words = (error) => (error instanceof Error ? error.message : String(error));
