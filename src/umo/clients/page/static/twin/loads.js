/** Loads on a belt, found from the past of a sensor and of the belt's speed. */

/** @typedef {{level: number, factor: number, offset: number, over: number}} Load */

/**
 * The places of the loads at the last of the times, the first that came first.
 * @param {Load} load  speed in m/s: factor * value + offset
 * @param {ArrayLike<number>} times s, rising
 * @param {ArrayLike<number>} sensor
 * @param {ArrayLike<number>} speed
 * @param {number} now s: later samples do not count
 * @returns {[number, number][]} front and rear of each in m from the sensor
 */
export function loadsAt({ level, factor, offset, over }, times, sensor, speed, now) {
  /** @type {{front: number, rear: number | null}[]} */
  const found = [];
  let travel = 0;
  /** @type {{front: number, rear: number | null} | null} */
  let open = null;
  let before = true; // a load that is there at the beginning came at a time that is not known
  for (let i = 0; i < times.length && times[i] <= now; i += 1) {
    if (i > 0) travel += way(speed[i - 1], speed[i], factor, offset) * (times[i] - times[i - 1]);
    const there = sensor[i] === level;
    if (there && !before) {
      open = { front: travel, rear: null };
      found.push(open);
    } else if (!there && open) {
      open.rear = travel;
      open = null;
    }
    before = there;
  }
  return found
    .map(({ front, rear }) => /** @type {[number, number]} */ ([travel - front, rear === null ? 0 : travel - rear]))
    .filter(([front]) => front <= over);
}

/** @param {number} one @param {number} other @param {number} factor @param {number} offset */
function way(one, other, factor, offset) {
  const mean = Number.isFinite(one) && Number.isFinite(other) ? (one + other) / 2 : NaN;
  return Number.isFinite(mean) ? factor * mean + offset : 0;
}
