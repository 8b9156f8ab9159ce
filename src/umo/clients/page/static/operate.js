/** Operate: control, the mode, and the controls of every part of the machine. */

import { AlarmList } from "./alarms.js";
import { ActionControl, ActuatorControl, JogControl, SensorControl, TunableControl } from "./controls.js";
import { address, allow, el, setText } from "./dom.js";
import { shownState, words } from "./client.js";
import { LawPanel, lawsOf } from "./law_panel.js";
import { LeaseBar } from "./lease.js";
import { filtered, groupsOf, isActuator, partsOf } from "./parts.js";
import { RecipePanel } from "./recipes.js";
import { StatesPanel } from "./states.js";
import { inSentence, readable } from "./presentation.js";
import { clearing, forbidden } from "./status.js";
import { VerbForm } from "./verbs.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 * @typedef {{element: HTMLElement, refresh: (feed: Feed) => void}} Control
 */

const MAX_UNFOLDED = 12;  // parts up to which all are unfolded; else the first one is
const MANUAL_ONLY = ["Actuators", "Find the gains"];  // sections
const MAX_ANSWERS = 3;  // that are shown

export class View {
  /** @param {HTMLElement} element @param {Feed} feed @param {Client} client */
  constructor(element, feed, client) {
    this.feed = feed;
    this.client = client;
    this._all = feed.description ? partsOf(feed.description) : [];
    /** @type {(Part | Family)[]} */
    this._shownParts = [];
    this._filter = el("input", { type: "search", placeholder: "Filter", "aria-label": "Filter", value: address.get("filter") ?? "", oninput: () => this._filtered() });
    this._answers = el("ol", { className: "answers", "aria-live": "polite", "aria-label": "Commands and answers" });
    this._answered = "";
    this._parts = el("div", { className: "parts" });
    this._alarms = new AlarmList(feed, client);
    this._states = (feed.description?.units ?? []).map((unit) => new StatesPanel(unit, feed, client));
    this._books = (feed.description?.books ?? []).map((book) => new RecipePanel(book, feed, client));
    this._lease = new LeaseBar(feed, client);
    this._verbs = new VerbForm(feed, client);
    element.append(
      this._lease.element, this._answers, this._alarms.element,
      el("div", { className: "units" }, ...[...this._states, ...this._books].map((each) => each.element)),
      el("div", { className: "bar" }, this._filter), this._parts, this._verbs.element);
    this._off = client.on(() => this._refresh());  // after each state too
    this._filtered();
    this._refresh();
  }

  /** Only what is open is made: a machine may have thousands of parts. */
  _filtered() {
    const wanted = this._filter.value.trim().toLowerCase();
    address.set({ filter: wanted || null });
    const groups = groupsOf(filtered(this._all, wanted));
    this._shownParts = groups.map((group) => (group.family ? new Family(group.title, group.parts, this.feed, this.client) : new Part(group.parts[0], this.feed, this.client)));
    this._parts.replaceChildren(...this._shownParts.map(({ element }) => element));
    this._shownParts.forEach((part, number) => {
      if (part instanceof Part) part.element.open = number === 0 || groups.length <= MAX_UNFOLDED;
      part.refresh();
    });
  }

  _refresh() {
    const { feed } = this;
    if (!feed.state) return;
    this._lease.refresh();
    this._show();
    this._alarms.refresh(feed);
    this._verbs.refresh();
    for (const each of [...this._states, ...this._books]) each.refresh(feed);
    for (const part of this._shownParts) part.refresh();
  }

  /** The last commands of this page, the newest first. Their room stays the same: nothing moves under a held button. */
  _show() {
    const shown = this.client.asked.slice(0, MAX_ANSWERS);
    const text = shown.map(words).join("\n");
    if (text === this._answered) return;
    this._answered = text;
    this._answers.replaceChildren(...shown.map((each) => el("li", { "data-state": shownState(each), textContent: words(each), title: words(each) })));
  }

  close() {
    this.client.letGoOfJogs();
    this._off();
  }
}

