/** What the server tells (umo/clients/page/watched_run.py), and what the modules of the page give each other. */

declare namespace Page {
  /** An object or a signal. */
  interface Entry {
    path: string;
    kind?: string;
    unit?: string;
    /** The unit as it is shown. */
    look?: string;
    /** After the point; null: six significant ones. */
    digits?: number | null;
    one?: string;
    zero?: string;
    /** Of a named value: the names by number. */
    states?: Record<string, string>;
    minimum?: number;
    maximum?: number;
    /** Both in words, without the unit. */
    range?: string;
    wire?: string;
    /** Kind, range and default of an object, in words. */
    declared?: string;
    synchronous?: boolean;
    /** Of a recording that is laid over another one. */
    second?: boolean;
    actuator?: boolean;
  }

  /** A number, a choice or a text that is given. */
  interface Argument {
    name: string;
    kind?: string;
    unit?: string;
    look?: string;
    minimum?: number;
    maximum?: number;
    /** Both in words, without the unit. */
    range?: string;
    choices?: string[];
    default?: unknown;
    required?: boolean;
  }

  interface Action { path: string; help: string; arguments: Argument[]; harmless: boolean; apart: boolean; dead_man: boolean }

  /** A state machine (umo/operation): states, and where commands lead, by the numbers of states. */
  interface Unit {
    path: string;
    /** Path of the part that has it. */
    part: string;
    model: string;
    states: Record<string, string>;
    /** Column and row of each in the diagram. */
    in_manual: string[];
    places: Record<string, [number, number]>;
    acting: Record<string, number>;
    commands: Record<string, Record<string, number>>;
  }

  /** A book of recipes (umo/operation/recipe_book.py): what they consist of, and those that were read at the start. */
  interface Book {
    path: string;
    fields: { name: string; unit?: string; look?: string; range?: string }[];
    recipes: { name: string; hash: string; values: Record<string, unknown> }[];
  }

  /** An alarm that is not normal (umo/process/frames/alarm_list.py); what can be done with it. */
  interface Alarm {
    path: string;
    state: string;
    priority: string;
    text: string;
    /** s on the cycle's clock; null: not known any more. */
    since: number | null;
    who: string;
    note: string;
    /** s on the cycle's clock: the end of its shelving; null: not shelved, or not known. */
    until: number | null;
    annunciated: boolean;
    /** Its condition is true, or cannot be evaluated. */
    active: boolean;
    asks: boolean;
    /** Names of the verbs that do something with it now. */
    verbs: string[];
  }

  /** What can be asked of a machine (umo/clients/verb.py). */
  interface Verb {
    name: string;
    help: string;
    /** What its path names; "nothing": it has none. */
    names: string;
    role: string;
    arguments: { name: string; kind: string; help: string; required: boolean; range: string; unit?: string; minimum?: number; maximum?: number; choices?: string[] }[];
    needs_lease: boolean;
    only_manual: boolean;
    of_lease: boolean;
    /** Whether what it does may last only as long as this page holds its path. */
    holds: boolean;
  }

  /** What a law is made of (umo/control/experiment.py). */
  interface LawFacts { law: string; sensor: string; actuator: string; low?: number | null; high?: number | null; dt: number; axis: boolean }

  interface GainSet {
    name: string;
    rule: string;
    gain_margin: number | null;
    phase_margin: number | null;
    overshoot: number | null;
    settling_time: number | null;
    /** By the names of the law. */
    settings: Record<string, number | null>;
  }

  /** The gains of a law (umo/clients/page/tuning_answer.py). */
  interface Tuned {
    model: { kind: string; fit: number; as_good: string[] };
    inner?: { law: string; time: number | null; times_faster: number | null };
    sets: GainSet[];
    times: number[];
    measured: (number | null)[];
    predicted: (number | null)[];
    steps: Record<string, { times: number[]; values: (number | null)[] }>;
  }

  interface Tunable { path: string; name: string; unit?: string; look?: string; minimum?: number; maximum?: number; range?: string }

  interface Description {
    name: string;
    run: string;
    station: string;
    wiring: string;
    place: string;
    pid: number;
    period: number;
    objects: Entry[];
    signals: Entry[];
    actions: Action[];
    tunables: Tunable[];
    units: Unit[];
    books: Book[];
    /** Whether the machine has alarms. */
    alarms: boolean;
    /** All that can be asked; a recording has none. */
    verbs?: Verb[];
    twin: boolean;
    /** Of a recording: its files; `second`: what stands before the paths of the other one; `replay`: the
     *  beginning of the command that replays it, empty: it cannot be replayed. */
    recording?: { files: { file: string; whole: boolean; lost: number }[]; second: string; replay: string };
    qualities: [string, string][];
    /** Of a station that runs: who can drive an actuator, in words, and what comes next, by rank. */
    drivers?: Record<string, [string, string]>;
  }

