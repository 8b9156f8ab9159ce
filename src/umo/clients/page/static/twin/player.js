/** The time that is shown: live, or one of the past, standing or playing. */

import { clockText } from "../presentation.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];

export class Player {
  /** @param {import("../feed.js").Feed} feed @param {() => void} changed called when another time is to be shown */
  constructor(feed, changed) {
    this.feed = feed;
    this.changed = changed;
    /** @type {number | null} s on the cycle's clock; null: live */
    this.time = null;
    this.speed = 1;
    this.playing = false;
    this.play = button("Play", "Play from the time that is shown (Space)", () => this.toggle());
    this.slider = Object.assign(document.createElement("input"), { type: "range", step: "0.01", title: "Time" });
    this.slider.setAttribute("aria-label", "Time that is shown");
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.text = Object.assign(document.createElement("output"), { className: "twin-time" });
    this.rate = document.createElement("select");
    this.rate.setAttribute("aria-label", "Speed of playing");
    for (const speed of SPEEDS) this.rate.add(new Option(`${speed} ×`, String(speed), speed === 1, speed === 1));
    this.rate.addEventListener("change", () => (this.speed = Number(this.rate.value)));
    this.live = button("Live", "Follow the station (End)", () => this.follow());
    this.element = Object.assign(document.createElement("div"), { className: "twin-player" });
    this.element.append(this.play, this.slider, this.text, this.rate, this.live);
    this.refresh();
  }

  /** @param {number} time */
  seek(time) {
    const { start, stop } = this.feed.range();
    this.time = Math.min(Math.max(time, start), stop);
    this.refresh();
    this.changed();
  }

  toggle() {
    this.playing = !this.playing;
    const { start, stop } = this.feed.range();
    if (this.playing && this.time === null) this.time = Math.max(start, stop - 10);
    this.refresh();
    this.changed();
  }

  follow() {
    this.time = null;
    this.playing = false;
    this.refresh();
    this.changed();
  }

  /** So many seconds have passed. @param {number} seconds */
  advance(seconds) {
    if (!this.playing || this.time === null) return;
    const next = this.time + seconds * this.speed;
    if (next >= this.feed.range().stop) this.follow();
    else this.seek(next);
  }

  /** Show how long the history is now, and the time in it. */
  refresh() {
    const { start, stop } = this.feed.range();
    if (this.time !== null && this.time < start) this.time = start; // the server keeps no more
    this.slider.min = String(start);
    this.slider.max = String(stop);
    this.slider.value = String(this.time ?? stop);
    const ago = this.time === null ? (this.feed.ended ? "last" : "live") : `${(this.time - stop).toFixed(1)} s`;
    this.text.textContent = `${clockText(this.time ?? stop)} (${ago})`;
    this.play.textContent = this.playing ? "Pause" : "Play";
    this.live.setAttribute("aria-pressed", String(this.time === null));
  }

  /** True if the key was one of the player's. @param {KeyboardEvent} event */
  press(event) {
    if (event.key === " ") this.toggle();
    else if (event.key === "End") this.follow();
    else if (event.key === "," || event.key === ".") this.seek((this.time ?? this.feed.range().stop) + (event.key === "," ? -0.1 : 0.1));
    else return false;
    return true;
  }
}

/** @param {string} text @param {string} title @param {() => void} pressed */
export function button(text, title, pressed) {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text, title });
  made.addEventListener("click", pressed);
  return made;
}
