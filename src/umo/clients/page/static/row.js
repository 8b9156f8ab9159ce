/** One line of the machine: an object or a signal, or a family of like ones. */

import { ActuatorControl } from "./controls.js";
import { breakable, el, setText } from "./dom.js";
import { isActuator } from "./parts.js";
import { isNamed, lasting, shownQuality, STALE, valueText } from "./presentation.js";

export class Row {
  /**
   * @param {import("./feed.js").Feed} feed @param {import("./client.js").Client} client @param {string} name
   * @param {number[]} places  In the feed's entries; several: a family.
   * @param {{family: string, open: boolean, inside: boolean, write: boolean}} how  `write`: whether it can be written here. @param {() => void} act  When its name is clicked.
   */
  constructor(feed, client, name, places, how, act) {
    this._feed = feed;
    this._client = client;
    this._places = places;
    this._entry = feed.entries[places[0]];
    this._paths = places.map((place) => feed.entries[place].path);
    const mark = how.family ? (how.open ? "▾ " : "▸ ") : "";
    const title = how.family ? "Fold or unfold" : "Show on the scope, or remove";
    this._sign = el("td", { className: "quality", role: "cell" });
    this._value = el("td", { className: "value" });
    this._age = el("td", { className: "age" });
    this._raw = el("td", { className: "raw" });
    this._scope = el("td", { className: "on-scope" });
    this._least = el("td", { className: "extreme" });
    this._greatest = el("td", { className: "extreme" });
    this._control = how.write && places.length === 1 && isActuator(this._entry) ? new ActuatorControl(client, this._entry, { inRow: true }) : null;
    const button = el("button", { className: "name", title, onclick: act }, mark, ...breakable(name));
    if (how.family) button.setAttribute("aria-expanded", String(how.open));
    this._reason = el("small", { className: "reason" });
    this.element = el("tr", { className: how.inside ? "inside" : "", "data-path": name },
      this._sign, el("th", { scope: "row" }, el("div", {}, button, this._reason)), this._value,
      el("td", { className: "write" }, this._control?.element), this._least, this._greatest, this._age, this._raw,
      el("td", { className: "wiring", textContent: this._wire() }), el("td", { className: "range", textContent: this._entry.declared ?? "signal" }), this._scope);
  }

  _wire() {
    const wires = [...new Set(this._places.map((place) => this._feed.entries[place].wire ?? ""))];
    return wires.length > 2 ? `${wires[0]} .. ${wires[wires.length - 1]}` : wires.join(", ");
  }

  /** Show the present values. */
  refresh() {
    const found = this._paths.flatMap((path) => this._feed.latest(path) ?? []);
    if (!found.length) return;
    setText(this._value, valueText(this._entry, ...found.map(({ value }) => value)));
    this._quality(Math.max(...found.map(({ quality }) => quality)), found);
    const [{ raw }] = found;
    setText(this._raw, found.length === 1 && raw !== null ? String(raw) : "");
    this._forbidden();
    this._control?.refresh(this._feed);
  }

  /** The lease, the mode or an answer has changed. */
  refreshControl() {
    if (!this._control) return;
    this._control.refresh(this._feed);
    this._forbidden();
  }

  /** The least and the greatest value, of a family of all. @param {Map<number, [number, number]>} extremes */
  showExtremes(extremes) {
    const found = isNamed(this._entry) ? [] : this._places.flatMap((place) => [extremes.get(place) ?? []]).filter(({ length }) => length);
    setText(this._least, found.length ? valueText(this._entry, Math.min(...found.map(([least]) => least))) : "");
    setText(this._greatest, found.length ? valueText(this._entry, Math.max(...found.map(([, greatest]) => greatest))) : "");
  }

  /** The worst one, with how many have it; the age of the oldest value. @param {number} worst @param {Page.Sample[]} found */
  _quality(worst, found) {
    const signal = !("kind" in this._entry);
    const { state, description, ended } = this._feed;
    const { sign, word, kind } = shownQuality(worst, description?.qualities ?? [], ended);  // colour is not the only difference
    const title = kind === "last" ? "the last value before the end" : kind;
    setText(this._sign, signal && !ended ? "" : sign);
    this._sign.title = signal ? "" : title;
    this._sign.setAttribute("aria-label", signal ? "" : title);
    this.element.dataset.quality = signal ? (ended ? "last" : "") : kind;
    const count = found.length > 1 ? `${found.filter(({ quality }) => quality === worst).length} ` : "";
    if (word) this._value.append(el("em", { textContent: ` ${count}${word}` }));
    const ages = this._places.map((place) => state?.ages[place]).filter((age) => age !== undefined);
    const age = ages.includes(null) ? null : Math.max(.../** @type {number[]} */ (ages));
    setText(this._age, worst >= STALE && ages.length ? (age === null ? "never" : lasting(age)) : ended ? "last" : signal ? "" : this._fresh());
  }

  _fresh() { return this._entry.synchronous ? "" : "on demand"; }

  /** Why an actuator stands at its default, who works it, or why it was not written from here. */
  _forbidden() {
    const { inhibited = {}, by_client: byClient = [], lease } = this._feed.state ?? {};
    const path = this._paths.find((each) => each in inhibited);
    const client = !path && this._paths.some((each) => byClient.includes(each));
    const refused = this._control?.refusal ?? "";
    setText(this._reason, path ? `⊘ inhibited: ${inhibited[path]}` : refused ? `✕ ${refused}` : client ? `by client: ${lease?.holder ?? ""}` : "");
    this._reason.title = this._reason.textContent ?? "";
    this._reason.classList.toggle("refused", Boolean(refused));
    this.element.classList.toggle("inhibited", Boolean(path));
    this._value.title = this._driver(path ?? "", client);
  }

  /** Who drives an actuator, why, and what comes next: as `umo show why STATION PATH` tells it. @param {string} inhibited @param {boolean} client */
  _driver(inhibited, client) {
    const { state, description, ended } = this._feed;
    if (ended) return "";
    const rank = state?.in_fault?.includes(inhibited) ? "FAULT" : inhibited ? "INTERLOCK" : client ? "CLIENT" : "PROGRAM";
    const [who, next] = description?.drivers?.[rank] ?? [];
    if (!who || !isActuator(this._entry)) return "";
    const reason = inhibited ? state?.inhibited?.[inhibited] : client ? state?.lease?.holder : "";
    return `Driven by ${who}${reason ? `: ${reason}` : ""}. ${next}`;
  }

  /** Whether it is on the scope. @param {string[]} traces */
  mark(traces) {
    const on = this._paths.length === 1 && traces.includes(this._paths[0]);
    setText(this._scope, on ? "∿" : "");
    this._scope.title = on ? "On the scope" : "";
    this.element.classList.toggle("traced", on);
  }
}
