/** Controls made from the declarations: actuators, actions, jogs, tunable numbers, sensors. */

import { allow, el, setText } from "./dom.js";
import { CallLine } from "./calls.js";
import { plain, unquoted } from "./client.js";
import { NumberInput } from "./number.js";
import { inSentence, isNumber, numberText, readable, shownQuality, statesOf, stateText, unitOf, valueText } from "./presentation.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const SLIDE_PAUSE = 100;  // ms between two values of a slider that is moved
const LET_GO = ["pointerup", "pointercancel", "keyup"];  // end a jog wherever they happen: its button may be gone
const RELEASE = "Send the default; the program may write it again";
const JOG_SHARE = 0.1;  // of the range: the first value of a jog

/** @param {string} path */
const name = (path) => path.slice(path.lastIndexOf(".") + 1);
/** @param {string} text */
const sentence = (text) => text.split(/(?<=\.) /)[0].replaceAll("`", "");

/** One actuator: named states, or a number; held until it is released. */
export class ActuatorControl {
  /** @param {Client} client @param {Page.Entry} entry @param {{inRow?: boolean}} how  `inRow`: beside the value and the name, on one line. */
  constructor(client, entry, { inRow = false } = {}) {
    this._client = client;
    this._entry = entry;
    this.path = entry.path;
    /** @type {ReturnType<typeof setTimeout> | null} */
    this._timer = null;
    this._newest = 0;
    this._release = el("button", { textContent: "Release", type: "button", onclick: () => this._letGo() });
    this._number = isNumber(entry) ? new NumberInput(entry, entry.path, { slide: inRow ? null : (value) => this._slid(value), unit: false }) : null;
    this._buttons = this._number ? [setButton()] : this._states();
    this._reason = el("small", { className: "reason" });
    this._word = el("small", { className: "word" });
    this.element = el("form", { className: "control actuator", "data-control": entry.path, noValidate: true, onsubmit: (/** @type {Event} */ event) => this._submitted(event) },
      inRow ? null : labelOf(entry.path, name(entry.path), entry, this._reason, this._word), this._number?.element, el("span", { className: "buttons" }, ...this._buttons, this._release));
  }

  /** Why the last value that this page gave was not taken; "": it was. */
  get refusal() {
    const last = this._client.asked.find(({ path }) => path === this.path);
    return last && ["refused", "failed"].includes(last.state) ? plain(last.text).replace(`${this.path}: `, "") : "";
  }

  _states() {
    return Object.values(statesOf(this._entry)).map((state) => el("button", { textContent: state, type: "button", "data-state": state, "aria-pressed": "false", onclick: () => this._write(state) }));
  }

  /** @param {Event} event */
  _submitted(event) {
    event.preventDefault();
    const value = this._number?.value ?? null;
    if (value !== null) this._write(value);
  }

  /** The slider is moved: its newest value every `SLIDE_PAUSE` ms. @param {number} value */
  _slid(value) {
    this._newest = value;
    this._timer ??= setTimeout(() => {
      this._timer = null;
      if (this._client.leased && this.element.isConnected) this._write(this._newest);
    }, SLIDE_PAUSE);
  }

  /** @param {number | string} value */
  async _write(value) {
    const before = this._client.holds(this.path);
    this._client.hold(this.path);
    this._number?.taken();
    const answer = await this._client.ask({ do: "write", path: this.path, value }, `${this.path} = ${value}`);
    if (answer.state !== "done" && !before) this._client.letGo(this.path);
  }

  _letGo() {
    if (this._timer) clearTimeout(this._timer);
    this._timer = null;
    this._client.letGo(this.path);
    this._client.ask({ do: "let go", path: this.path }, `release ${this.path}`);
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const value = feed.latest(this.path)?.value ?? null;
    const reason = feed.state?.inhibited?.[this.path] ?? "";
    setText(this._reason, reason && "⊘ inhibited");
    this._reason.title = reason;
    setText(this._word, lastOf(feed));
    this.element.classList.toggle("inhibited", Boolean(reason));
    const barrier = this._client.barrier(false);
    for (const button of this._buttons) allow(button, barrier);
    this._number?.enable(!barrier);
    allow(this._release, barrier || (this._client.holds(this.path) ? "" : "This page has written nothing here"), RELEASE);
    for (const button of this._number ? [] : this._buttons) {
      const on = value !== null && button.dataset.state === stateText(this._entry, value);
      button.setAttribute("aria-pressed", String(on));
    }
    if (!this._timer) this._number?.show(value);
  }
}

/** The name of a control, and its unit: the fields below one another stand in line. @param {string} path @param {string} text @param {{look?: string}} about @param {Node[]} more */
const labelOf = (path, text, about, ...more) => el("span", { className: "label", title: path }, readable(text), el("span", { className: "unit", textContent: ` ${unitOf(about)}`.trimEnd() }), ...more);

