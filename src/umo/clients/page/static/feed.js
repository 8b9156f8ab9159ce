/** The connection to the server: stations, states, and traces against time. It reconnects by itself. */

const MAX_EVENTS = 1000;  // that are kept, and as many missed periods
const RETRY_PAUSES = [250, 500, 1000, 2000];  // ms from one attempt to the next

/**
 * @typedef {"stations" | "fleet" | "description" | "state" | "connection"} Kind
 * @typedef {{paths: string[], start: number, stop: number}} Stretch
 */

/** The numbers of a binary message. @param {ArrayBuffer} buffer @returns {{head: {id: number, window?: boolean}, points: Page.Points & {id: number}}} */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const { count, traces, same } = head;
  let at = 4 + length;
  const take = () => {
    const part = new Float64Array(buffer, at, count);
    at += 8 * count;
    return part;
  };
  const times = take();
  const low = Array.from({ length: traces }, take);
  const high = same ? low : Array.from({ length: traces }, take);
  return { head, points: { ...head, times, low, high } };
}

/** The connection was lost before an answer came: whether what was asked for was done is not known. */
export class ConnectionLost extends Error {}

/**
 * Events that were told before, and the last ones, which the server tells with each new one.
 * @param {Page.Event[]} known @param {Page.Event[]} last @returns {Page.Event[]}
 */
export function joined(known, last) {
  const [first] = last;
  if (!first) return known;
  const same = known.findLastIndex(({ time, path, text, command, state }) => time === first.time && path === first.path && text === first.text && command === first.command && state === first.state);
  const before = same < 0 ? known.filter(({ time }) => time < first.time) : known.slice(0, same);
  return [...before, ...last].slice(-MAX_EVENTS);
}

export class Feed {
  constructor() {
    this.connected = false;
    this.refused = false;
    /** @type {Page.Server | null} */
    this.server = null;
    /** @type {Page.Line[]} */
    this.stations = [];
    /** Whether the list of stations has come since the connection was made: before, nothing is known about them. */
    this.listed = false;
    /** @type {Page.FleetRow[]} The stations of all computers, where the server follows a fleet. */
    this.fleet = [];
    /** @type {string | null} Name of the run to show; "": the list of stations; null: what the server chooses. */
    this.wanted = null;
    /** @type {string | null} Its folder: another server may know another station by that name; null: not known. */
    this._place = null;
    /** @type {Page.Description | null} */
    this.description = null;
    /** @type {Page.State | null} */
    this.state = null;
    /** @type {Page.Entry[]} Objects and signals. */
    this.entries = [];
    /** @type {number[]} Places in `entries` of what the last state has changed. */
    this.changed = [];
    /** @type {Map<string, number>} */
    this._index = new Map();
    /** @type {number[][]} */
    this._values = [];
    /** @type {Page.Event[]} Those of the run that this page was told, the newest last. */
    this.events = [];
    /** @type {[number, number][]} When periods were missed, and how many. */
    this.misses = [];
    /** @type {Map<Kind, Set<() => void>>} */
    this._listeners = new Map();
    /** @type {Map<number, {listener: (news: any) => void, begin: () => void}>} */
    this._subscriptions = new Map();
    /** @type {Map<number, {resolve: (message: any) => void, reject: (error: Error) => void, onBegun: (message: any) => void}>} */
    this._waiting = new Map();
    /** @type {WebSocket | null} */
    this._socket = null;
    this._id = 0;
    this._attempt = 0;
    this._heard = 0;
  }

  /** Name of the run that is shown. */
  get station() { return this.description ? this.description.name : null; }

  /** Whether the run that is shown is over: what is shown are its last values. */
  get ended() { return this.state?.stage === "ended"; }

  /** Id of the run that is shown: it changes when the station is started again. */
  get run() { return this.description ? this.description.run : null; }

  start() {
    const socket = new WebSocket(new URL("ws", location.href.split("#")[0].split("?")[0]).href.replace(/^http/, "ws"));
    socket.binaryType = "arraybuffer";
    this._socket = socket;
    socket.onopen = () => {
      if (this.wanted !== null) this._choose();
    };
    socket.onmessage = ({ data }) => (typeof data === "string" ? this._text(JSON.parse(data)) : this._binary(data));
    socket.onclose = ({ code }) => this._closed(code);
  }

