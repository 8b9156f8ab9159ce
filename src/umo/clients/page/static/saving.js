/** What the scope saves: a picture, and every sample. */

import { el, save } from "./dom.js";
import { picture } from "./picture.js";
import { clockText, wallDay, wallTime } from "./presentation.js";

/**
 * The chart as PNG, with the time on the wall clock if the run keeps its pace.
 * @param {import("./feed.js").Feed} feed @param {import("./chart.js").Chart} chart @param {boolean} wall  Its axis shows that time already.
 */
export async function savePicture(feed, chart, wall) {
  const [from, to] = chart.range;
  const utc = feed.state?.utc ?? null;
  const day = wallDay(utc, from);
  const times = `${clockText(from)} to ${clockText(to)}${day && `, ${day} ${wallTime(utc, from)} to ${wallTime(utc, to)}`}`;
  const made = await picture(chart, `${feed.station}, ${times}`, wall ? null : utc);
  if (made) save(`${feed.station}.png`, made);
}

/**
 * Every sample of the time shown, from the server straight into a file.
 * @param {import("./feed.js").Feed} feed @param {string[]} paths @param {[number, number]} range  s.
 */
export function saveSamples(feed, paths, [start, stop]) {
  const query = new URLSearchParams([...paths.map((path) => ["path", path]), ["start", String(start)], ["stop", String(stop)]]);
  el("a", { href: `csv/${encodeURIComponent(feed.station ?? "")}?${query}`, download: `${feed.station}.csv` }).click();
}
