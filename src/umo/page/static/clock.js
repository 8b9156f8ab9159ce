/** Times on the wall clock. @param {number} number @param {number} digits */
const padded = (number, digits) => String(number).padStart(digits, "0");

/**
 * The local time of a moment, `21:40:05.123`; "" for a run that does not keep the pace of the wall clock.
 * @param {number | null | undefined} utc  s since 1970 at the station's time 0.
 * @param {number} time  s on the station's clock.
 */
export function wallTime(utc, time) {
  if (utc === null || utc === undefined || !Number.isFinite(time)) return "";
  const date = new Date((utc + time) * 1e3);
  const clock = [date.getHours(), date.getMinutes(), date.getSeconds()].map((part) => padded(part, 2)).join(":");
  return `${clock}.${padded(date.getMilliseconds(), 3)}`;
}

/** The local day of a moment, `2026-11-22`; "" as above. @param {number | null | undefined} utc @param {number} time */
export function wallDay(utc, time) {
  if (utc === null || utc === undefined || !Number.isFinite(time)) return "";
  const date = new Date((utc + time) * 1e3);
  return `${date.getFullYear()}-${padded(date.getMonth() + 1, 2)}-${padded(date.getDate(), 2)}`;
}
