/** The table of a fleet: a row for each station. Rows are made once and changed in place, so that nothing moves under a finger. */

import { el, setText } from "./dom.js";

const COLUMNS = ["Station", "State", "Mode", "Control", "Alarms", "Missed", "Progress"];

export class FleetTable {
  /** @param {(name: string) => void} choose */
  constructor(choose) {
    this._choose = choose;
    /** @type {Map<string, {row: HTMLTableRowElement, cells: Element[]}>} */
    this._rows = new Map();
    this._summary = el("p", { className: "fleet-summary" });
    this._body = el("tbody");
    const heads = COLUMNS.map((textContent) => el("th", { textContent, scope: "col" }));
    this.element = el("div", { className: "fleet-stations", hidden: true }, el("h2", { textContent: "Fleet" }), this._summary,
      el("table", { className: "fleet" }, el("thead", {}, el("tr", {}, ...heads)), this._body));
  }

  /** @param {Page.FleetRow[]} rows  Sorted by their names. */
  update(rows) {
    this.element.hidden = !rows.length;
    setText(this._summary, summaryOf(rows));
    for (const [name, { row }] of this._rows) {
      if (rows.some((each) => each.name === name)) continue;
      row.remove();
      this._rows.delete(name);
    }
    rows.forEach((each, place) => this._show(each, place));
  }

  /** @param {Page.FleetRow} told @param {number} place */
  _show(told, place) {
    const known = this._rows.get(told.name) ?? this._made(told, place);
    const texts = textsOf(told);
    texts.forEach((text, i) => setText(known.cells[i], text));
    known.row.className = classOf(told);
    known.row.title = told.alarm || told.wiring;
  }

  /** @param {Page.FleetRow} told @param {number} place */
  _made({ name }, place) {
    const button = el("button", { onclick: () => this._choose(name) });
    const others = COLUMNS.slice(1).map(() => el("td"));
    const row = el("tr", {}, el("th", { scope: "row" }, button), ...others);
    this._body.insertBefore(row, this._body.children[place] ?? null);
    const made = { row, cells: [button, ...others] };
    this._rows.set(name, made);
    return made;
  }
}

/** The text of each column. @param {Page.FleetRow} told @returns {string[]} */
export function textsOf({ name, state, mode, lease, alarms, faults, missed, progress, present }) {
  const trouble = [faults.length ? `fault: ${faults.join(", ")}` : "", alarms ? `${alarms}` : ""].filter(Boolean).join("; ");
  const rest = [mode, lease, trouble, missed ? missed.toLocaleString("en") : "", progress];
  return [name, state, ...(present ? rest : rest.map(() => ""))];
}

/** @param {Page.FleetRow} told */
function classOf({ present, faults, alarms }) {
  if (!present) return "away";
  return faults.length ? "failed" : alarms ? "warn" : "";
}

/** How many there are, and what is wrong. @param {Page.FleetRow[]} rows */
export function summaryOf(rows) {
  const away = rows.filter(({ present }) => !present).length;
  const troubled = rows.filter(({ present, alarms, faults }) => present && (alarms || faults.length)).length;
  const parts = [`${rows.length} station${rows.length === 1 ? "" : "s"}`, troubled && `${troubled} with alarms or faults`, away && `${away} away`];
  return parts.filter(Boolean).join(" · ");
}
