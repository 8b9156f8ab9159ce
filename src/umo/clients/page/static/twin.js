/** The tab "Twin": the machine in 3D, moved by the values of the station, live or of the last minutes. */

import { TwinView } from "./twin/view.js";

/** @typedef {import("./feed.js").Feed} Feed */

const NO_TWIN = "This station declares no twin. A file twin.py in its folder would: docs/howto-declare-a-twin.md.";
const LOADING = "The twin is loading\u2026";

export class View {
  /** @type {TwinView | null} What is shown now. For tests. */
  static shown = null;

  /** @param {HTMLElement} element @param {Feed} feed */
  constructor(element, feed) {
    this._closed = false;
    /** @type {TwinView | null} */
    this._twin = null;
    this.ready = this._show(element, feed);
  }

  /** Show the twin of the feed's station in an empty element. @param {HTMLElement} element @param {Feed} feed */
  async _show(element, feed) {
    if (!feed.description?.twin) {
      tell(element, NO_TWIN);
      return;
    }
    tell(element, LOADING);
    const description = await asked(feed);
    if (this._closed) return;
    if (description.error) tell(element, description.error);
    else View.shown = this._twin = drawn(element, feed, description);
  }

  close() {
    this._closed = true;
    this._twin?.close();
    View.shown = null;
  }
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
function drawn(element, feed, description) {
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
