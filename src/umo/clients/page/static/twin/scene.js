/** The bodies of a twin in three.js: built from the station's declaration, moved by its values. */

import * as THREE from "three";
import { loadsAt } from "./loads.js";

/**
 * @typedef {Page.TwinSample} Sample
 * @typedef {THREE.Mesh<THREE.BufferGeometry, THREE.MeshLambertMaterial>} Mesh
 * @typedef {Page.Carried & {node: THREE.Group, meshes: Mesh[], shown: [number, number][]}} Carried
 * @typedef {{path: string, node: THREE.Group, move: (value: number) => void}} Joint
 * @typedef {{name: string, parent: string, told: Page.Body, base: THREE.Group, node: THREE.Group, meshes: Mesh[],
 *   joints: Joint[], carried: Carried[], poor: boolean, visible: Page.Body["visible"],
 *   colours: {path: string, show: (value: number) => void}[], fade: (poor: boolean) => void}} Body
 * @typedef {{times: Float64Array, columns: Map<string, ArrayLike<number>>, now: number}} Past  Of the loads on belts.
 */

const GHOST = 0.35;

export class TwinScene {
  /** @param {Page.Twin} description of the twin, as the server gives it */
  constructor(description) {
    this.description = description;
    this.root = new THREE.Group();
    this.entries = new Map(description.paths.map((entry) => [entry.path, entry]));
    /** @type {Map<string, THREE.BufferGeometry>} */
    this.geometries = new Map();
    /** @type {Map<string, THREE.MeshLambertMaterial>} */
    this.materials = new Map();
    /** @type {Body[]} */
    this.bodies = description.bodies.map((body) => this.#body(body));
    this.byName = new Map(this.bodies.map((body) => [body.name, body]));
    for (const body of this.bodies) (this.byName.get(body.parent)?.node ?? this.root).add(body.base);
    this.root.updateMatrixWorld(true);
  }

  /** Paths of the values that `update` asks for. */
  get paths() {
    return this.description.paths.map((entry) => entry.path);
  }

  /** Move everything. Without a value a body stays as it was.
   * @param {(path: string) => Sample | null} sample
   * @param {Past | null} past */
  update(sample, past = null) {
    for (const body of this.bodies) {
      let poor = false;
      for (const joint of body.joints) {
        const found = sample(joint.path);
        poor ||= !found || found.quality > 0 || Boolean(found.last);
        if (found && Number.isFinite(found.value)) joint.move(found.value);
      }
      for (const colour of body.colours) {
        const found = sample(colour.path);
        if (found && Number.isFinite(found.value)) colour.show(found.value);
      }
      body.node.visible = body.visible.every(({ path, level }) => sample(path)?.value === level);
      if (body.joints.length && poor !== body.poor) body.fade((body.poor = poor));
      if (past) for (const load of body.carried) this.#showLoads(load, past);
    }
    this.root.updateMatrixWorld(true);
  }

  /** The values that joints are moved by and that are not good, with the quality of each; no value: 4.
   * @param {(path: string) => Sample | null} sample @returns {Map<string, number>} */
  poor(sample) {
    /** @type {Map<string, number>} */
    const found = new Map();
    for (const { joints } of this.bodies) for (const { path } of joints) {
      const quality = sample(path)?.quality ?? 4;
      if (quality > 0) found.set(path, quality);
    }
    return found;
  }

  /** Where a body's origin is in the world, m, and its rotation (w, x, y, z). For tests. @param {string} name */
  pose(name) {
    const { node } = this.#named(name);
    const at = node.getWorldPosition(new THREE.Vector3());
    const q = node.getWorldQuaternion(new THREE.Quaternion());
    return { position: at.toArray(), rotation: [q.w, q.x, q.y, q.z] };
  }

  /** Fronts and rears of the loads that a body carries now, m. For tests. @param {string} name */
  loads(name) {
    return this.#named(name).carried.flatMap((load) => load.shown);
  }

  /** @param {string} name */
  #named(name) {
    const body = this.byName.get(name);
    if (!body) throw new Error(`no body ${name}`);
    return body;
  }

  /** What is drawn of it, as a box. */
  bounds() {
    return new THREE.Box3().setFromObject(this.root);
  }

  dispose() {
    for (const each of [...this.geometries.values(), ...this.materials.values()]) each.dispose();
    for (const body of this.bodies) for (const mesh of body.meshes) mesh.material.dispose();
  }

  /** @param {Page.Body} told @returns {Body} */
  #body(told) {
    const base = new THREE.Group();
    place(base, told);
    let node = base;
    const joints = told.joints.map((joint) => {
      const linked = makeJoint(joint, node);
      node = linked.node;
      return linked;
    });
    const driven = told.joints.length + told.colours.length > 0;
    const meshes = told.shapes.map((shape) => this.#mesh(shape, driven));
    if (meshes.length) node.add(...meshes);
    const carried = told.carried.map((load) => ({ ...load, node, meshes: [], shown: [] }));
    const colours = told.colours.map((colour) => makeColour(colour, meshes));
    const fade = (/** @type {boolean} */ poor) => meshes.forEach((mesh, i) => opaque(mesh.material, poor ? GHOST : told.shapes[i].opacity));
    const body = { name: told.name, parent: told.parent, told, base, node, meshes, joints, carried, poor: false, visible: told.visible, colours, fade };
    for (const mesh of meshes) mesh.userData.body = body;
    return body;
  }

