/** Wheel, click and touch on the plot. */

const CLICK = 4;  // pixels that a pointer may move in a click

/**
 * @param {HTMLElement} over  The plot.
 * @param {{zoom: (factor: number, share: number) => void, pan: (share: number) => void, click: (x: number) => void,
 *   live: () => void}} act  Shares are of the plot's width.
 */
export function gestures(over, act) {
  const touches = new Map();
  let start = null;
  const place = (event) => event.clientX - over.getBoundingClientRect().left;
  over.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      act.pan((event.deltaX || event.deltaY) / over.clientWidth);
    } else act.zoom(Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * 0.002), place(event) / over.clientWidth);
  }, { passive: false });
  over.addEventListener("dblclick", () => act.live());
  over.addEventListener("pointerdown", (event) => {
    start = place(event);
    if (event.pointerType === "touch") touches.set(event.pointerId, place(event));
  });
  over.addEventListener("pointermove", (event) => {
    if (!touches.has(event.pointerId)) return;
    const before = [...touches.values()];
    touches.set(event.pointerId, place(event));
    const now = [...touches.values()];
    if (now.length === 1) act.pan((before[0] - now[0]) / over.clientWidth);
    else {
      const factor = Math.abs(before[0] - before[1]) / Math.max(Math.abs(now[0] - now[1]), 1);
      act.zoom(Math.min(Math.max(factor, 0.5), 2), (now[0] + now[1]) / 2 / over.clientWidth);
    }
  });
  const end = (event) => {
    touches.delete(event.pointerId);
    if (event.type === "pointerup" && start !== null && Math.abs(place(event) - start) < CLICK) act.click(start);
    start = null;
  };
  for (const kind of ["pointerup", "pointercancel", "pointerleave"]) over.addEventListener(kind, end);
}
