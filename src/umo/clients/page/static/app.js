/** The page: which station and which view is shown, the header, the connection. */

import { address, allow, el, setText, store } from "./dom.js";
import { Feed } from "./feed.js";
import { Client, words } from "./client.js";
import { inSentence } from "./presentation.js";
import { FleetTable } from "./fleet_table.js";
import { list, nameOf, offer, runAfter } from "./stations.js";
import { clearing, faultsOf, forbidden, statusOf } from "./status.js";
import { nextTab } from "./tabs.js";
import { RecordingBar } from "./recording.js";

/** @type {Record<string, () => Promise<Page.ViewModule>>} */
const VIEWS = {
  scope: () => import("./scope.js"), machine: () => import("./machine.js"),
  twin: () => import("./twin.js"), operate: () => import("./operate.js"),
};

/** @template {HTMLElement} T @param {string} selector @returns {T} */
const byName = (selector) => /** @type {T} */ (document.querySelector(selector));

const feed = new Feed();
const client = new Client(feed);
new RecordingBar(/** @type {HTMLElement} */ (document.querySelector("#recording")), feed);
const main = byName("#view");
const status = byName("#status");
const notice = byName("#notice");
const summary = byName("#summary");
const reasons = byName("#forbidden");
const faults = byName("#faults");
let faultsShown = "";
const spoken = byName("#spoken");  // what is told; the seconds beside it change all the time
const seconds = byName("#seconds");
/** @type {HTMLButtonElement} */
const acknowledge = byName("#acknowledge");
/** @type {HTMLButtonElement} */
const stop = byName("#stop");
/** @type {HTMLSelectElement} */
const station = byName("#station");
/** @type {HTMLButtonElement} */
const newer = byName("#newer");
/** @type {HTMLButtonElement} */
const whole = byName("#whole");
/** @type {HTMLButtonElement[]} */
const tabs = [...document.querySelectorAll("button")].filter((button) => button.dataset.view);
/** @type {{name: string, run: string | null, view: Page.View | null} | null} */
let mounted = null;
const LATCHED = /latched: acknowledge it|one of many/;  // in the reason of an interlock whose cause is gone (umo/cycle)
const fleet = new FleetTable((name) => choose(name));
let asked = 0;
/** @type {{name: string, place: string, run: string} | null} */
let lastRun = null;

function viewName() {
  const name = address.get("view") ?? "";
  return Object.hasOwn(VIEWS, name) ? name : "scope";
}

/** Show the view of the address, or the list of stations if none is chosen. */
async function show() {
  const name = feed.description ? viewName() : "stations";
  for (const tab of tabs) {
    const chosen = tab.dataset.view === name;
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    tab.disabled = !feed.description;
  }
  const turn = ++asked;  // another view that is still being loaded is not shown any more
  if (mounted?.name === name && mounted.run === feed.run && name !== "stations") return;
  const loaded = name === "stations" ? null : await VIEWS[name]().catch(() => null);
  if (turn !== asked || (name !== "stations" && !loaded)) return;  // the server has gone in between: shown again when it is back
  mounted?.view?.close();
  const element = el("section", { className: name });
  main.replaceChildren(element);
  if (name === "stations") {
    main.removeAttribute("role");
    main.removeAttribute("aria-labelledby");
  } else {
    main.setAttribute("role", "tabpanel");
    main.setAttribute("aria-labelledby", `tab-${name}`);
  }
  mounted = { name, run: feed.run, view: loaded && new loaded.View(element, feed, client) };
  if (!loaded) list(element, feed, choose, fleet.element);
}

/** @param {string} name  "": the list. */
function choose(name) {
  address.set({ station: name, traces: null, colours: null });
  feed.watch(name);
}

/** What is wrong, or how the run ended, in place of the summary: the views do not move. */
function say() {
  const { connected, refused, unheard, station: name, description, state } = feed;
  const { kind, text, seconds: since } = statusOf({ connected, refused, unheard, station: name, period: description?.period ?? 0, state });
  for (const each of ["warn", "failed", "ended"]) status.classList.toggle(each, each === kind);
  setText(spoken, text);
  setText(seconds, since);
  notice.hidden = !text;
  summary.hidden = Boolean(text);
  document.body.classList.toggle("stale", kind === "warn");
  document.body.classList.toggle("ended", feed.ended);
  const after = feed.ended && feed.station ? runAfter(feed.stations, feed.station) : null;
  newer.hidden = !after;
  newer.value = after?.name ?? "";
  setText(newer, after ? `Show ${nameOf(after, feed.stations)}, which runs` : "");
  fold();
}

/** A text of more than two lines is cut, so that the views do not move by themselves, and shown whole on demand. */
function fold() {
  const open = status.classList.contains("whole");
  whole.hidden = !open && ![summary, notice, reasons, faults].some((each) => each.scrollHeight > each.clientHeight + 1);
  whole.setAttribute("aria-expanded", String(open));
  setText(whole, open ? "Show less" : "Show all");
}

