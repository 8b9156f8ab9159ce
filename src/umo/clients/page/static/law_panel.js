/** The tuning of a law: an experiment, the gains that follow from it, the plot, and accepting or rejecting them. */

import { plain, unquoted } from "./client.js";
import { allow, el, setText } from "./dom.js";
import { numberText, readable } from "./presentation.js";

/**
 * @typedef {import("./client.js").Client} Client
 * @typedef {{base: string, name: string, tunables: Page.Tunable[]}} Law  `base`: its path.
 */

const BEFORE = 20;  // steps of the law before the experiment that are looked at
const WIDTH = 320;  // of the plots
const HEIGHT = 110;
const PRESENT = "present";
const SVG = "http://www.w3.org/2000/svg";

/** The laws among tunable numbers: what has a gain. @param {Page.Tunable[]} tunables @returns {Law[]} */
export function lawsOf(tunables) {
  return tunables.filter(({ path }) => path.endsWith(".gain")).map(({ path, name }) => {
    const base = path.slice(0, -".gain".length);
    return { base, name: name.slice(0, -".gain".length), tunables: tunables.filter((each) => each.path.startsWith(`${base}.`)) };
  });
}

/** A margin, a time or a share in words. @param {number | null} value @param {string} unit */
const told = (value, unit) => (value === null ? "-" : `${numberText(Number(value.toPrecision(3)))}${unit}`);

/** What a set sets: the tunable numbers with their new values; what is not tunable is left out. @param {Page.GainSet} set @param {Page.Tunable[]} tunables @param {string} base @returns {[string, number][]} */
export function changes({ settings }, tunables, base) {
  const known = new Set(tunables.map(({ path }) => path));
  /** @type {[string, number][]} */
  const found = [];
  for (const [name, value] of Object.entries(settings)) {
    if (value !== null && known.has(`${base}.${name}`)) found.push([`${base}.${name}`, value]);
  }
  return found;
}

/** The points of lines in a box, all on one scale. @param {{times: number[], values: (number | null)[]}[]} lines @returns {string[]} */
export function pointsOf(lines) {
  const values = lines.flatMap((line) => line.values).filter((value) => value !== null);
  const times = lines.flatMap((line) => line.times);
  const [low, high, first, last] = [Math.min(...values), Math.max(...values), Math.min(...times), Math.max(...times)];
  const x = (/** @type {number} */ time) => ((time - first) / (last - first || 1)) * WIDTH;
  const y = (/** @type {number} */ value) => HEIGHT - 4 - ((value - low) / (high - low || 1)) * (HEIGHT - 8);
  return lines.map((line) => line.times.flatMap((time, i) => {
    const value = line.values[i];
    return value === null || value === undefined ? [] : [`${x(time).toFixed(1)},${y(value).toFixed(1)}`];
  }).join(" "));
}

export class LawPanel {
  /** @param {Client} client @param {Law} law */
  constructor(client, law) {
    this._client = client;
    this._law = law;
    this._running = "";
    /** @type {Page.Tuned | null} */
    this._found = null;
    this._place = el("input", { type: "text", value: law.base, "aria-label": `${law.base} loop`, title: "The law; for a law of many elements, one element (heating.3) or its part (zones.3)" });
    this._kind = el("select", { "aria-label": `${law.base} experiment` }, ...["relay", "step"].map((kind) => el("option", { textContent: kind, value: kind })));
    this._amplitude = el("input", { type: "number", value: "10", min: "0.1", max: "50", step: "any", "aria-label": `${law.base} amplitude`, title: "% of the range of the actuator, or of a cascade's inner setpoint" });
    this._begin = el("button", { textContent: "Begin", type: "submit" });
    this._cancel = el("button", { textContent: "Cancel", type: "button", onclick: () => this._end() });
    this._answer = el("p", { className: "answer", "aria-live": "polite" });
    this._result = el("div", { className: "tuned", hidden: true });
    this.element = el("form", { className: "control law", "data-control": law.base, noValidate: true, onsubmit: (/** @type {Event} */ event) => this._submitted(event) },
      el("span", { className: "label", title: law.base }, readable(law.name)), this._place, this._kind,
      el("label", {}, this._amplitude, el("span", { className: "unit", textContent: "%" })),
      el("span", { className: "buttons" }, this._begin, this._cancel), this._answer, this._result);
  }

  /** @param {Event} event */
  async _submitted(event) {
    event.preventDefault();
    if (this._running) return;
    this._running = this._place.value.trim();
    this._show(null);
    try {
      await this._experiment(this._running);
    } catch (error) {
      this._say("failed", plain(String(error instanceof Error ? error.message : error)));
    }
    this._running = "";
  }

  /** @param {string} place */
  async _experiment(place) {
    const { feed } = this._client;
    /** @type {Page.LawFacts} */
    const facts = await this._call(`${place}.law`, {});
    const { low = null, high = null } = facts;
    const amplitude = (Number(this._amplitude.value) / 100) * (high !== null && low !== null ? high - low : NaN);
    if (!Number.isFinite(amplitude)) throw new Error(`${facts.law} has no actuator with a range: use umo tune law`);
    const path = `${place}.experiment`;
    const kind = this._kind.value;
    this._say("begun", `${kind}: runs`);
    this._client.hold(path);
    try {
      const { from, to } = await this._call(path, { kind, amplitude });
      this._say("begun", "looking for the gains");
      this._show(await feed.tuneLaw({ facts, start: from - BEFORE * facts.dt, stop: to, relay: kind === "relay" }));
      this._say("done", "the experiment has ended; the law is in control");
    } finally {
      this._client.letGo(path);
      await this._client.ask({ do: "let go", path }, `release ${path}`);
    }
  }

