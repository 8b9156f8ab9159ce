/** The recipes of a machine: the one that runs, those that can be chosen with their values, and the choice. */

import { words } from "./client.js";
import { allow, el, setText } from "./dom.js";
import { inSentence, numberText, statesOf, unitOf } from "./presentation.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const PLAN = "Batches that begin from now on use the recipes of the program";

/** A value of a recipe. @param {unknown} value @returns {string} */
export function recipeText(value) {
  if (Array.isArray(value)) return value.map(recipeText).join(", ");
  if (typeof value === "boolean") return value ? "yes" : "no";
  return typeof value === "number" ? numberText(value) : String(value ?? "-");
}

/** One book of recipes. */
export class RecipePanel {
  /** @param {Page.Book} book @param {Feed} feed @param {Client} client */
  constructor(book, feed, client) {
    this._book = book;
    this._client = client;
    this._begun = el("output", { className: "recipe-name" });
    this._next = el("output", { className: "recipe-name" });
    this._select = el("select", { "aria-label": "Recipe from the next batch on", onchange: () => this._mark() },
      ...book.recipes.map(({ name }) => el("option", { textContent: name, value: name })));
    this._choose = el("button", { textContent: "Use from the next batch on", type: "submit" });
    this._plan = el("button", { textContent: "Follow the program", type: "button", onclick: () => this._ask("follow_plan", {}, "the recipes of the program") });
    this._answer = el("p", { className: "answer", "aria-live": "polite" });
    const part = book.path.slice(0, Math.max(0, book.path.lastIndexOf(".")));
    this._title = part ? `Recipes of ${inSentence(part)}` : "Recipes";
    this.element = el("section", { className: "part recipes", "data-book": book.path, "aria-label": this._title },
      el("h3", { textContent: this._title }),
      el("dl", { className: "recipe-facts" }, el("dt", { textContent: "begun last" }), el("dd", {}, this._begun), el("dt", { textContent: "next batch" }), el("dd", {}, this._next)),
      el("form", { className: "choose", onsubmit: (/** @type {Event} */ event) => this._submitted(event) }, this._select, this._choose, this._plan),
      this._answer,
      el("details", { className: "values" }, el("summary", { textContent: "Values" }), el("div", { className: "scroll" }, this._table())));
    this._mark();
  }

  /** A column for each recipe, a line for each value. */
  _table() {
    const { fields, recipes } = this._book;
    const head = el("tr", {}, el("th", { textContent: "value", scope: "col" }), ...recipes.map(({ name, hash }) => el("th", { textContent: name, title: hash, scope: "col", "data-recipe": name })));
    const lines = fields.map((field) => el("tr", {},
      el("th", { scope: "row", title: [field.range, unitOf(field)].filter(Boolean).join(" ") }, field.name, el("span", { className: "unit", textContent: ` ${unitOf(field)}`.trimEnd() })),
      ...recipes.map(({ name, values }) => el("td", { textContent: recipeText(values[field.name]), "data-recipe": name }))));
    this._values = el("table", {}, el("thead", {}, head), el("tbody", {}, ...lines));
    return this._values;
  }

  /** The column of the recipe in the list is told apart. */
  _mark() {
    for (const cell of this._values?.querySelectorAll("[data-recipe]") ?? []) cell.classList.toggle("picked", /** @type {HTMLElement} */ (cell).dataset.recipe === this._select.value);
  }

  /** @param {Event} event */
  _submitted(event) {
    event.preventDefault();
    this._ask("choose", { name: this._select.value }, this._select.value);
  }

  /** @param {string} action @param {Record<string, unknown>} given @param {string} what */
  async _ask(action, given, what) {
    this._say("sent", `${what}: …`);
    const { state, text } = await this._client.ask({ do: "call", path: `${this._book.path}.${action}`, arguments: given }, `${this._title}: ${what}`);
    this._say(state, state === "done" ? `${what}: chosen for the batches that begin from now on` : words({ what, state, text: text ?? "" }));
  }

  /** @param {string} state @param {string} text */
  _say(state, text) {
    setText(this._answer, text);
    this._answer.title = text;
    this._answer.dataset.state = state;
  }

  /** @param {Feed} feed */
  refresh(feed) {
    setText(this._begun, this._shown(feed, "begun"));
    setText(this._next, this._shown(feed, "choice"));
    const reason = this._client.barrier();
    this._select.disabled = !this._client.possible || feed.ended;
    allow(this._choose, reason);
    allow(this._plan, reason, PLAN);
    if (!this._answer.dataset.state) setText(this._answer, reason);
  }

  /** @param {Feed} feed @param {string} which */
  _shown(feed, which) {
    const path = `${this._book.path}.${which}`;
    const value = feed.latest(path)?.value;
    return statesOf(feed.entry(path))[String(value)] ?? "not shown";
  }
}
