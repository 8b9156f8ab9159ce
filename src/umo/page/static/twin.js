/** The tab "Twin": the machine in 3D, moved by the values of the station, live or of the last minutes. */

import { TwinView } from "./twin/view.js";

let view = null;
let opened = 0;

/** Show the twin of the feed's station in an empty element. */
export async function mount(element, feed) {
  unmount();
  const turn = opened;
  const forget = feed.on("description", () => remount(element, feed, turn));
  const description = feed.station ? await asked(feed) : null;
  if (turn !== opened) return forget();
  if (!description || description.error) tell(element, description?.error ?? NONE);
  else view = made(element, feed, description);
  onUnmount = () => (forget(), view?.close(), element.replaceChildren());
}

let onUnmount = () => {};

/** Stop showing it. */
export function unmount() {
  opened += 1;
  onUnmount();
  onUnmount = () => {};
  view = null;
}

/** What is shown now, or null. For tests. */
export function shown() {
  return view;
}

const NONE = "This station declares no twin. A file twin.py in its folder would: docs/howto-declare-a-twin.md.";

function remount(element, feed, turn) {
  if (turn === opened) mount(element, feed);
}

async function asked(feed) {
  try {
    return await feed.json(`twin/${encodeURIComponent(feed.station)}`);
  } catch {
    return null;
  }
}

function made(element, feed, description) {
  try {
    return new TwinView(element, feed, description);
  } catch (error) {
    tell(element, `The twin cannot be drawn: ${error.message}`);
    return null;
  }
}

function tell(element, text) {
  element.replaceChildren(Object.assign(document.createElement("p"), { className: "twin-note", textContent: text }));
}
