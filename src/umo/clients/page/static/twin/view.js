/** The view "Twin": the picture, drawn only when something has changed, its buttons and its time. */

import * as THREE from "three";
import { setText } from "../dom.js";
import { isBinary } from "../presentation.js";
import { Belts } from "./belts.js";
import { Eye } from "./camera.js";
import { History } from "./history.js";
import { Labels } from "./labels.js";
import { button, Player } from "./player.js";
import { TwinScene } from "./scene.js";

const BAD = 4; // quality
const MAX_PATHS = 64; // paths of a subscription: more are taken from the state of the station, 10 times a second

export class TwinView {
  /** @param {import("../feed.js").Feed} feed @param {Page.Twin} description */
  constructor(feed, description) {
    this.feed = feed;
    this.description = description;
    this.scene = new TwinScene(description);
    this.history = new History(feed, description.paths);
    /** @type {Map<string, number>} */
    this.live = new Map();
    /** @type {Map<string, Page.TwinSample>} */
    this.samples = new Map();
    this.sample = (/** @type {string} */ path) => this.samples.get(path) ?? null;
    this.frame = 0;
    /** Pictures drawn so far. For tests. */
    this.drawn = 0;
    this.listeners = new AbortController();
    /** @type {(() => void)[]} */
    this.closers = [];
    /** @type {string | undefined} */
    this.qualities = undefined;
    /** @type {number | undefined} When the picture before was drawn, while it plays. */
    this.before = undefined;
    this.element = Object.assign(document.createElement("div"), { className: "twin-view" });
    this.picture = Object.assign(document.createElement("div"), { className: "twin-picture", tabIndex: 0 });
    this.picture.setAttribute("role", "application");
    const keys = "arrows: orbit, with Shift: pan, + and -: zoom, R: reset view, F: fit, L: labels, Space: play, End: live";
    this.picture.setAttribute("aria-label", `3D view of ${feed.station}. Keys: ${keys}`);
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.world = new THREE.Scene();
    this.ground = makeGround(this.scene.bounds(), description.floor);
    this.world.add(this.scene.root, this.ground, ...lights());
    this.layer = Object.assign(document.createElement("div"), { className: "twin-labels" });
    this.labels = new Labels(this.layer, this.scene, feed.description?.qualities ?? []);
    this.player = new Player(feed, () => this.draw());
    this.picture.append(this.renderer.domElement, this.layer);
    this.labelling = button("Labels", "Names and values of the bodies (L); or click on a body", () => this.#label());
    this.labelling.setAttribute("aria-pressed", "false");
    this.poor = Object.assign(document.createElement("span"), { className: "twin-poor", role: "status" });
    this.eye = new Eye(this.picture, () => this.draw());
    this.player.element.hidden = Boolean(feed.description?.recording); // it has a time of its own
    this.element.append(this.#tools(), this.picture, this.player.element);
    this.theming = new MutationObserver(() => this.#theme());
    this.resizing = new ResizeObserver(() => this.#resize());
    this.belts = new Belts(feed, this.scene, () => this.draw());
    this.closers.push(() => this.belts.close());
  }

  /** Go on when the element stands in the page. */
  begin() {
    this.#listen();
    this.#subscribe();
    this.#theme();
    this.#resize();
    this.eye.look(this.scene.bounds(), this.description.view);
  }

  /** Draw with the next picture of the browser. */
  draw() {
    this.frame ||= requestAnimationFrame((now) => this.#render(now));
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.frame = -1; // nothing is drawn any more
    this.listeners.abort();
    this.resizing.disconnect();
    this.theming.disconnect();
    for (const close of this.closers) close();
    this.labels.clear();
    this.eye.dispose();
    this.scene.dispose();
    this.ground.geometry.dispose();
    this.ground.material.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.element.remove();
  }

  #tools() {
    const tools = Object.assign(document.createElement("div"), { className: "twin-tools" });
    tools.append(
      button("Reset view", "First view (R)", () => this.eye.reset()),
      button("Fit", "Fit everything into the window (F)", () => this.eye.fit()),
      this.labelling,
      this.poor,
    );
    return tools;
  }

  #label() {
    this.labels.show(!this.labels.all);
    this.labelling.setAttribute("aria-pressed", String(this.labels.all));
    this.draw();
  }

  #listen() {
    const { signal } = this.listeners;
    this.picture.addEventListener("keydown", (event) => this.#press(event), { signal });
    /** @type {[number, number] | null} */
    let down = null;
    this.picture.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]), { signal });
    this.picture.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) this.#choose(event);
      down = null;
    }, { signal });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#theme(), { signal });
    this.theming.observe(document.documentElement, { attributes: true });
    this.resizing.observe(this.picture);
  }

  /** @param {KeyboardEvent} event */
  #press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const taken = event.key === "l" ? (this.#label(), true) : this.eye.press(event) || (!this.player.element.hidden && this.player.press(event));
    if (taken) event.preventDefault();
  }

  /** @param {PointerEvent} event */
  #choose(event) {
    const { left, top, width, height } = this.picture.getBoundingClientRect();
    const [x, y] = [(event.clientX - left) / width, (event.clientY - top) / height];
    this.labels.choose(2 * x - 1, 1 - 2 * y, this.eye.camera);
    this.draw();
  }

  #subscribe() {
    const { paths } = this.scene;
    this.closers.push(this.feed.on("state", () => this.#stateCame(paths)));
    if (paths.length && paths.length <= MAX_PATHS) {
      const live = this.feed.subscribe({ paths, span: 0, width: 1 }, (data) => this.#liveCame(paths, data));
      this.closers.push(() => live.close());
    }
  }

  /** @param {string[]} paths @param {Page.Points} points */
  #liveCame(paths, { times, low, high }) {
    if (!times.length) return;
    const last = times.length - 1;
    const values = paths.map((path, i) => (this.#isState(path) ? high[i][last] : (low[i][last] + high[i][last]) / 2));
    this.#take(paths, values);
  }

  /** @param {string[]} paths */
  #stateCame(paths) {
    this.player.refresh();
    const found = paths.map((path) => this.feed.latest(path));
    const qualities = [this.feed.ended, ...found.map((latest) => latest?.quality)].join();
    if (qualities !== this.qualities) this.draw();
    this.qualities = qualities;
    if (paths.length > MAX_PATHS) this.#take(paths, found.map((latest) => latest?.value ?? NaN));
  }

  /** New values of the station: drawn if they are others. @param {string[]} paths @param {number[]} values */
  #take(paths, values) {
    const same = paths.every((path, i) => Object.is(this.live.get(path), values[i]));
    if (same) return;
    paths.forEach((path, i) => this.live.set(path, values[i]));
    if (this.player.time === null) this.draw();
  }

  /** @param {string} path */
  #isState(path) {
    return isBinary(this.scene.entries.get(path));
  }

  /** The values at the time that is shown. */
  #look() {
    const { time } = this.player;
    if (time !== null) {
      for (const path of this.scene.paths) {
        const value = this.history.at(path, time);
        this.samples.set(path, { value, quality: Number.isFinite(value) ? 0 : BAD });
      }
      return;
    }
    for (const path of this.scene.paths) {
      const latest = this.feed.latest(path);
      const value = this.live.get(path) ?? latest?.value ?? NaN;
      this.samples.set(path, { value, quality: latest?.quality ?? 0, last: this.feed.ended });
    }
  }

  /** Have the past loaded that the time needs; draw again when it has come. @param {number} time */
  async #fetch(time) {
    try {
      if (await this.history.load(time)) this.draw();
    } catch {
      // the page shows that there is no connection
    }
  }

  /** @param {number} now  ms. */
  #render(now) {
    if (this.frame === -1) return;
    this.frame = 0;
    if (this.player.playing) {
      this.player.advance(Math.min((now - (this.before ?? now)) / 1000, 0.25));
      this.draw();
    }
    this.before = this.player.playing ? now : undefined;
    if (this.player.time !== null) this.#fetch(this.player.time);
    this.#look();
    this.scene.update(this.sample, this.belts.before(this.player.time));
    this.renderer.render(this.world, this.eye.camera);
    this.labels.place(this.eye.camera, this.picture.clientWidth, this.picture.clientHeight, this.sample);
    this.#tellPoor();
    this.drawn += 1;
  }

  /** Why bodies are drawn faintly. */
  #tellPoor() {
    const words = [...this.scene.poor(this.sample)].map(([path, quality]) => `${path} ${this.feed.description?.qualities[quality]?.[1]}`);
    if (this.feed.ended && this.player.time === null) words.unshift("the last values before the end");
    setText(this.poor, words.length ? `Drawn faintly: ${words.join(", ")}` : "");
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.picture;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.eye.resize(width, height);
    this.draw();
  }

  #theme() {
    this.ground.material.color.set(getComputedStyle(this.picture).color);
    this.draw();
  }
}

