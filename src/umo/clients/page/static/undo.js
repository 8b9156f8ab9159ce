/** The values that tunable numbers had before this page changed them. */

const MAX_CHANGES = 50;  // of one number

export class Undo {
  constructor() {
    /** @type {Map<string, number[]>} */
    this._before = new Map();
  }

  /** @param {string} path @param {number} value  Before a change. */
  push(path, value) { this._before.set(path, [...(this._before.get(path) ?? []), value].slice(-MAX_CHANGES)); }

  /** The value before the last change that was not undone; null: there is none. @param {string} path */
  last(path) { return this._before.get(path)?.at(-1) ?? null; }

  /** The last change was undone. @param {string} path */
  pop(path) { this._before.set(path, (this._before.get(path) ?? []).slice(0, -1)); }

  clear() { this._before.clear(); }
}
