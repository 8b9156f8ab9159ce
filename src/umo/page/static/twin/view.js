/** The view "Twin": the picture, drawn only when something has changed, its buttons and its time. */

import * as THREE from "three";
import { Eye } from "./camera.js";
import { History, middles } from "./history.js";
import { Labels } from "./labels.js";
import { button, Player } from "./player.js";
import { TwinScene } from "./scene.js";

const MANY = 200; // paths: more are taken from the state of the station, 10 times a second
const BELTS = { span: 60, rate: 50 }; // s, samples a second: the past that loads on belts are found from

export class TwinView {
  /** @param {HTMLElement} element @param {object} feed of the page @param {object} description of the twin */
  constructor(element, feed, description) {
    this.feed = feed;
    this.scene = new TwinScene(description);
    this.history = new History(feed, description.paths);
    this.belts = this.scene.bodies.flatMap((body) => body.carried.flatMap((load) => [load.sensor, load.speed]));
    this.past = null;
    this.samples = new Map();
    this.sample = (path) => this.samples.get(path) ?? null;
    this.frame = 0;
    /** Pictures drawn so far. For tests. */
    this.drawn = 0;
    this.listeners = new AbortController();
    this.closers = [];
    this.#build(element, description);
    this.#listen(element);
    this.#subscribe();
    this.#theme();
    this.#resize();
    this.eye.look(this.scene.bounds(), description.view);
    this.draw();
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

  #build(element, description) {
    this.element = Object.assign(document.createElement("div"), { className: "twin" });
    this.picture = Object.assign(document.createElement("div"), { className: "twin-picture", tabIndex: 0 });
    this.picture.setAttribute("role", "application");
    const keys = "arrows: orbit, with Shift: pan, + and -: zoom, R: reset view, F: fit, L: labels, Space: play, End: live";
    this.picture.setAttribute("aria-label", `3D view of ${this.feed.station}. Keys: ${keys}`);
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.world = new THREE.Scene();
    const sun = new THREE.DirectionalLight("#ffffff", 1.9);
    sun.position.set(0.4, -0.8, 1);
    const fill = new THREE.DirectionalLight("#ffffff", 0.7);
    fill.position.set(-1, -0.3, 0.4);
    this.world.add(this.scene.root, new THREE.HemisphereLight("#ffffff", "#8a8f96", 1.5), sun, fill);
    this.ground = makeGround(this.scene.bounds(), description.floor);
    this.world.add(this.ground);
    this.layer = Object.assign(document.createElement("div"), { className: "twin-labels" });
    this.labels = new Labels(this.layer, this.scene);
    this.player = new Player(this.feed, () => this.draw());
    this.picture.append(this.renderer.domElement, this.layer);
    this.element.append(this.#tools(keys), this.picture, this.player.element);
    element.append(this.element);
    this.eye = new Eye(this.picture, () => this.draw());
  }

  #tools(keys) {
    const tools = Object.assign(document.createElement("div"), { className: "twin-tools" });
    this.labelling = button("Labels", "Names and values of the bodies (L); or click on a body", () => this.#label());
    this.labelling.setAttribute("aria-pressed", "false");
    tools.append(
      button("Reset view", "First view (R)", () => this.eye.reset()),
      button("Fit", "Fit everything into the window (F)", () => this.eye.fit()),
      this.labelling,
    );
    tools.title = keys;
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
    let down = null;
    this.picture.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]), { signal });
    this.picture.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) this.#choose(event);
      down = null;
    }, { signal });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#theme(), { signal });
    this.theming = new MutationObserver(() => this.#theme());
    this.theming.observe(document.documentElement, { attributes: true });
    this.resizing = new ResizeObserver(() => this.#resize());
    this.resizing.observe(this.picture);
  }

  #press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const taken = event.key === "l" ? (this.#label(), true) : this.eye.press(event) || this.player.press(event);
    if (taken) event.preventDefault();
  }

  #choose(event) {
    const { left, top, width, height } = this.picture.getBoundingClientRect();
    const [x, y] = [(event.clientX - left) / width, (event.clientY - top) / height];
    this.labels.choose(2 * x - 1, 1 - 2 * y, this.eye.camera);
    this.draw();
  }

  #subscribe() {
    const { paths } = this.scene;
    this.closers.push(this.feed.on("state", () => this.#stateCame(paths)));
    if (paths.length && paths.length <= MANY) {
      const live = this.feed.subscribe({ paths, span: 0, width: 1 }, (data) => this.#liveCame(paths, data));
      this.closers.push(() => live.close());
    }
    if (this.belts.length) {
      const asked = { paths: this.belts, span: BELTS.span, width: BELTS.span * BELTS.rate };
      this.belt = new Stretch(this.belts.length, BELTS.span);
      const belt = this.feed.subscribe(asked, (data) => {
        this.belt.take(data);
        if (this.player.time === null) this.draw();
      });
      this.closers.push(() => belt.close());
    }
  }

  #liveCame(paths, { times, low, high }) {
    if (!times.length) return;
    const last = times.length - 1;
    const binary = paths.map((path) => "one" in this.scene.entries.get(path));
    this.live = new Map(paths.map((path, i) => [path, binary[i] ? high[i][last] : (low[i][last] + high[i][last]) / 2]));
    if (this.player.time === null) this.draw();
  }

  #stateCame(paths) {
    this.player.refresh();
    if (paths.length > MANY) this.live = new Map(paths.map((path) => [path, this.feed.latest(path)?.value ?? NaN]));
    if (this.player.time === null) this.draw();
  }

  /** The values at the time that is shown. */
  #look() {
    const { time } = this.player;
    if (time !== null) {
      for (const path of this.scene.paths) this.samples.set(path, { value: this.history.at(path, time), quality: 0 });
      return;
    }
    for (const path of this.scene.paths) {
      const latest = this.feed.latest(path);
      const value = this.live?.get(path) ?? latest?.value ?? NaN;
      this.samples.set(path, { value, quality: latest?.quality ?? 0 });
    }
  }

  /** Have the past loaded that the time needs; draw again when it has come. */
  async #fetch(time) {
    if (await this.history.load(time)) this.draw();
    if (!this.belts.length || this.player.time !== time || this.pastOf === time) return;
    this.pastOf = time;
    const start = Math.max(this.feed.range().start, time - BELTS.span);
    const width = Math.max(1, Math.ceil((time - start) * BELTS.rate));
    const got = await this.feed.window({ paths: this.belts, start, stop: time, width });
    this.past = { times: got.times, columns: columnsOf(this.belts, this.#middles(got)), now: time };
    this.draw();
  }

  #middles(got) {
    return middles(got, this.belts.map((path) => "one" in this.scene.entries.get(path)));
  }

  #beltNow() {
    if (!this.belt) return null;
    if (this.player.time !== null) return this.past;
    const { times } = this.belt;
    return { times, columns: columnsOf(this.belts, this.#middles(this.belt)), now: times.at(-1) ?? 0 };
  }

  #render(now) {
    if (this.frame === -1) return;
    this.frame = 0;
    if (this.player.playing) {
      this.player.advance(Math.min((now - (this.before ?? now)) / 1000, 0.25));
      this.draw();
    }
    this.before = this.player.playing ? now : undefined;
    if (this.player.time !== null) this.#fetch(this.player.time).catch(() => {}); // the connection says it itself
    this.#look();
    this.scene.update(this.sample, this.#beltNow());
    this.renderer.render(this.world, this.eye.camera);
    this.labels.place(this.eye.camera, this.picture.clientWidth, this.picture.clientHeight, this.sample);
    this.drawn += 1;
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.picture;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.eye.resize(width, height);
    this.draw();
  }

  #theme() {
    const line = getComputedStyle(this.element).getPropertyValue("--twin-grid").trim();
    this.ground.material.color.set(line || "#9aa3ad");
    this.draw();
  }
}

