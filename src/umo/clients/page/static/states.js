/** The states of a part: its state in large letters, its commands, the diagram, and the counts of products. */

import { CallLine } from "./calls.js";
import { ActionControl } from "./controls.js";
import { el, setText } from "./dom.js";
import { inSentence, numberText, readable, valueText } from "./presentation.js";
import { UnitCommand, inManual } from "./unit_command.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const SVG = "http://www.w3.org/2000/svg";
const COLUMN = 112;  // px from one state of the diagram to the next
const ROW = 58;
const WIDTH = 96;
const HEIGHT = 34;
const WAYS_LEFT_OUT = ["stop", "abort"];  // they lead away from nearly every state
const COUNTERS = ["produced", "rejected"];
const OWN = ["state", "mode"];  // named values that have a place of their own

/** @param {string} tag @param {Record<string, string | number>} attributes @param {(Node | string)[]} children @returns {SVGElement} */
function svg(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** @param {[number, number]} place */
const middle = ([column, row]) => [column * COLUMN + WIDTH / 2 + 4, row * ROW + HEIGHT / 2 + 4];

/** The diagram of a state machine; the present state is marked. */
class Diagram {
  /** @param {Page.Unit} unit */
  constructor(unit) {
    /** @type {Map<string, SVGElement>} */
    this._boxes = new Map();
    const places = Object.values(unit.places);
    const [columns, rows] = [0, 1].map((axis) => Math.max(...places.map((place) => place[axis])) + 1);
    const [width, height] = [columns * COLUMN - COLUMN + WIDTH + 8, rows * ROW - ROW + HEIGHT + 8];
    const named = Object.entries(unit.commands).filter(([name]) => !WAYS_LEFT_OUT.includes(name)).flatMap(([, targets]) => Object.entries(targets));
    const ways = [...Object.entries(unit.acting), ...named].map(([from, to]) => this._way(unit.places[from], unit.places[String(to)]));
    const boxes = Object.entries(unit.places).map(([number, place]) => this._box(unit, number, place));
    this.element = svg("svg", { class: "diagram", viewBox: `0 0 ${width} ${height}`, role: "img" }, ...ways, ...boxes);
  }

  /** @param {[number, number]} from @param {[number, number]} to */
  _way(from, to) {
    const [[x1, y1], [x2, y2]] = [middle(from), middle(to)];
    return svg("line", { x1, y1, x2, y2, class: "way" });
  }

  /** @param {Page.Unit} unit @param {string} number @param {[number, number]} place */
  _box(unit, number, place) {
    const [x, y] = middle(place);
    const kind = number in unit.acting ? "acting" : "waiting";
    const box = svg("g", { class: `state ${kind}` },
      svg("rect", { x: x - WIDTH / 2, y: y - HEIGHT / 2, width: WIDTH, height: HEIGHT, rx: kind === "acting" ? 4 : HEIGHT / 2 }),
      svg("text", { x, y: y + 4.5, "text-anchor": "middle" }, unit.states[number]));
    this._boxes.set(number, box);
    return box;
  }

  /** @param {string} number @param {string} name */
  show(number, name) {
    for (const [each, box] of this._boxes) box.classList.toggle("now", each === number);
    this.element.setAttribute("aria-label", `state ${name}`);
  }
}

/** One state machine: what an operator needs of it. */
export class StatesPanel {
  /** @param {Page.Unit} unit @param {Feed} feed @param {Client} client */
  constructor(unit, feed, client) {
    this._unit = unit;
    this._client = client;
    const actions = (feed.description?.actions ?? []).filter(({ path }) => path.startsWith(`${unit.path}.`));
    const named = new Map(actions.map((action) => [action.path.slice(unit.path.length + 1), action]));
    const title = unit.part || (feed.description?.station ?? "");
    this._commands = Object.keys(unit.commands).map((name) => new UnitCommand(client, unit, name, title, named.get(name)));
    this._others = actions.filter(({ path }) => !(path.slice(unit.path.length + 1) in unit.commands)).map((action) => new ActionControl(client, action));
    this._state = el("output", { className: "state-name" });
    this._counts = el("span", { className: "counts" });
    this._reason = el("p", { className: "reasons" });
    this._barrier = el("p", { className: "barrier" });
    this._line = new CallLine("", Object.keys(unit.commands).map((each) => `${unit.path}.${each}`), { named: true });
    this._named = (feed.description?.signals ?? []).filter(({ path, states }) => states && path.startsWith(`${unit.path}.`) && !OWN.includes(path.slice(unit.path.length + 1)));
    this._diagram = new Diagram(unit);
    const [usual, apart] = [false, true].map((wanted) => this._commands.filter((each) => each.apart === wanted).map(({ element }) => element));
    this.element = el("section", { className: "part states", "data-states": unit.path, "aria-label": readable(title) },
      el("h3", { textContent: readable(title), title: unit.path }),
      el("div", { className: "state-head" }, this._state, this._counts),
      this._reason,
      el("div", { className: "commands", role: "group", "aria-label": `Commands of ${inSentence(title)}` }, ...usual, el("span", { className: "apart" }, ...apart)),
      this._barrier,
      this._line.element,
      this._diagram.element,
      el("details", {}, el("summary", { textContent: "Mode and counters of the part" }), ...this._others.map(({ element }) => element)));
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const { path, part, states } = this._unit;
    const value = feed.latest(`${path}.state`)?.value ?? null;
    const number = value === null ? "" : String(value);
    const name = states[number] ?? "unknown";
    setText(this._state, name);
    this._state.dataset.state = name;
    const fault = feed.state?.faults?.[part] ?? "";
    setText(this._reason, fault && `✖ in fault: ${fault}`);
    this._reason.title = fault;
    const counts = COUNTERS.map((each) => `${numberText(feed.latest(`${path}.${each}`)?.value)} ${each}`);
    const named = this._named.map((entry) => `${inSentence(entry.path.slice(path.length + 1))} ${valueText(entry, feed.latest(entry.path)?.value)}`);
    setText(this._counts, [...(feed.ended ? ["last values"] : []), ...named, ...counts].join(", "));
    this._line.refresh(feed, this._client);
    this._diagram.show(number, name);
    setText(this._barrier, this._client.barrier() || (this._client.manual ? inManual(this._unit) : ""));
    for (const each of this._commands) each.refresh(number);
    for (const each of this._others) each.refresh(feed);
  }
}