/** The equipment in fault, each with the button that clears it: made anew only if they change. @param {Record<string, string> | undefined} found */
function showFaults(found) {
  const { shown, more } = faultsOf(found);
  const key = JSON.stringify([shown, more, client.possible && !feed.ended, client.barrier()]);
  if (key === faultsShown) return;
  faultsShown = key;
  const each = shown.flatMap(({ path, text }) => [clearButton(path), ` ${text} `]);
  faults.replaceChildren(...each, more ? `and ${more} more` : "");
}

/** @param {string} path */
function clearButton(path) {
  const button = clearing(path, () => command({ do: "clear", path }, `clear ${inSentence(path)}`));
  button.hidden = !client.possible || feed.ended;
  allow(button, client.barrier(), button.title);
  return button;
}

/** @param {string} text */
function announce(text) {
  const toast = el("div", { className: "toast", role: "status", textContent: text });
  document.body.append(toast);
  setTimeout(() => toast.remove(), 4000);
}

function onState() {
  const { state } = feed;
  if (!state) return;
  const { progress, missed, mode, driven, changed } = state.facts;
  const parts = [progress, `missed ${missed}`, mode, driven && `driven: ${driven}`];
  if (state.mode) parts.push(`control: ${client.leased ? "you" : client.holder || "nobody"}`);
  if (changed) parts.push(`▲ ${changed}`);
  setText(summary, parts.filter(Boolean).join(" · "));
  showFaults(state.faults);
  const why = forbidden(state.inhibited, state.faults).map((reason) => `⊘ ${reason}`).join("; ");
  setText(reasons, why);
  acknowledge.hidden = !LATCHED.test(why) || !client.possible || feed.ended;  // while its cause is there nothing can be acknowledged
  allow(acknowledge, client.barrier(), "Acknowledge the latched interlocks of the machine");
  document.title = `${feed.station} · umo`;
  stop.hidden = !client.possible || feed.ended;
  say();
}

feed.on("state", onState);
feed.on("connection", () => {
  say();
  if (!feed.description) show();
  if (feed.connected && lastRun) announce("The connection to the server is back.");
});
feed.on("fleet", () => fleet.update(feed.fleet));
feed.on("stations", () => {
  offer(station, feed);
  if (!feed.description) show();
});
feed.on("description", () => {
  if (feed.description) {
    const { name, place, run } = feed.description;
    if (lastRun?.name === name && lastRun.place === place && lastRun.run !== run) announce(`${name} has started again.`);
    lastRun = { name, place, run };
  } else {
    setText(summary, "");
    setText(reasons, "");
    showFaults({});
    stop.hidden = acknowledge.hidden = true;
  }
  status.classList.remove("whole");
  offer(station, feed);
  say();
  show();
});

for (const [place, tab] of tabs.entries()) {
  tab.onclick = () => {
    address.set({ view: tab.dataset.view ?? null });
    show();
  };
  tab.onkeydown = (event) => {
    const next = nextTab(event.key, place, tabs.length);
    if (next === null) return;
    event.preventDefault();
    tabs[next].focus();
    tabs[next].click();
  };
}
byName("#home").onclick = (event) => {
  event.preventDefault();
  choose("");
};
station.onchange = () => choose(station.value);
newer.onclick = () => {  // of the same machine: the traces stay
  address.set({ station: newer.value });
  feed.watch(newer.value);
};
whole.onclick = () => {
  status.classList.toggle("whole");
  say();
};

/** A command from the header; what comes of it is said. @param {{do: string, path?: string}} message @param {string} what */
async function command(message, what) {
  const answer = await client.ask(message, what);
  if (answer.state !== "done") announce(words(client.asked[0]));
}

stop.onclick = () => command({ do: "stop" }, `end the run of ${feed.station}`);
acknowledge.onclick = () => command({ do: "acknowledge", path: "" }, "acknowledge");
byName("#theme").onclick = () => {
  const dark = getComputedStyle(document.documentElement).colorScheme.includes("dark");
  const theme = dark ? "light" : "dark";
  document.documentElement.dataset.theme = theme;
  store.set("theme", theme);
  window.dispatchEvent(new Event("theme"));
};
window.addEventListener("hashchange", () => {
  const name = address.get("station");
  if (name && name !== feed.station) feed.watch(name);
  else if (mounted) {
    mounted.run = null;
    show();
  }
});
document.addEventListener("keydown", (event) => {
  const target = /** @type {Element} */ (event.target);
  if (target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
  const tab = tabs[Number(event.key) - 1];
  if (tab && !tab.disabled) tab.click();
});

// the token has become a cookie; it need not stay in the address
if (location.search) history.replaceState(null, "", location.pathname + location.hash);
feed.wanted = address.get("station");
feed.start();
setInterval(say, 1000);
show();