  /** @param {Page.Shape} shape @param {boolean} own  Whether its material is its own. */
  #mesh(shape, own) {
    const key = JSON.stringify([shape.kind, shape.size, shape.kind === "mesh" ? [shape.vertices, shape.faces] : 0]);
    const mesh = new THREE.Mesh(this.#kept(key, () => geometry(shape)), own ? material(shape) : this.#shared(shape));
    if (shape.kind === "ellipsoid") mesh.scale.fromArray(shape.size);
    place(mesh, shape);
    return mesh;
  }

  /** @param {string} key @param {() => THREE.BufferGeometry} make */
  #kept(key, make) {
    const found = this.geometries.get(key) ?? make();
    this.geometries.set(key, found);
    return found;
  }

  /** @param {{colour: string, opacity: number}} shape */
  #shared(shape) {
    const key = `${shape.colour} ${shape.opacity}`;
    const found = this.materials.get(key) ?? material(shape);
    this.materials.set(key, found);
    return found;
  }

  /** @param {Carried} load @param {Past} past */
  #showLoads(load, past) {
    load.shown = loadsAt(load, past.times, past.columns.get(load.sensor) ?? [], past.columns.get(load.speed) ?? [], past.now);
    while (load.meshes.length < load.shown.length) {
      const mesh = new THREE.Mesh(this.#kept("unit", () => new THREE.BoxGeometry()), this.#shared({ colour: load.colour, opacity: 1 }));
      load.meshes.push(mesh);
      load.node.add(mesh);
    }
    load.meshes.forEach((mesh, i) => {
      mesh.visible = i < load.shown.length;
      if (!mesh.visible) return;
      const [front, rear] = load.shown[i];
      mesh.scale.set(Math.max(front - rear, 1e-4), load.size[0], load.size[1]);
      mesh.position.set((front + rear) / 2, 0, load.size[1] / 2);
    });
  }
}

/** @param {THREE.Object3D} object @param {{position: [number, number, number], rotation: [number, number, number, number]}} where */
function place(object, { position, rotation: [w, x, y, z] }) {
  object.position.set(...position);
  object.quaternion.set(x, y, z, w).normalize();
}

/** A joint: the group below which everything moves, and the motion from the object's value. @param {Page.Joint} joint @param {THREE.Group} parent @returns {Joint} */
function makeJoint({ kind, path, axis, factor, offset, range, anchor }, parent) {
  const along = new THREE.Vector3(...axis);
  const moved = new THREE.Group();
  parent.add(moved);
  let node = moved;
  if (kind === "hinge") {
    moved.position.set(...anchor);
    node = new THREE.Group();
    node.position.set(...anchor).negate();
    moved.add(node);
  }
  const move = (/** @type {number} */ value) => {
    let q = factor * value + offset;
    if (range) q = Math.min(Math.max(q, range[0]), range[1]);
    if (kind === "hinge") moved.quaternion.setFromAxisAngle(along, q);
    else moved.position.copy(along).multiplyScalar(q);
  };
  return { path, node, move };
}

/** @param {Page.Colour} colour @param {Mesh[]} meshes */
function makeColour({ path, stops, shape }, meshes) {
  const painted = shape === null ? meshes : [meshes[shape]];
  const colours = stops.map(([at, colour]) => ({ at, colour: new THREE.Color(colour) }));
  const mixed = new THREE.Color();
  const show = (/** @type {number} */ value) => {
    const next = colours.findIndex(({ at }) => at >= value);
    const high = colours[next < 0 ? colours.length - 1 : next];
    const low = colours[next < 0 ? colours.length - 1 : Math.max(next - 1, 0)];
    mixed.lerpColors(low.colour, high.colour, high.at > low.at ? (value - low.at) / (high.at - low.at) : 0);
    for (const mesh of painted) mesh.material.color.copy(mixed);
  };
  return { path, show };
}

/** @param {Page.Shape} shape @returns {THREE.BufferGeometry} */
function geometry({ kind, size, vertices, faces }) {
  if (kind === "box") return new THREE.BoxGeometry(size[0], size[1], size[2]);
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], 24, 16);
  if (kind === "ellipsoid") return new THREE.SphereGeometry(0.5, 24, 16);
  if (kind === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2);
  if (kind === "capsule") return new THREE.CapsuleGeometry(size[0], size[1], 8, 24).rotateX(Math.PI / 2);
  const indexed = new THREE.BufferGeometry();
  indexed.setAttribute("position", new THREE.Float32BufferAttribute(vertices, 3));
  indexed.setIndex(faces);
  const flat = indexed.toNonIndexed();
  flat.computeVertexNormals();
  indexed.dispose();
  return flat;
}

/** @param {{colour: string, opacity: number}} shape */
function material({ colour, opacity }) {
  const surface = new THREE.MeshLambertMaterial({ color: colour });
  opaque(surface, opacity);
  return surface;
}

/** @param {THREE.Material} surface @param {number} opacity */
function opaque(surface, opacity) {
  surface.opacity = opacity;
  surface.transparent = opacity < 1;
  surface.depthWrite = opacity === 1;
  surface.needsUpdate = true;
}
