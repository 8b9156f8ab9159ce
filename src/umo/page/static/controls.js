/** Controls made from the declarations: actuators, actions, jogs, tunable numbers. */

import { el, isBinary, setText, shortNumber, shown, unitOf } from "./dom.js";

const SLIDER = 500;  // steps
const OFTEN = 100;  // ms between two values of a slider that is moved
const LET_GO = ["pointerup", "pointercancel", "keyup"];  // end a jog wherever they happen: its button may be gone
const JOG = 0.1;  // of the range: the first value of a jog

const name = (path) => path.slice(path.lastIndexOf(".") + 1);
const bounded = (about) => Number.isFinite(about.minimum) && Number.isFinite(about.maximum);
const plain = (value) => shortNumber(value).replace(/\.0$/, "");
const span = (about) => (bounded(about) ? `${plain(about.minimum)} to ${plain(about.maximum)}` : "");
const sentence = (text) => text.split(/(?<=\.) /)[0].replaceAll("`", "");

/** A number field; what is outside of the range is refused by the machine, in its words. */
function field(about, label, value = "", placeholder = span(about).replace(" to ", "…")) {
  return el("input", { type: "number", step: "any", value, placeholder, title: [span(about), about.unit].filter(Boolean).join(" "), "aria-label": label });
}

/** An input with the name and the unit of what it gives. */
const labelled = (about, input) => el("label", {}, `${about.name} `, input, about.unit && el("span", { className: "unit", textContent: about.unit }));

/** A slider over the range of a number; null if it has no range. */
function slider(about, label, listeners) {
  if (!bounded(about)) return null;
  const step = (about.maximum - about.minimum) / SLIDER || "any";
  return el("input", { type: "range", min: about.minimum, max: about.maximum, step, "aria-label": `${label}, slider`, ...listeners });
}

/** A slider between the ends of its range. */
const between = (about, input) => input && el("div", { className: "range" }, el("small", { textContent: plain(about.minimum) }), input, el("small", { textContent: plain(about.maximum) }));

const isBusy = (input) => input && document.activeElement === input;

/** One actuator: named states, or a slider and a field; kept up until it is released. */
export class ActuatorControl {
  constructor(hand, entry) {
    this._hand = hand;
    this._entry = entry;
    this.path = entry.path;
    this._value = el("output", {});
    this._release = el("button", { textContent: "Release", type: "button", title: "Send the default; the program may write it again", onclick: () => this._letGo() });
    this._inputs = isBinary(entry) ? this._states() : this._numbers();
    this._reason = el("small", { className: "reason" });
    this.element = el("form", { className: "control actuator", "data-control": entry.path, noValidate: true, onsubmit: (event) => this._submitted(event) },
      el("span", { className: "label", textContent: name(entry.path) }), this._value,
      ...this._inputs.filter((input) => input !== this._slider), this._release, between(entry, this._slider), this._reason);
  }

  _states() {
    const states = [this._entry.zero, this._entry.one];
    return states.map((state) => el("button", { textContent: state, type: "button", "data-state": state, "aria-pressed": "false", onclick: () => this._write(state) }));
  }

  _numbers() {
    this._field = field(this._entry, this.path);
    this._slider = slider(this._entry, this.path, { oninput: () => this._moved() });
    return [this._field, el("button", { textContent: "Set", type: "submit" }), this._slider].filter(Boolean);
  }

  _submitted(event) {
    event.preventDefault();
    if (this._field && this._field.value !== "") this._write(Number(this._field.value));
  }

  /** The slider is moved: its newest value every `OFTEN` ms. */
  _moved() {
    this._field.value = shortNumber(Number(this._slider.value));
    this._timer ??= setTimeout(() => {
      this._timer = null;
      if (this._hand.leased && this.element.isConnected) this._write(Number(this._slider.value));
    }, OFTEN);
  }

  async _write(value) {
    const before = this._hand.holds(this.path);
    this._hand.hold(this.path);
    const answer = await this._hand.ask({ do: "write", path: this.path, value }, `${this.path} = ${value}`);
    if (answer.state !== "done" && !before) this._hand.letGo(this.path);
  }

  _letGo() {
    clearTimeout(this._timer);
    this._timer = null;
    this._hand.letGo(this.path);
    this._hand.ask({ do: "let go", path: this.path }, `release ${this.path}`);
  }

