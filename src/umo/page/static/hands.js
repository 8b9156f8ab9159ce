/** Hands: the lease, the mode, and the controls of every part of the machine. */

import { ActionControl, ActuatorControl, JogControl, SensorControl, TunableControl } from "./controls.js";
import { address, el, setText, store } from "./dom.js";
import { words } from "./hand.js";

const OPEN = 12;  // parts up to which all are unfolded; else the first one is
const ANSWERS = 6;  // that are shown
const MODES = ["automatic", "manual"];

let hands = null;

export function mount(element, feed, hand) { hands = new Hands(element, feed, hand); }

export function unmount() {
  hands?.close();
  hands = null;
}

class Hands {
  constructor(element, feed, hand) {
    this.feed = feed;
    this.hand = hand;
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._answers = el("ol", { className: "answers", "aria-live": "polite", "aria-label": "Commands and answers" });
    this._parts = parts(feed.description).map((part) => new Part(part, feed, hand));
    element.append(el("div", { className: "bar lease" }, ...this._lease(), ...this._modes(), this._filter),
      this._why = el("p", { className: "hint" }), this._answers,
      el("div", { className: "parts" }, ...this._parts.map((part) => part.element)));
    for (const [number, part] of this._parts.entries()) part.open = number === 0 || this._parts.length <= OPEN;
    this._off = hand.on(() => this._refresh());  // after each state too
    this._filtered();
    this._refresh();
  }

  _lease() {
    this._holder = el("span", { className: "holder" });
    this._name = el("input", { type: "text", placeholder: "Your name", maxLength: 40, "aria-label": "Your name", value: store.get("name"), onchange: () => store.set("name", this._name.value) });
    this._take = el("button", { onclick: () => this._taken() });
    this._give = el("button", { textContent: "Give the lease back", onclick: () => this.hand.giveBack() });
    return [this._holder, this._name, this._take, this._give];
  }

  /** Taking over from another hand needs a second click. */
  _taken() {
    const { holder } = this.hand;
    if (holder && this._sure !== holder) {
      this._sure = holder;
      return this._refresh();
    }
    this._sure = null;
    return this.hand.take(this._name.value, Boolean(holder));
  }

  _modes() {
    this._mode = MODES.map((mode) => el("button", { textContent: mode, "data-mode": mode, onclick: () => this.hand.ask({ do: "mode", value: mode }, `mode ${mode}`) }));
    return [el("span", { className: "modes", role: "group", "aria-label": "Mode" }, ...this._mode)];
  }

  _filtered() {
    const wanted = this._filter.value.trim().toLowerCase();
    address.set({ filter: wanted });
    for (const part of this._parts) part.filter(wanted);
  }

  _refresh() {
    if (!this.feed.state) return;
    const { hand } = this;
    const ended = this.feed.state.stage === "ended";
    setText(this._holder, ended ? `${this.feed.station} has ended.` : hand.leased ? "You have the lease." : hand.holder ? `${hand.holder} has the lease.` : "Nobody has the lease.");
    setText(this._take, !hand.holder ? "Take the lease" : this._sure === hand.holder ? `Yes, take it over from ${hand.holder}` : "Take it over");
    this._take.hidden = this._name.hidden = hand.leased || !hand.possible || ended;
    this._give.hidden = !hand.leased;
    for (const button of this._mode) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === this.feed.state.mode));
      button.disabled = !hand.leased;
    }
    setText(this._why, why(this.feed, hand));
    this._why.hidden = !this._why.textContent;
    this._show();
    for (const part of this._parts) part.refresh();
  }

  /** The last commands of this page, the newest first. */
  _show() {
    const shown = this.hand.asked.slice(0, ANSWERS);
    const text = shown.map(words).join("\n");
    if (text === this._shown) return;
    this._shown = text;
    this._answers.replaceChildren(...shown.map((each) => el("li", { "data-state": each.state, textContent: words(each) })));
  }

  close() {
    this.hand.letGoOfJogs();
    this._off();
  }
}

/** What keeps the controls from being used. */
function why(feed, hand) {
  if (!feed.server?.hands) return "This page is read-only. `umo view --hands` lets it command.";
  if (!feed.state.mode) return `${feed.station} takes no commands.`;
  if (!hand.leased) return "The controls need the lease.";
  return hand.manual ? "" : "Automatic mode: numbers can be tuned, and actions called that are harmless beside the application.";
}

/** The parts of a machine: its compounds, each with what can be done there. */
function parts({ station, objects, actions, tunables }) {
  const found = new Map();
  const at = (path) => {
    const parent = path.includes(".") ? path.slice(0, path.lastIndexOf(".")) : "";
    if (!found.has(parent)) found.set(parent, { path: parent, title: parent || station, objects: [], actions: [], tunables: [] });
    return found.get(parent);
  };
  at("");
  for (const entry of objects) at(entry.path).objects.push(entry);
  for (const entry of actions) at(entry.path).actions.push(entry);
  const nodes = new Set([...objects, ...actions].flatMap(({ path }) => path.split(".").slice(0, -1).map((_, i, names) => names.slice(0, i + 1).join("."))));
  for (const entry of tunables) {  // a law's number stands with the part that has the law
    const names = entry.path.split(".");
    let count = names.length - 1;
    while (count > 0 && !nodes.has(names.slice(0, count).join("."))) count -= 1;
    const name = names.slice(count).join(".");
    at([...names.slice(0, count), ""].join(".")).tunables.push({ ...entry, name });
  }
  const useful = ({ objects: all, actions: calls, tunables: numbers }) => calls.length || numbers.length || all.some(isActuator);
  return [...found.values()].filter(useful);
}

const isActuator = ({ actuator }) => Boolean(actuator);

/** A part: filled when it is unfolded for the first time. */
class Part {
  constructor(part, feed, hand) {
    this._part = part;
    this._feed = feed;
    this._hand = hand;
    this._controls = null;
    this.element = el("details", { className: "part", "data-part": part.path }, el("summary", { textContent: part.title }));
    this.element.ontoggle = () => this.refresh();
  }

  set open(open) { this.element.open = open; }

  filter(wanted) {
    const { path, objects, actions, tunables } = this._part;
    const paths = [path, ...[...objects, ...actions, ...tunables].map((each) => each.path)];
    this.element.hidden = !paths.some((each) => each.toLowerCase().includes(wanted));
  }

  _fill() {
    const { objects, actions, tunables } = this._part;
    const hold = actions.filter((action) => action.kept_up);
    const plain = actions.filter((action) => !action.kept_up);
    const sections = {
      "": objects.filter((entry) => !isActuator(entry) && entry.unit !== "sampling_period").map((entry) => new SensorControl(entry)),
      Actions: [...hold.map((action) => new JogControl(this._hand, action)), ...plain.map((action) => new ActionControl(this._hand, action))],
      Actuators: objects.filter(isActuator).map((entry) => new ActuatorControl(this._hand, entry)),
      "Tunable numbers": tunables.map((entry) => new TunableControl(this._hand, entry)),
    };
    this._controls = Object.values(sections).flat();
    for (const [title, controls] of Object.entries(sections)) {
      if (title && controls.length) this.element.append(el("h3", { textContent: title }));
      this.element.append(...controls.map(({ element }) => element));
    }
  }

  refresh() {
    if (!this.element.open || this.element.hidden || !this._feed.state) return;
    if (!this._controls) this._fill();
    for (const control of this._controls) control.refresh(this._feed);
  }
}