/** It leaves the focus in the field: one that is left shows the present value again, which the end of the click would send. */
const setButton = () => el("button", { textContent: "Set", type: "submit", onmousedown: (/** @type {Event} */ event) => event.preventDefault() });

/** Said beside a value after the end of the run. @param {Feed} feed */
const lastOf = ({ ended }) => (ended ? "last value" : "");

/** An input with the name of what it gives. @param {Page.Argument} about @param {Node} input */
const labelled = (about, input) => el("label", {}, `${inSentence(about.name)} `, input);

/** One input for each argument of an action. */
class Arguments {
  /** @param {Page.Action} action @param {(about: Page.Argument) => boolean} only */
  constructor(action, only = () => true) {
    /** @type {Map<Page.Argument, NumberInput | HTMLInputElement | HTMLSelectElement>} */
    this._inputs = new Map(action.arguments.filter(only).map((about) => [about, this._input(action, about)]));
    this.elements = [...this._inputs].map(([about, input]) => labelled(about, input instanceof NumberInput ? input.element : input));
  }

  /** @param {Page.Action} action @param {Page.Argument} about */
  _input(action, about) {
    const label = `${action.path} ${about.name}`;
    const value = /** @type {any} */ (about.default ?? "");
    if (about.kind === "choice") return el("select", { "aria-label": label }, ...(about.choices ?? []).map((choice) => el("option", { textContent: choice, selected: choice === value })));
    if (about.kind === "bool") return el("input", { type: "checkbox", checked: Boolean(value), "aria-label": label });
    if (about.kind === "text") return el("input", { type: "text", value, "aria-label": label });
    return new NumberInput(about, label, { value });
  }

  /** @param {boolean} enabled */
  enable(enabled) {
    for (const input of this._inputs.values()) {
      if (input instanceof NumberInput) input.enable(enabled);
      else input.disabled = !enabled;
    }
  }

  /** What is given; an empty field is not. */
  values() {
    /** @type {Record<string, unknown>} */
    const given = {};
    for (const [about, input] of this._inputs) {
      const value = input instanceof NumberInput ? input.value : about.kind === "bool" ? /** @type {HTMLInputElement} */ (input).checked : input.value;
      const empty = value === null || (value === "" && !(about.kind === "text" && about.required));
      if (!empty && value !== about.default) given[about.name] = value;
    }
    return given;
  }
}

/** An action that is called: its button, its arguments, and a way to cancel it while it runs. */
export class ActionControl {
  /** @param {Client} client @param {Page.Action} action */
  constructor(client, action) {
    this._client = client;
    this._action = action;
    this._arguments = new Arguments(action);
    this._call = el("button", { textContent: readable(name(action.path)), type: "submit" });
    this._cancel = el("button", { textContent: "Cancel", type: "button", className: "cancel", onclick: () => client.ask({ do: "cancel", path: action.path }) });
    this._line = new CallLine(sentence(action.help), [action.path]);
    this.element = el("form", { className: `control action${action.apart ? " apart" : ""}`, "data-control": action.path, noValidate: true, onsubmit: (/** @type {Event} */ event) => this._submitted(event) },
      this._call, ...this._arguments.elements, this._cancel, this._line.element);
  }

  /** @param {Event} event */
  _submitted(event) {
    event.preventDefault();
    const given = this._arguments.values();
    const words = Object.entries(given).map(([key, value]) => `${key}=${value}`);
    this._client.ask({ do: "call", path: this._action.path, arguments: given }, [this._action.path, ...words].join(" "));
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const barrier = this._client.barrier(this._action.harmless);
    allow(this._call, barrier, this._action.help);
    this._arguments.enable(!barrier);
    const begun = this._line.refresh(feed, this._client, this._client.barrier() ? "" : barrier);  // what bars everything is told once, above
    this.element.classList.toggle("running", begun);
    this._cancel.classList.toggle("away", !begun);  // its room stays: nothing moves under a button that is held
    allow(this._cancel, this._client.barrier() || (begun ? "" : "It does not run"));
  }
}

/** An action that lasts while its button is held. With a range on both sides of 0: one button for each direction. */
export class JogControl {
  /** @param {Client} client @param {Page.Action} action */
  constructor(client, action) {
    this._client = client;
    this._action = action;
    this._about = action.arguments.find(({ kind }) => kind === "number") ?? null;
    this._others = new Arguments(action, (about) => about !== this._about);
    this._presses = 0;
    this._buttons = this._about && (this._about.minimum ?? -Infinity) < 0 ? [this._button("−", -1), this._button("+", 1)] : [this._button("Hold to run", 1)];
    this._speed = this._about && new NumberInput(this._about, `${action.path} ${this._about.name}`, { value: first(this._about) });
    this._line = new CallLine("Hold the button.", [action.path], { quiet: true });
    this.element = el("div", { className: "control jog", "data-control": action.path },
      el("span", { className: "label", title: action.path }, readable(name(action.path))), el("span", { className: "buttons" }, ...this._buttons),
      this._about && this._speed && labelled(this._about, this._speed.element),
      ...this._others.elements, this._line.element);
  }