  /** @param {number} code */
  _closed(code) {
    const was = this.connected;
    this.connected = this.listed = false;
    const refused = code === 4401;
    const news = was || this._attempt === 0 || refused !== this.refused;
    this.refused = refused;
    for (const { reject } of this._waiting.values()) reject(new ConnectionLost("the connection to the server is lost"));
    this._waiting.clear();
    if (news) this._emit("connection");
    setTimeout(() => this.start(), RETRY_PAUSES[Math.min(this._attempt++, RETRY_PAUSES.length - 1)]);
  }

  /** @param {any} message */
  _text(message) {
    const known = /** @type {any} */ (this)[`_on_${message.type}`];
    if (known) known.call(this, message);
    else this._answer(message);
  }

  /** The first message. Before it the server may still refuse this page: it closes the socket with 4401. @param {Page.Server} message */
  _on_server(message) {
    this.server = message;
    this._attempt = 0;
    this.connected = true;
    this._emit("connection");
  }

  /** @param {{stations: Page.Line[]}} message */
  _on_stations({ stations }) {
    this.stations = stations;
    this.listed = true;
    if (this.description && !stations.some(({ name, place }) => name === this.station && place === this._place)) this._forget();  // e.g. ended while the server was away
    this._emit("stations");
  }

  /** @param {{stations: Page.FleetRow[]}} message */
  _on_fleet({ stations }) {
    this.fleet = stations;
    this._emit("fleet");
  }

  /** @param {Page.Description} message */
  _on_description(message) {
    if (this.wanted !== null && message.name !== this.wanted) return;  // sent before the server knew what this page shows
    this.description = message;
    this.wanted = message.name;
    this._place = message.place;
    this._heard = performance.now();
    this.entries = [...message.objects, ...message.signals];
    this._index = new Map(this.entries.map((entry, index) => [entry.path, index]));
    this._values = [];
    this.state = null;
    this.events = [];
    this.misses = [];
    this._emit("description");
    for (const subscription of this._subscriptions.values()) subscription.begin();
  }

  /** @param {Page.State} message */
  _on_state(message) {
    if (message.run !== this.run) return;
    if (message.full) this._values = [];
    this.changed = Object.keys(message.values).map(Number);
    for (const index of this.changed) this._values[index] = message.values[index];
    this.state = message;
    this.events = message.events ? joined(this.events, message.events) : this.events;
    const { misses } = message;
    if (misses) this.misses = [...this.misses.filter(([time]) => time < misses[0]?.[0]), ...misses].slice(-MAX_EVENTS);
    this._heard = performance.now();
    this._emit("state");
  }

  /** @param {Page.Extremes} message */
  _on_extremes(message) { this._subscriptions.get(message.id)?.listener(message); }

  /** @param {{id: number, text: string}} message */
  _on_error(message) {
    if (!this._answer(message, true)) console.warn(message.text);
  }

  /** @param {any} message */
  _answer(message, failed = false) {
    const waiting = this._waiting.get(message.id);
    if (!waiting) return false;
    if (message.state === "begun") {
      waiting.onBegun(message);
      return true;
    }
    this._waiting.delete(message.id);
    if (failed) waiting.reject(new Error(message.text));
    else waiting.resolve(message);
    return true;
  }

  /** @param {ArrayBuffer} data */
  _binary(data) {
    const { head, points } = unpack(data);
    if (head.window) this._answer(points);
    else this._subscriptions.get(head.id)?.listener(points);
  }

  /** Show another run; "": the list of stations. @param {string} name */
  watch(name) {
    this.wanted = name;
    this._place = this.stations.find((line) => line.name === name)?.place ?? null;
    this._forget();
    if (this.connected) this._choose();
  }

  _choose() { this._send({ type: "watch", name: this.wanted, place: this._place }); }

  _forget() {
    this.description = this.state = null;
    this._emit("description");
  }

  /** s since the last state came. */
  get unheard() { return (performance.now() - this._heard) / 1000; }

  /** The present value of an object or signal; null: it is not known. @param {string} path @returns {Page.Sample | null} */
  latest(path) {
    const found = this._values[this._index.get(path) ?? -1];
    if (!found) return null;
    const [value, raw = null, quality = 0] = found;
    return { value, raw, quality, time: this.state?.time };
  }