function lights() {
  const sun = new THREE.DirectionalLight("#ffffff", 1.9);
  sun.position.set(0.4, -0.8, 1);
  const fill = new THREE.DirectionalLight("#ffffff", 0.7);
  fill.position.set(-1, -0.3, 0.4);
  return [new THREE.HemisphereLight("#ffffff", "#8a8f96", 1.5), sun, fill];
}

/** A grid of lines 0.1 m apart, wider where the machine is; not there without a floor. @param {THREE.Box3} bounds @param {number | null} floor */
function makeGround(bounds, floor) {
  const size = bounds.getSize(new THREE.Vector3());
  const middle = bounds.getCenter(new THREE.Vector3());
  const width = Math.max(size.x, size.y, 0.1) * 3;
  const step = 10 ** Math.round(Math.log10(width / 20));
  const lines = Math.max(2, 2 * Math.ceil(width / step / 2));
  const { geometry } = new THREE.GridHelper(lines * step, lines, "#ffffff", "#ffffff");
  geometry.deleteAttribute("color");
  const grid = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.45 }));
  grid.rotation.x = Math.PI / 2;
  const snapped = (/** @type {number} */ x) => Math.round(x / step) * step;
  grid.position.set(snapped(middle.x), snapped(middle.y), floor ?? 0);
  grid.visible = floor !== null;
  return grid;
}
