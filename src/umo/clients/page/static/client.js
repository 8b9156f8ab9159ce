/** The client of this page: its lease, what it holds, and what it has asked for. */

import { ConnectionLost } from "./feed.js";
import { Undo } from "./undo.js";

/**
 * @typedef {{what: string, path: string, state: string, text: string, call: boolean, lasts: boolean, at: number, command: number | null}} Asked
 *   `lasts`: what is called ends when it is let go of; `at`: s on the cycle's clock; `command`: its number, where it came to the machine.
 */

const MAX_REMEMBERED = 30;  // commands that are remembered
const UNANSWERED = "no answer, because the connection was lost; it is unknown whether the command was carried out";
const ENDS = ["done", "refused", "failed", "cancelled"];

export class Client {
  /** @param {import("./feed.js").Feed} feed */
  constructor(feed) {
    this.feed = feed;
    /** @type {Asked[]} The newest first. */
    this.asked = [];
    /** What tunable numbers were before this page changed them. */
    this.tuned = new Undo();
    /** @type {Map<string, {jog: (() => void) | null, lost: () => void, command: number | null}>} `command`: the number of the last one that began it. */
    this._held = new Map();
    /** @type {number | null} */
    this._number = null;
    this._run = feed.run;
    /** @type {Set<() => void>} */
    this._listeners = new Set();
    feed.on("state", () => this._onState());
    feed.on("connection", () => this._lost());
    feed.on("description", () => this._changedRun());
    for (const event of ["pagehide", "blur"]) window.addEventListener(event, () => this.letGoOfJogs());
    document.addEventListener("visibilitychange", () => document.hidden && this.letGoOfJogs());
  }

  _changedRun() {
    if (this.feed.run !== this._run) this.tuned.clear();
    this._run = this.feed.run;
    this._lost();
  }

  /** Whether pages of this server may command, and the station takes commands. */
  get possible() { return Boolean(this.feed.server?.operate && this.feed.state?.mode); }

  get holder() { return this.feed.state?.lease?.holder ?? ""; }

  /** Whether this page has the lease. */
  get leased() {
    return this._number !== null && this.feed.connected && !this.feed.ended && Boolean(this.holder) && this.feed.state?.lease?.number === this._number;
  }

  get manual() { return this.feed.state?.mode === "manual"; }

  /** Why this page may not command now; "": it may. @param {boolean} inAutomatic  Whether it is possible in automatic mode too. */
  barrier(inAutomatic = true) {
    const { connected, ended, server, station, state } = this.feed;
    if (!connected) return "The connection to the server is lost";
    if (ended) return "The run has ended";
    if (!server?.operate) return "This page is read-only";
    if (!state?.mode) return `${station} takes no commands`;
    if (!this.leased) return this.holder ? `${this.holder} has control` : "Take control first";
    return inAutomatic || this.manual ? "" : "In manual mode only";
  }

  /** @param {string} who @param {boolean} over  From another one. */
  async take(who, over) {
    const answer = await this.ask({ do: "lease", who, over }, over ? "take control over" : "take control");
    if (answer.state === "done") this._number = answer.lease ?? null;
    this._changed();
  }

  async giveBack() {
    await this.ask({ do: "give back" }, "give control back");
    this._lost();
  }

  /**
   * Send a command and remember its answer, which is never an exception.
   * @param {{do: string, path?: string} & Record<string, unknown>} message @returns {Promise<Page.Answer>}
   */
  async ask(message, what = "") {
    const entry = this._entry(what || [message.do, message.path].filter(Boolean).join(" "), message.path, "sent", "", message.do === "call");
    this._remember(entry);
    this._changed();
    const isHeld = this.feed.description?.verbs?.some(({ name, holds }) => holds && name === message.do);
    const held = isHeld ? this._held.get(entry.path) : undefined;
    const taken = (/** @type {Page.Answer} */ { command }) => {
      entry.command = command ?? null;
      if (held) held.command = entry.command;
    };
    let answer;
    try {
      answer = await this.feed.command(message, (begun) => { Object.assign(entry, { state: "begun", text: begun.text }); taken(begun); this._changed(); });
      if (answer.state === "done") taken(answer);
      if (!ENDS.includes(answer.state)) answer = { state: "failed", text: `unknown answer ${answer.state}` };
    } catch (error) {
      answer = error instanceof ConnectionLost ? { state: "failed", text: UNANSWERED } : { state: "refused", text: String(error instanceof Error ? error.message : error) };
    }
    Object.assign(entry, { state: answer.state, text: answer.text ?? "", command: answer.command ?? entry.command });
    this._changed();
    return answer;
  }