/** The data of a subscription over its span. */
class Stretch {
  constructor(count, span) {
    this.span = span;
    this.times = new Float64Array(0);
    this.low = Array.from({ length: count }, () => new Float64Array(0));
    this.high = this.low;
  }

  take({ from, times, low, high }) {
    const end = times.at(-1) ?? this.times.at(-1) ?? 0;
    const keep = [...this.times.keys()].filter((i) => this.times[i] < from && this.times[i] > end - this.span);
    const [first, count] = [keep[0] ?? 0, keep.length];
    const joined = (old, more) => {
      const made = new Float64Array(count + more.length);
      made.set(old.subarray(first, first + count));
      made.set(more, count);
      return made;
    };
    this.low = this.low.map((old, i) => joined(old, low[i]));
    this.high = this.high.map((old, i) => joined(old, high[i]));
    this.times = joined(this.times, times);
  }
}

function columnsOf(paths, columns) {
  return new Map(paths.map((path, i) => [path, columns[i]]));
}

/** A grid of lines 0.1 m apart, wider where the machine is; not there without a floor. */
function makeGround(bounds, floor) {
  const size = bounds.getSize(new THREE.Vector3());
  const middle = bounds.getCenter(new THREE.Vector3());
  const width = Math.max(size.x, size.y, 0.1) * 3;
  const step = 10 ** Math.round(Math.log10(width / 20));
  const lines = Math.max(2, 2 * Math.ceil(width / step / 2));
  const grid = new THREE.GridHelper(lines * step, lines, "#ffffff", "#ffffff");
  grid.geometry.deleteAttribute("color");
  grid.material.dispose();
  grid.material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.45 });
  grid.rotation.x = Math.PI / 2;
  const snapped = (x) => Math.round(x / step) * step;
  grid.position.set(snapped(middle.x), snapped(middle.y), floor ?? 0);
  grid.visible = floor !== null;
  return grid;
}
