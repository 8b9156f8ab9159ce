/** Operate: the lease, the mode, and the controls of every part of the machine. */

import { ActionControl, ActuatorControl, JogControl, SensorControl, TunableControl } from "./controls.js";
import { address, el, setText, store } from "./dom.js";
import { words } from "./hand.js";
import { filtered, groupsOf, isActuator, partsOf } from "./parts.js";
import { forbidden } from "./status.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./hand.js").Hand} Hand
 * @typedef {{element: HTMLElement, refresh: (feed: Feed) => void}} Control
 */

const OPEN = 12;  // parts up to which all are unfolded; else the first one is
const ANSWERS = 3;  // that are shown
const MODES = ["automatic", "manual"];

/** @type {Operate | null} */
let operate = null;

/** @param {HTMLElement} element @param {Feed} feed @param {Hand} hand */
export function mount(element, feed, hand) { operate = new Operate(element, feed, hand); }

export function unmount() {
  operate?.close();
  operate = null;
}

class Operate {
  /** @param {HTMLElement} element @param {Feed} feed @param {Hand} hand */
  constructor(element, feed, hand) {
    this.feed = feed;
    this.hand = hand;
    this._all = feed.description ? partsOf(feed.description) : [];
    /** @type {(Part | Family)[]} */
    this._shownParts = [];
    /** @type {string | null} */
    this._sure = null;
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._answers = el("ol", { className: "answers", "aria-live": "polite", "aria-label": "Commands and answers" });
    this._answered = "";
    this._why = el("span", { className: "hint" });
    this._parts = el("div", { className: "parts" });
    this._holder = el("span", { className: "holder" });
    this._name = el("input", { type: "text", placeholder: "Your name", maxLength: 40, "aria-label": "Your name", value: store.get("name"), onchange: () => store.set("name", this._name.value) });
    this._take = el("button", { onclick: () => this._taken() });
    this._give = el("button", { textContent: "Give the lease back", onclick: () => this.hand.giveBack() });
    this._mode = MODES.map((mode) => el("button", { textContent: mode, "data-mode": mode, onclick: () => this.hand.ask({ do: "mode", value: mode }, `mode ${mode}`) }));
    element.append(
      el("div", { className: "bar lease" }, this._holder, this._name, this._take, this._give,
        el("span", { className: "modes", role: "group", "aria-label": "Mode" }, ...this._mode), this._filter, this._why),
      this._answers, this._parts);
    this._off = hand.on(() => this._refresh());  // after each state too
    this._filtered();
    this._refresh();
  }

  /** Taking over from another hand needs a second click. */
  _taken() {
    const { holder } = this.hand;
    if (holder && this._sure !== holder) {
      this._sure = holder;
      this._refresh();
      return;
    }
    this._sure = null;
    this.hand.take(this._name.value, Boolean(holder));
  }

  /** Only what is open is made: a machine may have thousands of parts. */
  _filtered() {
    const wanted = this._filter.value.trim().toLowerCase();
    address.set({ filter: wanted || null });
    const groups = groupsOf(filtered(this._all, wanted));
    this._shownParts = groups.map((group) => (group.family ? new Family(group.title, group.parts, this.feed, this.hand) : new Part(group.parts[0], this.feed, this.hand)));
    this._parts.replaceChildren(...this._shownParts.map(({ element }) => element));
    this._shownParts.forEach((part, number) => {
      if (part instanceof Part) part.element.open = number === 0 || groups.length <= OPEN;
      part.refresh();
    });
  }

  _refresh() {
    const { hand, feed } = this;
    if (!feed.state) return;
    const { ended } = feed;
    setText(this._holder, ended ? `${feed.station} has ended.` : hand.leased ? "You have the lease." : hand.holder ? `${hand.holder} has the lease.` : "Nobody has the lease.");
    setText(this._take, !hand.holder ? "Take the lease" : this._sure === hand.holder ? `Yes, take it over from ${hand.holder}` : "Take it over");
    this._take.hidden = this._name.hidden = hand.leased || !hand.possible || ended;
    this._give.hidden = !hand.leased;
    for (const button of this._mode) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === feed.state.mode));
      button.disabled = !hand.leased;
    }
    setText(this._why, ended ? "" : why(feed, hand));
    this._show();
    for (const part of this._shownParts) part.refresh();
  }

  /** The last commands of this page, the newest first. Their room stays the same: nothing moves under a held button. */
  _show() {
    const shown = this.hand.asked.slice(0, ANSWERS);
    const text = shown.map(words).join("\n");
    if (text === this._answered) return;
    this._answered = text;
    this._answers.replaceChildren(...shown.map((each) => el("li", { "data-state": each.state, textContent: words(each), title: words(each) })));
  }

  close() {
    this.hand.letGoOfJogs();
    this._off();
  }
}

