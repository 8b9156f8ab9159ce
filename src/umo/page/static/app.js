/** The page: which station and which view is shown, the header, the connection. */

import { address, el, setText, store } from "./dom.js";
import { Feed } from "./feed.js";
import { Hand, words } from "./hand.js";

const VIEWS = {
  scope: () => import("./scope.js"), machine: () => import("./machine.js"),
  twin: () => import("./twin.js"), hands: () => import("./hands.js"),
};
const SILENT = 1;  // s without news, after which the page says so

const feed = new Feed();
const hand = new Hand(feed);
const main = document.querySelector("#view");
const notice = document.querySelector("#notice");
const summary = document.querySelector("#summary");
const stop = document.querySelector("#stop");
let mounted = null;  // {name, run, module}
let asked = 0;
let lastRun = null;

function viewName() {
  const name = address.get("view");
  return Object.hasOwn(VIEWS, name) ? name : "scope";
}

/** Show the view of the address, or the list of stations if none is chosen. */
async function show() {
  const name = feed.description ? viewName() : "stations";
  for (const tab of document.querySelectorAll("[data-view]")) {
    tab.setAttribute("aria-selected", String(tab.dataset.view === name));
    tab.disabled = !feed.description;
  }
  const turn = ++asked;  // another view that is still being loaded is not shown any more
  if (mounted?.name === name && mounted.run === feed.run && name !== "stations") return;
  const module = name === "stations" ? { mount: mountStations, unmount() {} } : await VIEWS[name]().catch(() => null);
  if (turn !== asked || !module) return;  // the server has gone in between: shown again when it is back
  mounted?.module.unmount();
  const element = el("section", { className: name, "aria-label": name });
  main.replaceChildren(element);
  mounted = { name, run: feed.run, module };
  module.mount(element, feed, hand);
}

/** The list of running stations, and what to type if there is none. */
function mountStations(element) {
  const lines = feed.stations.map((station) => el("li", {}, el("button", {
    textContent: `${station.name}${station.wiring ? ` (${station.wiring})` : ""}: ${station.stage}`,
    onclick: () => choose(station.name),
  })));
  if (lines.length) element.append(el("h2", { textContent: "Stations" }), el("ul", {}, ...lines));
  const missing = feed.wanted && !feed.stations.some(({ name }) => name === feed.wanted);
  const text = missing ? `${feed.wanted} is not running. ` : lines.length ? "" : "No station is running. ";
  element.append(el("p", { textContent: `${text}Start one in a terminal:` }));
  const name = feed.wanted || "ztheta";
  element.append(el("pre", { textContent: `umo run ${name} --realtime` }));
  element.append(el("p", { textContent: "It appears here by itself." }));
}

function choose(name) {
  address.set({ station: name, traces: null });
  feed.watch(name);
}

function say() {
  const stage = feed.state?.stage;
  let text = "";
  if (!feed.connected) {
    text = "The connection to the server is lost. The page tries again by itself.";
    if (feed.refused) text = "The server refuses this page. Open the address that `umo view` has printed.";
  } else if (stage === "ended") text = `${feed.station} has ended. The page waits for it to start again.`;
  else if (feed.description && feed.unheard > SILENT) text = `Nothing heard from the server for ${feed.unheard.toFixed(0)} s.`;
  else if (feed.state?.silent > SILENT) text = `No new frame for ${feed.state.silent.toFixed(0)} s.`;
  setText(notice, text);
  notice.hidden = !text;
  document.body.classList.toggle("stale", Boolean(text));
}

function announce(text) {
  const toast = el("div", { className: "toast", role: "status", textContent: text });
  document.body.append(toast);
  setTimeout(() => toast.remove(), 4000);
}

function onState() {
  const { progress, missed, mode } = feed.state;
  const [text = "", done = 0, total = 0] = progress ?? [];
  const parts = [feed.station, text + (total ? `, ${done} of ${total}` : ""), `missed ${missed}`];
  if (mode) parts.push(mode);
  if (hand.holder) parts.push(`lease: ${hand.leased ? "you" : hand.holder}`);
  setText(summary, parts.filter(Boolean).join(" · "));
  document.title = `${feed.station} · umo`;
  stop.hidden = !hand.possible || feed.state.stage === "ended";
  say();
}

feed.on("state", onState);
feed.on("connection", () => {
  say();
  if (feed.connected && lastRun) announce("The connection to the server is back.");
});
feed.on("server", () => {
  feed.wanted ??= feed.server.station;
});
feed.on("stations", () => { if (!feed.description) show(); });
feed.on("description", () => {
  if (feed.description) {
    if (lastRun?.name === feed.station && lastRun.run !== feed.run) announce(`${feed.station} has started again.`);
    lastRun = { name: feed.station, run: feed.run };
  } else {
    setText(summary, "");
    stop.hidden = true;
  }
  say();
  show();
});

for (const tab of document.querySelectorAll("[data-view]")) {
  tab.onclick = () => {
    address.set({ view: tab.dataset.view });
    show();
  };
}
document.querySelector("#home").onclick = (event) => {
  event.preventDefault();
  address.set({ station: null, traces: null });
  feed.watch("");
};
stop.onclick = async () => {
  const answer = await hand.ask({ do: "stop" }, `stop ${feed.station}`);
  if (answer.state !== "done") announce(words(hand.asked[0]));
};
document.querySelector("#theme").onclick = () => {
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
  if (event.target.matches("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
  const tab = document.querySelectorAll("[data-view]")[Number(event.key) - 1];
  if (tab && !tab.disabled) tab.click();
});

// the token has become a cookie; it need not stay in the address
if (location.search) history.replaceState(null, "", location.pathname + location.hash);
feed.wanted = address.get("station");
feed.start();
setInterval(say, 1000);
show();
