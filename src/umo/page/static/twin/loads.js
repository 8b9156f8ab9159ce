/** Loads on a belt, found from the past of a sensor and of the belt's speed. */

/**
 * The places of the loads at the last of the times, the first that came first.
 * @param {{level: number, factor: number, offset: number, over: number}} load  speed in m/s: factor * value + offset
 * @param {Float64Array} times s, rising
 * @param {Float64Array} sensor
 * @param {Float64Array} speed
 * @param {number} now s: later samples do not count
 * @returns {[number, number][]} front and rear of each in m from the sensor
 */
export function loadsAt({ level, factor, offset, over }, times, sensor, speed, now) {
  const found = [];
  let travel = 0;
  let open = null;
  for (let i = 0; i < times.length && times[i] <= now; i += 1) {
    if (i > 0) travel += way(speed[i - 1], speed[i], factor, offset) * (times[i] - times[i - 1]);
    const there = sensor[i] === level;
    if (there && !open) {
      open = i > 0 ? { front: travel, rear: null } : null; // that at the beginning came at a time that is not known
      if (open) found.push(open);
    } else if (!there && open) {
      open.rear = travel;
      open = null;
    }
  }
  return found
    .map(({ front, rear }) => [travel - front, rear === null ? 0 : travel - rear])
    .filter(([front]) => front <= over);
}

function way(one, other, factor, offset) {
  const mean = Number.isFinite(one) && Number.isFinite(other) ? (one + other) / 2 : NaN;
  return Number.isFinite(mean) ? factor * mean + offset : 0;
}
