/**
 * The tab that a key leads to from another one (ARIA Authoring Practices, tabs); null: none.
 * @param {string} key @param {number} place @param {number} count
 */
export function nextTab(key, place, count) {
  if (key === "ArrowRight") return (place + 1) % count;
  if (key === "ArrowLeft") return (place + count - 1) % count;
  if (key === "Home") return 0;
  return key === "End" ? count - 1 : null;
}
