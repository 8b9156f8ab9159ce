/** Who has control (the lease) and the mode, and how this page comes to it. */

import { words } from "./client.js";
import { allow, el, setText, store } from "./dom.js";

/**
 * @typedef {import("./feed.js").Feed} Feed
 * @typedef {import("./client.js").Client} Client
 */

const MODES = ["automatic", "manual"];
const AUTOMATIC = "Automatic mode: the program drives the actuators. You can use the commands of the parts, recipes, numbers and some actions. In manual mode you can use everything.";

export class LeaseBar {
  /** @param {Feed} feed @param {Client} client @param {{automatic?: string, answers?: boolean}} [how]  `automatic`: what is said in automatic mode; `answers`: whether a refusal is told here. */
  constructor(feed, client, { automatic = AUTOMATIC, answers = false } = {}) {
    this._automatic = automatic;
    this._answers = answers;
    this._feed = feed;
    this._client = client;
    /** @type {string | null} */
    this._sure = null;
    this._holder = el("span", { className: "holder" });
    this._name = el("input", { type: "text", placeholder: "Your name", maxLength: 40, "aria-label": "Your name", value: store.get("name"), onchange: () => store.set("name", this._name.value) });
    this._take = el("button", { onclick: () => this._taken() });
    this._give = el("button", { textContent: "Give control back", onclick: () => client.giveBack() });
    this._mode = MODES.map((mode) => el("button", { textContent: mode, "data-mode": mode, onclick: () => client.ask({ do: "mode", value: mode }, `mode ${mode}`) }));
    this._why = el("span", { className: "hint" });
    this.element = el("div", { className: "bar lease" }, this._holder, this._name, this._take, this._give,
      el("span", { className: "modes", role: "group", "aria-label": "Mode" }, ...this._mode), this._why);
  }

  /** Taking over from another client needs a second click. */
  _taken() {
    const { holder } = this._client;
    if (holder && this._sure !== holder) {
      this._sure = holder;
      this.refresh();
      return;
    }
    this._sure = null;
    this._client.take(this._name.value, Boolean(holder));
  }

  refresh() {
    const client = this._client;
    const { ended, station, state } = this._feed;
    setText(this._holder, ended ? `${station} has ended.` : client.leased ? "You have control." : client.holder ? `${client.holder} has control.` : "Nobody has control.");
    setText(this._take, !client.holder ? "Take control" : this._sure === client.holder ? `Yes, take it over from ${client.holder}` : "Take it over");
    this._take.hidden = this._name.hidden = client.leased || !client.possible || ended;
    this._give.hidden = !client.leased;
    for (const button of this._mode) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === state?.mode));
      allow(button, client.barrier());
    }
    const [last] = client.asked;
    const refused = this._answers && last && ["refused", "failed"].includes(last.state);
    setText(this._why, refused ? `✕ ${words(last)}` : ended ? "" : why(this._feed, client) || (client.manual ? "" : this._automatic));
    this._why.classList.toggle("failed", Boolean(refused));
  }
}

/** What keeps the controls from being used. @param {Feed} feed @param {Client} client */
function why(feed, client) {
  if (feed.description?.recording) return "This is a recording. The page shows the values at the time above.";
  if (!feed.server?.operate) return "This page is read-only. `umo show page --operate` lets it operate.";
  if (!feed.state?.mode) return `${feed.station} takes no commands.`;
  return client.leased ? "" : "Give your name and take control, then everything below can be used. Only one client has control at a time, and everybody sees its name.";
}
