/** The bar of a recording: its time, playing, and what happened, above every view. */

import { el, setText } from "./dom.js";
import { clustersOf, linesOf, marksOf } from "./marks.js";
import { clockText, wallDay, wallTime } from "./presentation.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 60];
const STEP = 0.01;  // s that the slider and the keys [ and ] move
const PATIENCE = 2000;  // ms that a chosen time stands before the server shows it: another page may have chosen one since

/** @typedef {import("./feed.js").Feed} Feed */

export class RecordingBar {
  /** @param {HTMLElement} element @param {Feed} feed */
  constructor(element, feed) {
    this._feed = feed;
    this._element = element;
    this._events = "";
    /** @type {number | null} The time that the hand on the slider has chosen, until the server shows it. */
    this._held = null;
    this._heldUntil = 0;
    /** @type {(() => void)[]} What waits until the server shows the chosen time. */
    this._waiting = [];
    this._play = el("button", { textContent: "Play", title: "Play from this time on (P)", onclick: () => this.toggle() });
    this._slider = el("input", { type: "range", step: String(STEP), "aria-label": "Time of the recording", oninput: () => this.seek(Number(this._slider.value)) });
    this._marks = el("div", { className: "recording-marks" });
    this._text = el("output", { className: "recording-time" });
    this._speed = el("select", { "aria-label": "Speed of playing", title: "Speed of playing", onchange: () => this._send(null, this._playing) },
      ...SPEEDS.map((speed) => el("option", { value: String(speed), textContent: `${speed} \u00d7`, selected: speed === 1 })));
    this._replay = el("button", { className: "recording-replay", title: "Copy the command that replays this run and stops at this time", onclick: () => this._copy() });
    this._file = el("span", { className: "recording-file" });
    element.replaceChildren(this._play, el("div", { className: "recording-track" }, this._marks, this._slider), this._text, this._speed, this._replay, this._file);
    feed.on("description", () => this._described());
    feed.on("state", () => this._refresh());
    document.addEventListener("keydown", (event) => this._press(event));
  }

  get _playing() { return this._feed.state?.recording?.playing ?? false; }

  toggle() { this._send(null, !this._playing); }

  /** @param {number} time */
  seek(time) {
    this._held = time;
    this._heldUntil = performance.now() + PATIENCE;
    this._send(time, false);
    this._tell(time);
  }

  /** @param {number | null} time @param {boolean} playing */
  _send(time, playing) { this._feed.play({ ...(time === null ? {} : { time }), playing, speed: Number(this._speed.value) }); }

  _described() {
    const recording = this._feed.description?.recording;
    this._element.hidden = !recording;
    this._events = "";
    if (!recording) return;
    const names = recording.files.map(({ file, whole, lost }) => `${file}${whole ? "" : " (cut or torn)"}${lost ? ` (${lost} periods lost)` : ""}`);
    setText(this._file, names.length > 1 ? `${names[0]}, over it as \u201c${recording.second}\u201d: ${names[1]}` : names[0]);
    this._replay.hidden = !recording.replay;
    setText(this._replay, "Copy replay");
    this._file.title = this._file.textContent ?? "";
  }

  _refresh() {
    const played = this._feed.state?.recording;
    if (!played) return;
    const { start, stop } = this._feed.range();
    this._slider.min = String(start);
    this._slider.max = String(stop);
    setText(this._play, played.playing ? "Pause" : "Play");
    if (played.asked === this._held || performance.now() > this._heldUntil || played.playing) this._held = null;
    if (this._held === null) {
      this._slider.value = String(played.time);
      this._tell(played.time);
      for (const goOn of this._waiting.splice(0)) goOn();
    }
    this._mark(start, stop);
  }

  /** @param {number} time */
  _tell(time) {
    const { stop } = this._feed.range();
    const utc = this._feed.state?.utc;
    const clock = typeof utc === "number" ? ` \u00b7 ${wallDay(utc, time)} ${wallTime(utc, time)}` : "";
    setText(this._text, `${clockText(time)} of ${clockText(stop)}${clock}`);
  }

  /** The marks above the slider, made anew if there are others. @param {number} start @param {number} stop */
  _mark(start, stop) {
    const { events, misses } = this._feed;
    const width = this._marks.clientWidth;
    const key = [events.length, misses.length, width, start, stop].join();
    if (key === this._events || !width) return;
    this._events = key;
    const length = Math.max(stop - start, 1e-9);
    const pixel = length / width / 3;
    const clusters = [...clustersOf(marksOf([], misses), pixel / 3), ...clustersOf(marksOf(events, []), pixel)];  // events stand over misses
    this._marks.replaceChildren(...clusters.map((cluster) => {
      const share = Math.min(Math.max((cluster.time - start) / length, 0), 1);
      const told = linesOf(cluster).join("\n");
      const mark = el("button", { className: "recording-mark", "data-kind": cluster.kind, title: told, "aria-label": told, tabIndex: -1, onclick: () => this.seek(cluster.time) });
      mark.style.left = `${100 * share}%`;
      return mark;
    }));
  }

  /** Once the server shows the time that was chosen. @returns {Promise<void>} */
  _isShown() { return this._held === null ? Promise.resolve() : new Promise((resolve) => this._waiting.push(resolve)); }

  async _copy() {
    await this._isShown();
    const shown = Number((this._feed.state?.time ?? 0).toFixed(9));  // of the period that is shown, at or before the slider
    const command = `${this._feed.description?.recording?.replay} --at ${shown}s`;
    try {
      await navigator.clipboard.writeText(command);
      setText(this._replay, "Copied");
    } catch {
      setText(this._replay, command);  // without TLS, at an address of another computer, a page may not copy
    }
    this._replay.title = command;
  }

  /** @param {KeyboardEvent} event */
  _press(event) {
    const target = /** @type {Element} */ (event.target);
    if (this._element.hidden || target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    const time = this._feed.state?.recording?.time ?? 0;
    if (event.key === "p") this.toggle();
    else if (event.key === "[" || event.key === "]") this.seek(time + (event.key === "[" ? -STEP : STEP));
  }
}