/** Like parts of a list: their panels are made when the group is unfolded. */
class Family {
  /** @param {string} title @param {import("./parts.js").Part[]} parts @param {Feed} feed @param {Client} client */
  constructor(title, parts, feed, client) {
    this._parts = parts;
    this._feed = feed;
    this._client = client;
    /** @type {Part[] | null} */
    this._made = null;
    this.element = el("details", { className: "part family", "data-part": title }, el("summary", { textContent: `${readable(title)} (${parts.length})` }));
    this.element.ontoggle = () => this.refresh();
  }

  refresh() {
    if (!this.element.open) return;
    if (!this._made) {
      this._made = this._parts.map((part) => new Part(part, this._feed, this._client));
      this.element.append(...this._made.map(({ element }) => element));
    }
    for (const part of this._made) part.refresh();
  }
}

/** A part: filled when it is unfolded for the first time. */
class Part {
  /** @param {import("./parts.js").Part} part @param {Feed} feed @param {Client} client */
  constructor(part, feed, client) {
    this._part = part;
    this._feed = feed;
    this._client = client;
    /** @type {Control[] | null} */
    this._controls = null;
    /** @type {Map<string, HTMLElement>} */
    this._barriers = new Map();
    this._reasons = el("p", { className: "reasons" });
    this._clear = clearing(part.path, () => client.ask({ do: "clear", path: part.path }, `clear ${inSentence(part.path)}`));
    this.element = el("details", { className: "part", "data-part": part.path }, el("summary", { textContent: readable(part.title), title: part.path }));
    this.element.ontoggle = () => this.refresh();
  }

  _fill() {
    const { objects, actions, tunables } = this._part;
    const hold = actions.filter((action) => action.dead_man);
    const plain = actions.filter((action) => !action.dead_man && !action.apart);
    const apart = actions.filter((action) => !action.dead_man && action.apart);
    /** @type {Record<string, Control[]>} */
    const sections = {
      "": objects.filter((entry) => !isActuator(entry) && entry.unit !== "sampling_period").map((entry) => new SensorControl(entry)),
      Actions: [...hold.map((action) => new JogControl(this._client, action)), ...plain.map((action) => new ActionControl(this._client, action))],
      "Set apart": apart.map((action) => new ActionControl(this._client, action)),
      Actuators: objects.filter(isActuator).map((entry) => new ActuatorControl(this._client, entry)),
      "Tunable numbers": tunables.map((entry) => new TunableControl(this._client, entry)),
      "Find the gains": lawsOf(tunables).map((law) => new LawPanel(this._client, law)),
    };
    if (objects.some(isActuator)) this.element.append(el("div", { className: "why" }, this._reasons, this._clear));
    const shown = Object.entries(sections).filter(([, controls]) => controls.length);
    this.element.append(el("div", { className: "controls" }, ...shown.flatMap(([title, controls]) => [
      title ? this._heading(title) : null, ...controls.map(({ element }) => element),
    ])));
    return Object.values(sections).flat();
  }

  /** With why what stands below it cannot be used. @param {string} title */
  _heading(title) {
    const barrier = el("small", { className: "barrier" });
    this._barriers.set(title, barrier);
    return el("h3", {}, title, " ", barrier);
  }

  refresh() {
    if (!this.element.open || !this._feed.state) return;
    this._controls ??= this._fill();
    for (const control of this._controls) control.refresh(this._feed);
    for (const [title, barrier] of this._barriers) setText(barrier, this._client.barrier(!MANUAL_ONLY.includes(title)));
    this._forbidden();
  }

  /** Beside the jog buttons: why actuators of this part stand at their defaults. Its line stays when it is empty. */
  _forbidden() {
    const { inhibited = {} } = this._feed.state ?? {};
    const own = Object.fromEntries(Object.entries(inhibited).filter(([path]) => this._part.objects.some((entry) => entry.path === path)));
    const { faults = {} } = this._feed.state ?? {};
    const fault = faults[this._part.path];
    const others = forbidden(own, faults).map((reason) => `⊘ inhibited: ${reason}`);
    const text = [...(fault ? [`✖ in fault: ${fault}`] : []), ...others].join("; ");
    this._clear.hidden = !fault || !this._client.possible || this._feed.ended;
    allow(this._clear, this._client.barrier());
    setText(this._reasons, text);
    this._reasons.title = text;
  }
}
