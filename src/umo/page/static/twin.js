/** The tab "Twin": the machine in 3D, moved by the values of the station, live or of the last minutes. */

import { TwinView } from "./twin/view.js";

const NONE = "This station declares no twin. A file twin.py in its folder would: docs/howto-declare-a-twin.md.";

let view = null;
let turn = 0;

/** Show the twin of the feed's station in an empty element. */
export async function mount(element, feed) {
  unmount();
  const mine = turn;
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

async function asked(feed) {
  try {
    return (await feed.json(`twin/${encodeURIComponent(feed.station)}`)) ?? { error: NONE };
  } catch (error) {
    return { error: /404/.test(error.message) ? NONE : `The twin cannot be shown: ${error.message}` };
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
