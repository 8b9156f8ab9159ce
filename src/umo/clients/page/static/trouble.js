/** Which values are not good: they stand first in the machine. One that is good again stays there for a while. */

const STAYS = 5;  // s for which a value that is good again stays with those that are not

export class Trouble {
  constructor() {
    /** @type {Map<number, number>} The places of these values, and when each was last seen not to be good, s. */
    this._seen = new Map();
  }

  /** See the present qualities, 0: good. @param {Iterable<[number, number]>} qualities  By place. @param {number} now  s. */
  look(qualities, now) {
    for (const [place, quality] of qualities) if (quality > 0) this._seen.set(place, now);
    for (const [place, seen] of this._seen) if (now - seen > STAYS) this._seen.delete(place);
  }

  /** The places, in the order of the machine. */
  get places() { return [...this._seen.keys()].sort((one, other) => one - other); }
}