  refresh(feed) {
    const value = feed.latest(this.path)?.value ?? null;
    if (!isBinary(this._entry)) setText(this._value, shown(this._entry, value));  // the pressed button is the state
    const reason = feed.state.inhibited?.[this.path] ?? "";
    setText(this._reason, reason);
    const enabled = this._hand.leased && this._hand.manual;
    for (const input of this._inputs) input.disabled = !enabled;
    this._release.disabled = !(enabled && this._hand.holds(this.path));
    for (const button of this.element.querySelectorAll("[data-state]")) {
      const on = value !== null && button.dataset.state === (value > 0.5 ? this._entry.one : this._entry.zero);
      button.setAttribute("aria-pressed", String(on));
    }
    if (value === null || isBinary(this._entry) || this._timer) return;
    if (this._slider && !isBusy(this._slider)) this._slider.value = value;
    if (!isBusy(this._field) && !isBusy(this._slider)) this._field.value = plain(value);
  }
}

/** One input for each argument of an action. */
class Arguments {
  constructor(action, only = () => true) {
    this._inputs = new Map(action.arguments.filter(only).map((about) => [about, this._input(action, about)]));
    this.elements = [...this._inputs].map(([about, input]) => labelled(about, input));
    this.all = [...this._inputs.values()];
  }

  _input(action, about) {
    const label = `${action.path} ${about.name}`;
    const value = about.default ?? "";
    if (about.kind === "choice") return el("select", { "aria-label": label }, ...about.choices.map((choice) => el("option", { textContent: choice, selected: choice === value })));
    if (about.kind === "bool") return el("input", { type: "checkbox", checked: Boolean(value), "aria-label": label });
    if (about.kind === "text") return el("input", { type: "text", value, "aria-label": label });
    return field(about, label, value);
  }

  /** What is given; an empty field is not. */
  values() {
    const given = {};
    for (const [about, input] of this._inputs) {
      if (about.default !== undefined && input.value === String(about.default)) continue;
      if (about.kind === "bool") given[about.name] = input.checked;
      else if (input.value !== "" || (about.kind === "text" && about.required)) {
        given[about.name] = about.kind === "number" || about.kind === "integer" ? Number(input.value) : input.value;
      }
    }
    return given;
  }
}

/** An action that is called: its button, its arguments, and a way to cancel it while it runs. */
export class ActionControl {
  constructor(hand, action) {
    this._hand = hand;
    this._action = action;
    this._arguments = new Arguments(action);
    this._call = el("button", { textContent: name(action.path), title: action.help, type: "submit" });
    this._cancel = el("button", { textContent: "Cancel", type: "button", hidden: true, onclick: () => hand.ask({ do: "cancel", path: action.path }) });
    this.element = el("form", { className: "control action", "data-control": action.path, noValidate: true, onsubmit: (event) => this._submitted(event) },
      this._call, ...this._arguments.elements, this._cancel, el("small", { textContent: sentence(action.help), title: action.help }));
  }

  _submitted(event) {
    event.preventDefault();
    const given = this._arguments.values();
    const words = Object.entries(given).map(([key, value]) => `${key}=${value}`);
    this._hand.ask({ do: "call", path: this._action.path, arguments: given }, [this._action.path, ...words].join(" "));
  }

  refresh() {
    const enabled = this._hand.allows(this._action);
    for (const input of [this._call, ...this._arguments.all]) input.disabled = !enabled;
    const begun = this._hand.asked.some(({ path, state }) => path === this._action.path && state === "begun");
    this._cancel.hidden = !begun;
    this._cancel.disabled = !this._hand.leased;
  }
}

/** An action that lasts while its button is held. With a range on both sides of 0: one button for each direction. */
export class JogControl {
  constructor(hand, action) {
    this._hand = hand;
    this._action = action;
    this._about = action.arguments.find(({ kind }) => kind === "number") ?? null;
    this._others = new Arguments(action, (about) => about !== this._about);
    this._buttons = this._about && this._about.minimum < 0 ? [this._button("−", -1), this._button("+", 1)] : [this._button("Hold", 1)];
    this._speed = this._about && field(this._about, `${action.path} ${this._about.name}`, this._first());
    this.element = el("div", { className: "control jog", "data-control": action.path },
      el("span", { className: "label", textContent: name(action.path) }), ...this._buttons,
      this._speed && labelled(this._about, this._speed),
      ...this._others.elements, el("small", { textContent: "Hold the button.", title: action.help }));
  }

