/** Wheel, click and touch on the plot; keys. */

const CLICK_DISTANCE = 4;  // pixels that a pointer may move in a click
const DOUBLE_CLICK_TIME = 350;  // ms from one click to the next of a double click
const DOUBLE_CLICK_DISTANCE = 12;  // pixels between them

/**
 * @param {HTMLElement} over  The plot.
 * @param {{zoom: (factor: number, share: number) => void, pan: (share: number) => void, click: (x: number) => void,
 *   undoClick: () => void, live: () => void, hover: (x: number | null) => void}} act  Shares are of the plot's width.
 *   A double click is a click that is undone, then `live`.
 */
export function gestures(over, act) {
  /** @type {Map<number, number>} */
  const touches = new Map();
  /** @type {number | null} */
  let start = null;
  let clicked = { x: NaN, at: -Infinity };
  /** @param {MouseEvent} event */
  const place = (event) => event.clientX - over.getBoundingClientRect().left;
  /** @param {number} x @param {number} at */
  const click = (x, at) => {
    if (at - clicked.at < DOUBLE_CLICK_TIME && Math.abs(x - clicked.x) < DOUBLE_CLICK_DISTANCE) {
      clicked = { x: NaN, at: -Infinity };
      act.undoClick();
      act.live();
    } else {
      clicked = { x, at };
      act.click(x);
    }
  };
  over.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      act.pan((event.deltaX || event.deltaY) / over.clientWidth);
    } else act.zoom(Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * 0.002), place(event) / over.clientWidth);
  }, { passive: false });
  over.addEventListener("pointerdown", (event) => {
    start = place(event);
    if (event.pointerType === "touch") touches.set(event.pointerId, place(event));
  });
  over.addEventListener("pointermove", (event) => {
    if (!touches.has(event.pointerId)) {
      act.hover(place(event));
      return;
    }
    const before = [...touches.values()];
    touches.set(event.pointerId, place(event));
    const now = [...touches.values()];
    if (now.length === 1) act.pan((before[0] - now[0]) / over.clientWidth);
    else {
      const factor = Math.abs(before[0] - before[1]) / Math.max(Math.abs(now[0] - now[1]), 1);
      act.zoom(Math.min(Math.max(factor, 0.5), 2), (now[0] + now[1]) / 2 / over.clientWidth);
    }
  });
  /** @param {PointerEvent} event */
  const end = (event) => {
    touches.delete(event.pointerId);
    if (event.type === "pointerup" && start !== null && Math.abs(place(event) - start) < CLICK_DISTANCE) click(start, event.timeStamp);
    start = null;
    if (event.type === "pointerleave") act.hover(null);
  };
  for (const kind of /** @type {const} */ (["pointerup", "pointercancel", "pointerleave"])) over.addEventListener(kind, end);
}

/**
 * Keys that do something where none is typed; Escape everywhere.
 * @param {Record<string, () => void>} acts  By key. @returns {() => void} Their end.
 */
export function keys(acts) {
  const pressed = (/** @type {KeyboardEvent} */ event) => {
    const target = /** @type {Element} */ (event.target);
    const act = Object.hasOwn(acts, event.key) ? acts[event.key] : null;
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    if (target.matches("input, select, textarea, button, [role=tab]") && event.key !== "Escape") return;
    event.preventDefault();
    act();
  };
  document.addEventListener("keydown", pressed);
  return () => document.removeEventListener("keydown", pressed);
}