  interface Ending { failed: boolean; text: string }

  interface Event { time: number; path: string; text: string; who: string; command: number; state: string; asked: string }

  interface State {
    run: string;
    number: number;
    stage: string;
    box: string;
    missed: number;
    lost: number;
    start: number;
    stop: number;
    silent: number;
    ages: Record<number, number | null>;
    ending: Ending | null;
    utc: number | null;
    time?: number;
    /** By name, in the order in which they are shown. */
    facts: Record<string, string>;
    inhibited?: Record<string, string>;
    /** Equipment in fault: the reason, by path. */
    faults?: Record<string, string>;
    /** Paths of the actuators that a client has taken. */
    by_client?: string[];
    /** Paths of those among the inhibited actuators whose equipment is in fault. */
    in_fault?: string[];
    /** Number of the last command that the machine had taken in the period that is shown. */
    taken?: number;
    alarms?: Alarm[];
    mode?: string;
    tuned?: Record<string, number | null>;
    lease?: { number: number; holder: string };
    events?: Event[];
    misses?: [number, number][];
    full: boolean;
    /** Of a recording: the time that is shown, s on the station's clock. */
    recording?: { time: number; asked: number | null; playing: boolean; speed: number };
    values: Record<number, number[]>;
  }

  interface Server { station: string | null; operate: boolean; version: string }

  interface Line { name: string; station: string; place: string; stage: string; wiring: string; ending?: Ending;
    /** Equipment in fault and alarms of a run that goes on, in words. */
    faults?: string[]; alarms?: string[]; changed?: string }

  /** A station of a fleet (umo/clients/page/fleet_feed.py). */
  interface FleetRow {
    name: string;
    wiring: string;
    /** Whether it is there now; else the rest is what it told last. */
    present: boolean;
    state: string;
    mode: string;
    lease: string;
    missed: number;
    /** How many are not normal. */
    alarms: number;
    alarm: string;
    /** Equipment in fault, by its path. */
    faults: string[];
    progress: string;
  }

  /** A value with what is known of it. */
  interface Sample { value: number | null; raw: number | null; quality: number; time?: number }

  /** Per trace the least and the greatest value of each point; NaN: no value. */
  interface Points {
    times: Float64Array;
    low: Float64Array[];
    high: Float64Array[];
    from: number;
    trigger?: number;
    start?: number;
  }

  /** The least and the greatest values, by place in the entries. `full`: all that there are; `since`: s on the station's clock. */
  interface Extremes { id: number; full: boolean; since: number | null; values: Record<number, [number, number]> }

  /** `command`: its number, which its events have too. */
  interface Answer { state: string; text: string; command?: number; lease?: number }

  /** A line on the scope. `index`: its place in the buffer. */
  interface Trace { path: string; entry: Entry; index: number; colour: number }

  /** Something that happened, on the scope. */
  interface Mark { time: number; kind: "fault" | "alarm" | "missed" | "guard" | "command" | "mode" | "over" | "told"; text: string }

  /** Marks that stand close together; `time`: of the first, `kind`: of the gravest. */
  interface Cluster { time: number; marks: Mark[]; kind: Mark["kind"] }

  /** A value that moves a body, and how (umo/plant/twin/declared.py). */
  interface Joint { kind: string; path: string; axis: [number, number, number]; factor: number; offset: number; range: [number, number] | null; anchor: [number, number, number] }

  interface Colour { path: string; stops: [number, string][]; shape: number | null }

  interface Carried { sensor: string; speed: string; level: number; factor: number; offset: number; over: number; size: [number, number]; colour: string }

  interface Shape { kind: string; size: number[]; position: [number, number, number]; rotation: [number, number, number, number]; colour: string; opacity: number; vertices: number[]; faces: number[] }

  interface Body {
    name: string;
    parent: string;
    position: [number, number, number];
    rotation: [number, number, number, number];
    joints: Joint[];
    colours: Colour[];
    visible: { path: string; level: number }[];
    carried: Carried[];
    shapes: Shape[];
  }

  interface Twin {
    bodies: Body[];
    paths: Entry[];
    view: { target: [number, number, number]; eye: [number, number, number] } | null;
    floor: number | null;
    error?: string;
  }

  /** A value with its quality, 0 good ... 4 bad. `last`: of a run that has ended. */
  interface TwinSample { value: number; quality: number; last?: boolean }

  interface View { close(): void }
  interface ViewModule { View: new (element: HTMLElement, feed: import("./feed.js").Feed, client: import("./client.js").Client) => View }
}

interface Window { uPlot: typeof import("uplot") }