  /** The result of an action, which is an object; Error in the machine's words. @param {string} path @param {object} given @returns {Promise<any>} */
  async _call(path, given) {
    const { state, text } = await this._client.ask({ do: "call", path, arguments: given });
    if (state !== "done") throw new Error(`${state}: ${plain(unquoted(text ?? ""))}`);
    return JSON.parse(text);
  }

  _end() {
    if (this._running) this._client.ask({ do: "cancel", path: `${this._running}.experiment` }, `cancel ${this._running}.experiment`);
  }

  /** @param {string} state @param {string} text */
  _say(state, text) {
    setText(this._answer, text);
    this._answer.title = text;
    this._answer.dataset.state = state;
  }

  /** @param {Page.Tuned | null} found */
  _show(found) {
    this._found = found;
    this._result.hidden = !found;
    if (!found) return;
    const name = `set-${this._law.base}`;
    const rows = found.sets.map((set) => el("tr", { "data-set": set.name },
      el("th", { scope: "row" }, set.name === PRESENT ? set.name : el("label", {}, el("input", { type: "radio", name, value: set.name, checked: set.name === "balanced", onchange: () => this._draw() }), set.name)),
      el("td", { textContent: Object.entries(set.settings).map(([each, value]) => `${readable(each)} ${told(value, "")}`).join(", ") }),
      el("td", { textContent: told(set.gain_margin, "") }), el("td", { textContent: told(set.phase_margin, "°") }),
      el("td", { textContent: told(set.overshoot, " %") }), el("td", { textContent: told(set.settling_time, " s") })));
    const heads = ["gains", "", "gain margin", "phase margin", "overshoot", "settled"].map((head) => el("th", { textContent: head, scope: "col" }));
    this._plots = el("div", { className: "plots" });
    this._accept = el("button", { textContent: "Accept", type: "button", onclick: () => this._tune() });
    const reject = el("button", { textContent: "Reject", type: "button", onclick: () => { this._show(null); this._say("", ""); } });
    const { time = null, times_faster: faster = null } = found.inner ?? {};
    const inner = time === null ? "" : `; inner loop: ${told(time, " s")}${faster === null ? "" : `, ${told(faster, "")} times faster`}`;
    const others = found.model.as_good.filter((kind) => kind !== found.model.kind);
    const model = `${found.model.kind}, fit ${found.model.fit.toFixed(1)} %${others.length ? `; fits as well: ${others.join(", ")}` : ""}`;
    this._result.replaceChildren(el("p", { className: "model", textContent: model + inner }), this._plots,
      el("div", { className: "scroll" }, el("table", {}, el("thead", {}, el("tr", {}, ...heads)), el("tbody", {}, ...rows))),
      el("span", { className: "buttons" }, this._accept, reject));
    this._draw();
  }

  get _chosen() {
    const name = /** @type {HTMLInputElement | null} */ (this._result.querySelector("input:checked"))?.value;
    return this._found?.sets.find((set) => set.name === name) ?? null;
  }

  /** The measured response with the model over it; the step of the chosen set over that of the present gains. */
  _draw() {
    const found = this._found;
    if (!found || !this._plots) return;
    const { times, measured, predicted, steps } = found;
    const chosen = this._chosen?.name ?? "";
    const response = [{ times, values: measured }, { times, values: predicted }];
    const promised = [PRESENT, chosen].flatMap((name) => (steps[name] ? [steps[name]] : []));
    this._plots.replaceChildren(plot("measured, and the model", response), plot(`predicted step: ${chosen}, and present`, promised));
  }

  /** Give the law the chosen gains; each can be undone beside its number. */
  async _tune() {
    const set = this._chosen;
    if (!set) return;
    const given = changes(set, this._law.tunables, this._law.base);
    for (const [path, value] of given) {
      const { state, text } = await this._client.ask({ do: "tune", path, value }, `${path} = ${numberText(value)}`);
      if (state !== "done") {
        this._say(state, plain(text ?? ""));
        return;
      }
      const before = parseFloat(unquoted(text ?? ""));
      if (Number.isFinite(before) && before !== value) this._client.tuned.push(path, before);
    }
    this._show(null);
    this._say("done", given.length ? `the ${set.name} gains are in effect until the run ends` : "none of these numbers is tunable");
  }

  refresh() {
    const barrier = this._client.barrier(false);
    allow(this._begin, barrier || (this._running ? "An experiment is under way" : ""));
    allow(this._cancel, this._running ? "" : "No experiment is under way");
    if (this._accept) allow(this._accept, this._client.barrier());
    for (const input of [this._place, this._kind, this._amplitude]) input.disabled = Boolean(barrier || this._running);
  }
}

/** Lines in a box; the first is what was, the second what is said of it. @param {string} title @param {{times: number[], values: (number | null)[]}[]} lines */
function plot(title, lines) {
  const box = document.createElementNS(SVG, "svg");
  box.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", title);
  pointsOf(lines).forEach((points, i) => {
    const line = document.createElementNS(SVG, "polyline");
    line.setAttribute("points", points);
    line.setAttribute("class", i ? "said" : "was");
    box.append(line);
  });
  return el("figure", {}, box, el("figcaption", { textContent: title }));
}
