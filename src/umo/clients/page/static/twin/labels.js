/** Names of bodies with the values that drive them, over the picture. */

import * as THREE from "three";
import { valueText } from "../presentation.js";

/** @typedef {import("./scene.js").Body} Body */

const MAX_LABELS = 60;

export class Labels {
  /**
   * @param {HTMLElement} element the layer above the picture @param {import("./scene.js").TwinScene} scene
   * @param {[string, string][]} qualities sign and words of each
   */
  constructor(element, scene, qualities) {
    this.qualities = qualities;
    this.element = element;
    this.scene = scene;
    this.all = false;
    /** @type {Body | null} */
    this.chosen = null;
    /** @type {Map<Body, HTMLElement>} */
    this.shown = new Map();
  }

  /** Show those of all driven bodies, at most 60, or only that of the chosen one. @param {boolean} all */
  show(all) {
    this.all = all;
  }

  /** Choose the body under a place of the picture, -1 to 1 each; none where there is none. @param {number} x @param {number} y @param {THREE.Camera} camera */
  choose(x, y, camera) {
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(x, y), camera);
    const hits = ray.intersectObject(this.scene.root, true);
    this.chosen = hits.find((hit) => hit.object.userData.body && seen(hit.object))?.object.userData.body ?? null;
  }

  /**
   * Put each where its body is now.
   * @param {THREE.Camera} camera @param {number} width @param {number} height
   * @param {(path: string) => Page.TwinSample | null} sample
   */
  place(camera, width, height, sample) {
    const wanted = new Set(this.#wanted());
    for (const [body, label] of this.shown)
      if (!wanted.has(body)) {
        label.remove();
        this.shown.delete(body);
      }
    const boxes = [];
    for (const body of wanted) {
      const label = this.shown.get(body) ?? this.#add(body);
      const text = this.#text(body, sample);
      if (label.textContent !== text) label.textContent = text;
      const at = middle(body).project(camera);
      label.hidden = Math.abs(at.z) > 1 || !seen(body.node);
      if (!label.hidden) boxes.push({ label, x: ((at.x + 1) / 2) * width, y: ((1 - at.y) / 2) * height, w: 0, h: 0 });
    }
    this.#arrange(boxes, width);
  }

  /** Side by side, none over another, none cut off at the right. @param {{label: HTMLElement, x: number, y: number, w: number, h: number}[]} boxes @param {number} width */
  #arrange(boxes, width) {
    for (const box of boxes) [box.w, box.h] = [box.label.offsetWidth, box.label.offsetHeight];
    boxes.sort((one, other) => one.y - other.y);
    boxes.forEach((box, i) => {
      box.x = Math.max(0, Math.min(box.x, width - box.w));
      for (const other of boxes.slice(0, i)) {
        const beside = box.x >= other.x + other.w || other.x >= box.x + box.w;
        if (!beside && box.y < other.y + other.h + 2 && box.y + box.h > other.y) box.y = other.y + other.h + 2;
      }
      box.label.style.transform = `translate(${Math.round(box.x)}px, ${Math.round(box.y)}px)`;
    });
  }

  clear() {
    for (const label of this.shown.values()) label.remove();
    this.shown.clear();
    this.chosen = null;
  }

  /** Of bodies that the same values drive, the first one: a value is told once. */
  #wanted() {
    const told = new Set([""]);
    const first = (/** @type {Body} */ body) => {
      const paths = pathsOf(body).join();
      return !told.has(paths) && told.add(paths);
    };
    const driven = this.all ? this.scene.bodies.filter(first).slice(0, MAX_LABELS) : [];
    return this.chosen && !driven.includes(this.chosen) ? [...driven, this.chosen] : driven;
  }

  /** @param {Body} body */
  #add(body) {
    const label = document.createElement("span");
    label.className = "twin-label";
    this.element.append(label);
    this.shown.set(body, label);
    return label;
  }

  /** @param {Body} body @param {(path: string) => Page.TwinSample | null} sample */
  #text(body, sample) {
    const lines = pathsOf(body).map((path) => `${path} ${shownValue(this.scene.entries.get(path), sample(path), this.qualities)}`);
    return [body.name, ...lines].join("\n");
  }
}

/** A value as text: with its unit, or the name of its state; and its quality, if that is not good, or that it is the last one.
 * @param {Page.Entry | undefined} entry @param {Page.TwinSample | null} found @param {[string, string][]} qualities */
export function shownValue(entry, found, qualities) {
  if (!entry || !found || !Number.isFinite(found.value)) return "no value";
  const quality = found.quality ? ` (${qualities[found.quality][1]})` : found.last ? " (last)" : "";
  return valueText(entry, found.value) + quality;
}

/** @param {Body} body */
function pathsOf({ told }) {
  const paths = [...told.joints, ...told.colours, ...told.visible].map((drive) => drive.path);
  return [...new Set([...paths, ...told.carried.flatMap((load) => [load.sensor, load.speed])])];
}

/** @param {Body} body */
function middle(body) {
  if (!body.meshes.length) return body.node.getWorldPosition(new THREE.Vector3());
  const box = new THREE.Box3();
  for (const mesh of body.meshes) box.expandByObject(mesh);
  return box.getCenter(new THREE.Vector3());
}

/** @param {THREE.Object3D} object */
function seen(object) {
  for (let each = /** @type {THREE.Object3D | null} */ (object); each; each = each.parent) if (!each.visible) return false;
  return true;
}