  /** @param {string} what @param {string | undefined} path @param {string} state @param {string} text @param {boolean} call @returns {Asked} */
  _entry(what, path, state, text, call = false) {
    const lasts = call && Boolean(this.feed.description?.actions?.some((each) => each.path === path && each.dead_man));
    return { what, path: path ?? "", state, text, call, lasts, at: this.feed.state?.time ?? 0, command: null };
  }

  /** Keep a path up from now on. `jog`: it ends too when the window loses the focus. @param {string} path @param {{jog?: (() => void) | null, lost?: () => void}} [how] */
  hold(path, { jog = null, lost = () => {} } = {}) { this._held.set(path, Object.assign(this._held.get(path) ?? { command: null }, { jog, lost })); }

  /** @param {string} path */
  letGo(path) { this._held.delete(path); }

  /** @param {string} path */
  holds(path) { return this._held.has(path); }

  letGoOfJogs() { for (const { jog } of [...this._held.values()]) jog?.(); }

  _onState() {
    const { number = 0, holder = "" } = this.feed.state?.lease ?? {};
    for (const path of [...this._held.keys()]) {
      if (this._hasEnded(path)) this._drop(path);
    }
    if (this.leased) this.feed.touch([...this._held.keys()]);
    else if (this._number !== null && (number > this._number || (number === this._number && !holder))) {
      const text = `${holder ? `${holder} has taken it over` : "it has ended"}, and what you held was released`;
      this._remember(this._entry("your control", "", "cancelled", text));
      this._lost();
    }
    this._changed();
  }

  /** Whether the machine has let go of what is held by itself: of an actuator the values say so, of an action the end of its command. @param {string} path */
  _hasEnded(path) {
    const { by_client: byClient = [], taken = 0 } = this.feed.state ?? {};
    const command = this._held.get(path)?.command ?? null;
    if (command === null || byClient.includes(path)) return false;
    if (this.feed.entries.some((entry) => entry.path === path)) return taken >= command;
    return this.feed.events.some((event) => event.state === "cancelled" && event.path === path && event.command === command);
  }

  /** @param {Asked} entry */
  _remember(entry) { this.asked = [entry, ...this.asked].filter(({ state }, i) => i < MAX_REMEMBERED || state === "begun"); }

  /** @param {string} path */
  _drop(path) {
    const held = this._held.get(path);
    this._held.delete(path);
    held?.lost();
  }

  /** The lease is another's or nobody's: the machine has let go of everything. */
  _lost() {
    this._number = null;
    for (const path of [...this._held.keys()]) this._drop(path);
    this._changed();
  }

  /** Call a listener when the lease, the mode or an answer has changed; the result ends that. @param {() => void} listener */
  on(listener) {
    this._listeners.add(listener);
    return () => { this._listeners.delete(listener); };
  }

  _changed() { for (const listener of [...this._listeners]) listener(); }
}

/** The state of a command as it is shown: a call of what lasts until it is let go of is done at once, and has only begun. @param {Pick<Asked, "state"> & {lasts?: boolean}} asked */
export const shownState = ({ state, lasts = false }) => (lasts && state === "done" ? "begun" : state);

const STATE_WORDS = { sent: "…", begun: "has begun" };

/** An answer in words. @param {Pick<Asked, "what" | "state" | "text"> & {lasts?: boolean}} asked */
export function words(asked) {
  const { what, state, text } = asked;
  const said = state === "done" && text ? unquoted(text) : plain(text);
  const shown = shownState(asked);
  return [what, STATE_WORDS[/** @type {keyof typeof STATE_WORDS} */ (shown)] ?? shown, said].filter(Boolean).join(": ");
}

/** An error without its type. @param {string} text */
export const plain = (text) => text.replace(/^[A-Z]\w+: /, "");

/** A result, which comes as JSON. @param {string} text */
export function unquoted(text) {
  try {
    const value = JSON.parse(text);
    return typeof value === "string" ? value : text;
  } catch {
    return text;
  }
}