  /** The unit or states of an object or signal. @param {string} path @returns {Page.Entry | null} */
  entry(path) { return this.entries[this._index.get(path) ?? -1] ?? null; }

  /** s on the station's clock between which the server knows the history. */
  range() { return { start: this.state?.start ?? 0, stop: this.state?.stop ?? 0 }; }

  /**
   * Points about 30 times a second, until `close`.
   * @param {{paths: string[], span: number, width: number, trigger?: object}} request
   * @param {(points: Page.Points) => void} listener
   */
  subscribe(request, listener) {
    return this._follow(listener, (id) => {
      const known = request.paths.every((path) => this._index.has(path));
      if (known) this._send({ type: "live", id, ...request });
    });
  }

  /** The least and the greatest values of the run, when they change, until `close`. `anew`: from now on. @param {boolean} anew @param {(extremes: Page.Extremes) => void} listener */
  followExtremes(anew, listener) { return this._follow(listener, (id) => this._send({ type: "extremes", id, anew })); }

  /** @param {(news: any) => void} listener @param {(id: number) => void} ask  Whenever there is a run. */
  _follow(listener, ask) {
    const id = ++this._id;
    const begin = () => { if (this.connected && this.description) ask(id); };
    this._subscriptions.set(id, { listener, begin });
    begin();
    return {
      close: () => {
        this._subscriptions.delete(id);
        if (this.connected) this._send({ type: "stop", id });
      },
    };
  }

  /** The history between two times, reduced to `width` pixels. @param {Stretch & {width: number}} request @returns {Promise<Page.Points>} */
  window(request) { return this._ask({ type: "window", ...request }); }

  /** Minimum, maximum, mean, rms and frequency of all samples between two times; of a state the share of time and the changes. @param {Stretch} request @returns {Promise<{values: (Record<string, number> | null)[]}>} */
  measure(request) { return this._ask({ type: "measure", ...request }); }

  /** The gains of a law from the history. @param {{facts: object, start: number, stop: number, relay: boolean}} request @returns {Promise<Page.Tuned>} */
  tuneLaw(request) { return this._ask({ type: "tune law", ...request }); }

  /**
   * A command for the station. @param {object} message @returns {Promise<Page.Answer>} its end, in the machine's words.
   * @param {(answer: Page.Answer) => void} [onBegun] Called when a long action has begun.
   */
  command(message, onBegun = () => {}) { return this._ask({ ...message, type: "command" }, onBegun); }

  /** Move the time of a recording. @param {{time?: number, playing: boolean, speed: number}} played */
  play(played) { this._send({ type: "play", ...played }); }

  /** Answer a state with what this page holds: it proves that the page is there. @param {string[]} held */
  touch(held) { this._send({ type: "touch", number: this.state?.number ?? 0, held }); }

  /** A GET from this server as JSON; Error with the status otherwise. @param {string} path @returns {Promise<any>} */
  async json(path) {
    const response = await fetch(path, { credentials: "same-origin" });
    if (!response.ok) throw new Error(`${path}: ${response.status}`);
    return response.json();
  }

  /** @param {object} message @param {(answer: any) => void} onBegun @returns {Promise<any>} */
  _ask(message, onBegun = () => {}) {
    if (!this.connected) return Promise.reject(new Error("there is no connection to the server"));
    const id = ++this._id;
    return new Promise((resolve, reject) => {
      this._waiting.set(id, { resolve, reject, onBegun });
      this._send({ ...message, id });
    });
  }

  /** @param {object} message */
  _send(message) {
    if (this._socket?.readyState === WebSocket.OPEN) this._socket.send(JSON.stringify(message));
  }

  /** Call a listener on "stations", "fleet", "description", "state" or "connection"; the result ends that. @param {Kind} kind @param {() => void} listener @returns {() => void} */
  on(kind, listener) {
    const all = this._listeners.get(kind) ?? new Set();
    this._listeners.set(kind, all.add(listener));
    return () => { all.delete(listener); };
  }

  /** @param {Kind} kind */
  _emit(kind) { for (const listener of [...(this._listeners.get(kind) ?? [])]) listener(); }
}
