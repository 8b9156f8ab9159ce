/** The eye: orbit, zoom and pan with mouse, touch and keys; a first view, and one that fits everything. */

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const KEY_STEP = Math.PI / 24; // of a key, rad
const START = new THREE.Vector3(0.55, -0.8, 0.5).normalize();

/** @type {Record<string, [number, number]>} */
const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Eye {
  /** @param {HTMLElement} element takes mouse, touch and keys @param {() => void} changed */
  constructor(element, changed) {
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, element);
    this.controls.addEventListener("change", changed);
    this.controls.maxPolarAngle = Math.PI * 0.98;
    this.bounds = new THREE.Box3();
    /** @type {Page.Twin["view"]} */
    this.view = null;
  }

  /** What is looked at: its box, and the view that its declaration gives, or null. @param {THREE.Box3} bounds @param {Page.Twin["view"]} view */
  look(bounds, view) {
    this.bounds = bounds;
    this.view = view;
    this.reset();
  }

  /** @param {number} width @param {number} height */
  resize(width, height) {
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
  }

  /** The first view; in a narrow window from further away, so that as much is seen. */
  reset() {
    if (!this.view) return this.fit(START);
    const target = new THREE.Vector3(...this.view.target);
    const away = new THREE.Vector3(...this.view.eye).sub(target);
    return this.#stand(target, away.multiplyScalar(Math.max(1, 1.2 / this.camera.aspect)));
  }

  /** From the present side, so that everything is seen. */
  fit(from = this.camera.position.clone().sub(this.controls.target).normalize()) {
    const target = this.bounds.getCenter(new THREE.Vector3());
    return this.#stand(target, from.clone().multiplyScalar(this.#distance(from, target)));
  }

  /** True if the key was one of the eye's. @param {KeyboardEvent} event */
  press(event) {
    const turn = TURNS[event.key];
    if (turn && event.shiftKey) this.#pan(...turn);
    else if (turn) this.#orbit(...turn);
    else if (event.key === "+" || event.key === "=") this.#zoom(1 / 1.15);
    else if (event.key === "-") this.#zoom(1.15);
    else if (event.key === "r" || event.key === "Home") this.reset();
    else if (event.key === "f") this.fit();
    else return false;
    return true;
  }

  dispose() {
    this.controls.dispose();
  }

  /** @param {THREE.Vector3} target @param {THREE.Vector3} away */
  #stand(target, away) {
    const far = away.length();
    this.camera.near = far / 200;
    this.camera.far = far * 50;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(target);
    this.camera.position.copy(target).add(away);
    this.controls.update();
  }

  /** How far away every corner of the box is in view. @param {THREE.Vector3} from @param {THREE.Vector3} target */
  #distance(from, target) {
    const right = new THREE.Vector3().crossVectors(this.camera.up, from).normalize();
    const up = new THREE.Vector3().crossVectors(from, right);
    const high = Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2)) * 0.92;
    let distance = 0.01;
    for (const x of [this.bounds.min.x, this.bounds.max.x])
      for (const y of [this.bounds.min.y, this.bounds.max.y])
        for (const z of [this.bounds.min.z, this.bounds.max.z]) {
          const corner = new THREE.Vector3(x, y, z).sub(target);
          const aside = Math.max(Math.abs(corner.dot(right)) / this.camera.aspect, Math.abs(corner.dot(up)));
          distance = Math.max(distance, aside / high + corner.dot(from));
        }
    return distance;
  }

  /** @param {number} x @param {number} y */
  #orbit(x, y) {
    const away = this.camera.position.clone().sub(this.controls.target);
    away.applyAxisAngle(this.camera.up, x * KEY_STEP);
    const flat = Math.hypot(away.x, away.y);
    const angle = Math.min(Math.max(Math.atan2(away.z, flat) - y * KEY_STEP, -1.45), 1.5);
    const length = away.length();
    const scale = (length * Math.cos(angle)) / Math.max(flat, 1e-9);
    away.set(away.x * scale, away.y * scale, length * Math.sin(angle));
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
  }

  /** @param {number} x @param {number} y */
  #pan(x, y) {
    const step = this.camera.position.distanceTo(this.controls.target) * 0.05;
    const way = new THREE.Vector3(x, -y, 0).multiplyScalar(step).applyQuaternion(this.camera.quaternion);
    this.controls.target.add(way);
    this.camera.position.add(way);
    this.controls.update();
  }

  /** @param {number} factor */
  #zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
  }
}
