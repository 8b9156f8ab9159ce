/** The bodies of a twin in three.js: built from the station's declaration, moved by its values. */

import * as THREE from "three";
import { loadsAt } from "./loads.js";

/** @typedef {{value: number, quality: number}} Sample  quality as in frames: 0 good ... 4 bad */

const GHOST = 0.35;

export class TwinScene {
  /** @param {object} description of the twin, as the server gives it */
  constructor(description) {
    this.description = description;
    this.root = new THREE.Group();
    this.entries = new Map(description.paths.map((entry) => [entry.path, entry]));
    this.geometries = new Map();
    this.materials = new Map();
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
   * @param {{times: Float64Array, columns: Map<string, Float64Array>, now: number} | null} past of the loads on belts */
  update(sample, past = null) {
    for (const body of this.bodies) {
      let poor = false;
      for (const joint of body.joints) {
        const found = sample(joint.path);
        poor ||= !found || found.quality > 0;
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
    const joints = this.bodies.flatMap((body) => body.joints.map(({ path }) => [path, sample(path)?.quality ?? 4]));
    return new Map(joints.filter(([, quality]) => quality > 0));
  }

  /** Where a body's origin is in the world, m, and its rotation (w, x, y, z). For tests. */
  pose(name) {
    const { node } = this.byName.get(name);
    const at = node.getWorldPosition(new THREE.Vector3());
    const q = node.getWorldQuaternion(new THREE.Quaternion());
    return { position: at.toArray(), rotation: [q.w, q.x, q.y, q.z] };
  }

  /** Fronts and rears of the loads that a body carries now, m. For tests. */
  loads(name) {
    return this.byName.get(name).carried.flatMap((load) => load.shown);
  }

  /** What is drawn of it, as a box. */
  bounds() {
    return new THREE.Box3().setFromObject(this.root);
  }

  dispose() {
    for (const each of [...this.geometries.values(), ...this.materials.values()]) each.dispose();
    for (const body of this.bodies) for (const mesh of body.meshes) mesh.material.dispose();
  }

  #body(told) {
    const base = new THREE.Group();
    place(base, told);
    let node = base;
    const joints = told.joints.map((joint) => {
      const made = makeJoint(joint, node);
      node = made.node;
      return made;
    });
    const driven = told.joints.length + told.colours.length > 0;
    const meshes = told.shapes.map((shape) => this.#mesh(shape, driven));
    if (meshes.length) node.add(...meshes);
    const carried = told.carried.map((load) => ({ ...load, node, meshes: [], shown: [] }));
    const body = { name: told.name, parent: told.parent, told, base, node, meshes, joints, carried, poor: false };
    for (const mesh of meshes) mesh.userData.body = body;
    body.visible = told.visible;
    body.colours = told.colours.map((colour) => makeColour(colour, meshes));
    body.fade = (poor) => meshes.forEach((mesh, i) => opaque(mesh.material, poor ? GHOST : told.shapes[i].opacity));
    return body;
  }

  #mesh(shape, own) {
    const key = JSON.stringify([shape.kind, shape.size, shape.kind === "mesh" ? [shape.vertices, shape.faces] : 0]);
    if (!this.geometries.has(key)) this.geometries.set(key, geometry(shape));
    const mesh = new THREE.Mesh(this.geometries.get(key), own ? material(shape) : this.#shared(shape));
    if (shape.kind === "ellipsoid") mesh.scale.set(...shape.size);
    place(mesh, shape);
    return mesh;
  }

  #shared(shape) {
    const key = `${shape.colour} ${shape.opacity}`;
    if (!this.materials.has(key)) this.materials.set(key, material(shape));
    return this.materials.get(key);
  }

  #showLoads(load, past) {
    load.shown = loadsAt(load, past.times, past.columns.get(load.sensor), past.columns.get(load.speed), past.now);
    while (load.meshes.length < load.shown.length) {
      const mesh = new THREE.Mesh(this.#unitBox(), this.#shared({ colour: load.colour, opacity: 1 }));
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

  #unitBox() {
    if (!this.geometries.has("unit")) this.geometries.set("unit", new THREE.BoxGeometry());
    return this.geometries.get("unit");
  }
}

function place(object, { position, rotation: [w, x, y, z] }) {
  object.position.set(...position);
  object.quaternion.set(x, y, z, w).normalize();
}

/** A joint: the group below which everything moves, and the motion from the object's value. */
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
  const move = (value) => {
    let q = factor * value + offset;
    if (range) q = Math.min(Math.max(q, range[0]), range[1]);
    if (kind === "hinge") moved.quaternion.setFromAxisAngle(along, q);
    else moved.position.copy(along).multiplyScalar(q);
  };
  return { path, node, move };
}

function makeColour({ path, stops, shape }, meshes) {
  const painted = shape === null ? meshes : [meshes[shape]];
  const colours = stops.map(([at, colour]) => [at, new THREE.Color(colour)]);
  const mixed = new THREE.Color();
  const show = (value) => {
    const next = colours.findIndex(([at]) => at >= value);
    const [high, above] = colours.at(next);
    const [low, below] = colours[next < 0 ? colours.length - 1 : Math.max(next - 1, 0)];
    mixed.lerpColors(below, above, high > low ? (value - low) / (high - low) : 0);
    for (const mesh of painted) mesh.material.color.copy(mixed);
  };
  return { path, show };
}

function geometry({ kind, size, vertices, faces }) {
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], 24, 16);
  if (kind === "ellipsoid") return new THREE.SphereGeometry(0.5, 24, 16);
  if (kind === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2);
  if (kind === "capsule") return new THREE.CapsuleGeometry(size[0], size[1], 8, 24).rotateX(Math.PI / 2);
  const made = new THREE.BufferGeometry();
  made.setAttribute("position", new THREE.Float32BufferAttribute(vertices, 3));
  made.setIndex(faces);
  const flat = made.toNonIndexed();
  flat.computeVertexNormals();
  made.dispose();
  return flat;
}

function material({ colour, opacity }) {
  const made = new THREE.MeshLambertMaterial({ color: colour });
  opaque(made, opacity);
  return made;
}

function opaque(made, opacity) {
  made.opacity = opacity;
  made.transparent = opacity < 1;
  made.depthWrite = opacity === 1;
  made.needsUpdate = true;
}