/** What keeps the controls from being used. @param {Feed} feed @param {Hand} hand */
function why(feed, hand) {
  if (!feed.server?.hands) return "This page is read-only. `umo view --hands` lets it command.";
  if (!feed.state?.mode) return `${feed.station} takes no commands.`;
  if (!hand.leased) return "The controls need the lease.";
  return hand.manual ? "" : "Automatic mode: numbers can be tuned, and actions called that are harmless beside the application.";
}

/** Like parts of a list: their panels are made when the group is unfolded. */
class Family {
  /** @param {string} title @param {import("./parts.js").Part[]} parts @param {Feed} feed @param {Hand} hand */
  constructor(title, parts, feed, hand) {
    this._parts = parts;
    this._feed = feed;
    this._hand = hand;
    /** @type {Part[] | null} */
    this._made = null;
    this.element = el("details", { className: "part family", "data-part": title }, el("summary", { textContent: `${title} (${parts.length})` }));
    this.element.ontoggle = () => this.refresh();
  }

  refresh() {
    if (!this.element.open) return;
    if (!this._made) {
      this._made = this._parts.map((part) => new Part(part, this._feed, this._hand));
      this.element.append(...this._made.map(({ element }) => element));
    }
    for (const part of this._made) part.refresh();
  }
}

/** A part: filled when it is unfolded for the first time. */
class Part {
  /** @param {import("./parts.js").Part} part @param {Feed} feed @param {Hand} hand */
  constructor(part, feed, hand) {
    this._part = part;
    this._feed = feed;
    this._hand = hand;
    /** @type {Control[] | null} */
    this._controls = null;
    this._reasons = el("p", { className: "reasons" });
    this.element = el("details", { className: "part", "data-part": part.path }, el("summary", { textContent: part.title }));
    this.element.ontoggle = () => this.refresh();
  }

  _fill() {
    const { objects, actions, tunables } = this._part;
    const hold = actions.filter((action) => action.kept_up);
    const plain = actions.filter((action) => !action.kept_up);
    /** @type {Record<string, Control[]>} */
    const sections = {
      "": objects.filter((entry) => !isActuator(entry) && entry.unit !== "sampling_period").map((entry) => new SensorControl(entry)),
      Actions: [...hold.map((action) => new JogControl(this._hand, action)), ...plain.map((action) => new ActionControl(this._hand, action))],
      Actuators: objects.filter(isActuator).map((entry) => new ActuatorControl(this._hand, entry)),
      "Tunable numbers": tunables.map((entry) => new TunableControl(this._hand, entry)),
    };
    if (objects.some(isActuator)) this.element.append(this._reasons);
    const shown = Object.entries(sections).filter(([, controls]) => controls.length);
    this.element.append(el("div", { className: "controls" }, ...shown.flatMap(([title, controls]) => [
      title ? el("h3", { textContent: title }) : null, ...controls.map(({ element }) => element),
    ])));
    return Object.values(sections).flat();
  }

  refresh() {
    if (!this.element.open || !this._feed.state) return;
    this._controls ??= this._fill();
    for (const control of this._controls) control.refresh(this._feed);
    this._forbidden();
  }

  /** Beside the jog buttons: why actuators of this part stand at their defaults. Its line stays when it is empty. */
  _forbidden() {
    const { inhibited = {} } = this._feed.state ?? {};
    const own = Object.fromEntries(Object.entries(inhibited).filter(([path]) => this._part.objects.some((entry) => entry.path === path)));
    const text = forbidden(own).map((reason) => `⊘ inhibited: ${reason}`).join("; ");
    setText(this._reasons, text);
    this._reasons.title = text;
  }
}