  _first() { return Number.isFinite(this._about.maximum) ? Number((JOG * this._about.maximum).toPrecision(2)) : ""; }

  _button(textContent, sign) {
    const start = () => this._start(sign);
    const button = el("button", { textContent, "aria-label": `${this._action.path} ${textContent}`, "data-sign": sign });
    button.onpointerdown = (event) => {
      if (event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      start();
    };
    for (const kind of ["lostpointercapture", "blur"]) button.addEventListener(kind, this._stop);
    button.addEventListener("contextmenu", (event) => event.preventDefault());  // a long touch
    button.onkeydown = (event) => {
      if (![" ", "Enter"].includes(event.key)) return;
      event.preventDefault();
      if (!event.repeat) start();
    };
    return button;
  }

  async _start(sign) {
    const { path } = this._action;
    if (this._hand.holds(path)) return;
    const given = this._others.values();
    if (this._about && this._speed.value !== "") given[this._about.name] = sign * Number(this._speed.value);
    this._hand.hold(path, { jog: this._stop, lost: () => this._mark(null) });
    this._mark(sign);
    for (const kind of LET_GO) window.addEventListener(kind, this._stop);
    const answer = await this._hand.ask({ do: "call", path, arguments: given }, path);
    if (answer.state !== "done") this._ended();
  }

  _stop = () => {
    const { path } = this._action;
    if (!this._hand.holds(path)) return;
    this._ended();
    this._hand.ask({ do: "let go", path }, `release ${path}`);
  };

  _ended() {
    for (const kind of LET_GO) window.removeEventListener(kind, this._stop);
    this._hand.letGo(this._action.path);
    this._mark(null);
  }

  _mark(sign) { for (const button of this._buttons) button.classList.toggle("held", Number(button.dataset.sign) === sign); }

  refresh() {
    const enabled = this._hand.allows(this._action);
    for (const button of this._buttons) button.disabled = !enabled;
    if (this._speed) this._speed.disabled = !enabled;
    for (const input of this._others.all) input.disabled = !enabled;
  }
}

/** A tunable number: its present value, and a new one. */
export class TunableControl {
  constructor(hand, about) {
    this._hand = hand;
    this._about = about;
    this._value = el("output", {});
    this._field = field(about, about.path, "", bounded(about) ? "" : "new value");
    this._slider = slider(about, about.path, { onchange: () => this._tune(Number(this._slider.value)) });
    this._set = el("button", { textContent: "Set", type: "submit" });
    this.element = el("form", { className: "control tunable", "data-control": about.path, noValidate: true, onsubmit: (event) => this._submitted(event) },
      el("span", { className: "label", textContent: about.name }), this._value, this._field, this._set, between(about, this._slider));
  }

  _submitted(event) {
    event.preventDefault();
    if (this._field.value !== "") this._tune(Number(this._field.value));
  }

  async _tune(value) {
    const { path } = this._about;
    const { state } = await this._hand.ask({ do: "tune", path, value }, `${path} = ${plain(value)}`);
    if (state === "done") this._field.value = "";
  }

  refresh(feed) {
    const value = feed.state.tuned?.[this._about.path] ?? null;
    setText(this._value, `${plain(value)} ${unitOf(this._about)}`.trimEnd());
    const enabled = this._hand.leased;
    for (const input of [this._set, this._field, this._slider]) if (input) input.disabled = !enabled;
    if (this._slider && !isBusy(this._slider) && value !== null) this._slider.value = value;
  }
}

/** A sensor beside the controls: its value. */
export class SensorControl {
  constructor(entry) {
    this._entry = entry;
    this._value = el("output", {});
    this.element = el("div", { className: "control sensor", "data-control": entry.path }, el("span", { className: "label", textContent: name(entry.path) }), this._value);
  }

  refresh(feed) {
    const found = feed.latest(this._entry.path);
    setText(this._value, shown(this._entry, found?.value ?? null));
    this.element.classList.toggle("bad", (found?.quality ?? 4) >= 3);
  }
}