  /** @param {string} textContent @param {number} sign */
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

  /** @param {number} sign */
  async _start(sign) {
    const { path } = this._action;
    if (this._client.holds(path)) return;
    const press = ++this._presses;
    const given = this._others.values();
    const speed = this._speed?.value ?? null;
    if (this._about && speed !== null) given[this._about.name] = sign * Math.abs(speed);
    this._client.hold(path, { jog: this._stop, lost: () => this._mark(null) });
    this._mark(sign);
    for (const kind of LET_GO) window.addEventListener(kind, this._stop);
    const answer = await this._client.ask({ do: "call", path, arguments: given }, path);
    if (answer.state !== "done" && press === this._presses) this._ended();  // not of a press before, which ends late
  }

  _stop = () => {
    const { path } = this._action;
    if (!this._client.holds(path)) return;
    this._ended();
    this._client.ask({ do: "let go", path }, `release ${path}`);
  };

  _ended() {
    for (const kind of LET_GO) window.removeEventListener(kind, this._stop);
    this._client.letGo(this._action.path);
    this._mark(null);
  }

  /** @param {number | null} sign */
  _mark(sign) { for (const button of this._buttons) button.classList.toggle("held", Number(button.dataset.sign) === sign); }

  /** @param {Feed} feed */
  refresh(feed) {
    const barrier = this._client.barrier(this._action.harmless);
    this._line.refresh(feed, this._client, this._client.barrier() ? "" : barrier);
    for (const button of this._buttons) allow(button, barrier);
    this._speed?.enable(!barrier);
    this._others.enable(!barrier);
  }
}

/** @param {Page.Argument} about */
const first = ({ maximum }) => (maximum !== undefined && Number.isFinite(maximum) ? Number((JOG_SHARE * maximum).toPrecision(2)) : "");

/** A tunable number, and the way back to what it was before. */
export class TunableControl {
  /** @param {Client} client @param {Page.Tunable} about */
  constructor(client, about) {
    this._client = client;
    this._about = about;
    this._number = new NumberInput(about, about.path, { slide: (value, done) => { if (done) this._tune(value); }, unit: false });
    this._set = setButton();
    this._word = el("small", { className: "word" });
    this._undo = el("button", { textContent: "Undo", type: "button", onclick: () => this._back() });
    this.element = el("form", { className: "control tunable", "data-control": about.path, noValidate: true, onsubmit: (/** @type {Event} */ event) => this._submitted(event) },
      labelOf(about.path, about.name, about, this._word), this._number.element, el("span", { className: "buttons" }, this._set, this._undo));
  }

  /** @param {Event} event */
  _submitted(event) {
    event.preventDefault();
    if (this._number.value !== null) this._tune(this._number.value);
  }

  /** @param {number} value */
  async _tune(value) {
    const { path } = this._about;
    const { state, text } = await this._client.ask({ do: "tune", path, value }, `${path} = ${numberText(value)}`);
    if (state !== "done") return;
    this._number.taken();
    const before = parseFloat(unquoted(text ?? ""));  // the machine's answer: "25 -> 31"; the last state may be older
    if (Number.isFinite(before) && before !== value) this._client.tuned.push(path, before);
  }

  /** To the value before the last change by this page. */
  async _back() {
    const { path } = this._about;
    const value = this._client.tuned.last(path);
    if (value === null) return;
    const { state } = await this._client.ask({ do: "tune", path, value }, `${path} = ${numberText(value)} (undo)`);
    if (state === "done") this._client.tuned.pop(path);
  }

  /** @param {Feed} feed */
  refresh(feed) {
    this._number.show(feed.state?.tuned?.[this._about.path] ?? null);
    setText(this._word, lastOf(feed));
    const barrier = this._client.barrier();
    allow(this._set, barrier);
    this._number.enable(!barrier);
    const before = this._client.tuned.last(this._about.path);
    allow(this._undo, barrier || (before === null ? "Nothing to undo" : ""), before === null ? "" : `Back to ${numberText(before)}`);
  }
}

/** A sensor beside the controls: its value, and its quality where that is not good. */
export class SensorControl {
  /** @param {Page.Entry} entry */
  constructor(entry) {
    this._entry = entry;
    this._value = el("output", {});
    this._word = el("small", { className: "word" });
    this.element = el("div", { className: "control sensor", "data-control": entry.path }, el("span", { className: "label", title: entry.path }, readable(name(entry.path))), this._word, this._value);
  }

  /** @param {Feed} feed */
  refresh(feed) {
    const found = feed.latest(this._entry.path);
    const { sign, word, kind } = shownQuality(found?.quality ?? 4, feed.description?.qualities ?? [], feed.ended);
    setText(this._value, valueText(this._entry, found?.value));
    setText(this._word, word ? `${sign} ${word}` : kind === "last" ? lastOf(feed) : "");
    this.element.dataset.quality = kind;
  }
}
