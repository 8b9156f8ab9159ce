/** Verbs: what can be asked of a machine. A form gives any of them, also those that have no place of their own here. */

import { allow, el } from "./dom.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const TEXTS = ["choice", "text"];  // kinds of arguments whose texts stay as they are

/** What a verb is called on a button: without the word for what it stands beside. @param {Page.Verb} verb */
export function labelOf(verb) {
  const words = verb.name.replace(/ alarm$/, "");
  return words[0].toUpperCase() + words.slice(1);
}

/**
 * The fields of a command with the arguments that were given, as umo/clients/verb.py has them.
 * @param {Page.Verb} verb @param {Map<string, HTMLInputElement>} given @returns {Record<string, unknown>}
 */
export function fieldsOf(verb, given) {
  const values = verb.arguments.map(({ name, kind }) => /** @type {[string, unknown]} */ ([name, valueOf(kind, given.get(name)?.value ?? "")])).filter(([, value]) => value !== "");
  const [only] = verb.arguments;
  if (only?.kind === "arguments") return { arguments: values.length ? values[0][1] : {} };
  if (!values.length) return {};
  return verb.arguments.length === 1 ? { value: values[0][1] } : { arguments: Object.fromEntries(values) };
}

/** @param {string} kind @param {string} text */
function valueOf(kind, text) {
  if (TEXTS.includes(kind)) return text;
  try { return JSON.parse(text); } catch { return text; }
}

export class VerbForm {
  /** @param {Feed} feed @param {Client} client */
  constructor(feed, client) {
    this._feed = feed;
    this._client = client;
    this._verbs = (feed.description?.verbs ?? []).filter((verb) => !verb.of_lease);
    this._choice = el("select", { "aria-label": "Command", onchange: () => this._chosen() }, ...this._verbs.map(({ name }) => el("option", { value: name, textContent: name })));
    this._path = el("input", { "aria-label": "Path", placeholder: "path" });
    /** @type {Map<string, HTMLInputElement>} */
    this._given = new Map();
    this._arguments = el("span", {});
    this._help = el("small", {});
    this._send = el("button", { textContent: "Send", type: "submit" });
    const form = el("form", { className: "bar", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); this._ask(); } },
      this._choice, this._path, this._arguments, this._send, this._help);
    this.element = el("details", { className: "part verbs" }, el("summary", { textContent: "Any command" }), form);
    this.element.hidden = !this._verbs.length;
    this._chosen();
  }

  get _verb() { return this._verbs.find(({ name }) => name === this._choice.value); }

  /** The inputs of the chosen verb. */
  _chosen() {
    const verb = this._verb;
    if (!verb) return;
    this._path.hidden = verb.names === "nothing";
    this._given = new Map(verb.arguments.map((each) => [each.name, el("input", { placeholder: each.name, title: `${each.help} ${each.range}`, "aria-label": each.name })]));
    this._arguments.replaceChildren(...this._given.values());
    this._help.textContent = verb.help;
    this.refresh();
  }

  refresh() {
    const verb = this._verb;
    if (verb) allow(this._send, verb.needs_lease ? this._client.barrier(!verb.only_manual) : "", verb.help);
  }

  async _ask() {
    const verb = this._verb;
    if (!verb) return;
    const path = verb.names === "nothing" ? "" : this._path.value.trim();
    const isHeld = verb.holds && (verb.names !== "action" || this._feed.description?.actions.some((each) => each.path === path && each.dead_man));
    const holds = isHeld && !this._client.holds(path);
    if (holds) this._client.hold(path);
    const { state } = await this._client.ask({ do: verb.name, path, ...fieldsOf(verb, this._given) }, [verb.name, path].filter(Boolean).join(" "));
    if (holds && state !== "done") this._client.letGo(path);
  }
}
