"""Draws a scope as a picture in SVG: traces against time in lanes, with one lane for each unit, and binary objects as
bars."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from math import ceil, floor, isfinite, log10
from typing import Any

import numpy as np

from umo.digits import scale_texts
from umo.errors import PathError, RangeError
from umo.objects.presentation.html_table import STYLE, heading
from umo.objects.presentation.value_text import shown_unit
from umo.objects.scaling import FloatArray
from umo.process.frames import RunReader
from umo.recording.scope.history import History
from umo.recording.scope.reduction import Points, reduced
from umo.wiring.patterns import chosen

MAX_TRACES, MAX_SPAN = 16, 300.0
"""Largest number of traces, and longest span in s."""
LEFT, PIXELS, LANE, BAR, LINE, AXIS = 76, 820, 120, 24, 17, 26
"""Widths of the scale and of the traces, and heights of a lane, a bar, a line of the legend and the time axis."""
LEGEND_COLUMNS, MAX_NAME_LENGTH = 3, 36
"""Number of traces in a line of the legend, and largest number of characters of a name."""
COLOURS = ("#3b82d6", "#d97706", "#16a34a", "#a855f7", "#e0457b", "#0e9aa7", "#b08900", "#8593a3")
"""Colours of the traces. Each is readable on black and on white."""
DASHES = ("", "7 3", "2 2", "9 3 2 3")
"""Dashes of the traces in a lane, in their order, so that colour is not the only difference."""


class Scope:
    """The last seconds of some objects and signals of a run."""

    def __init__(self, reader: RunReader, paths: Sequence[str], seconds: float) -> None:
        if not (isfinite(seconds) and 0 < seconds <= MAX_SPAN):
            raise RangeError(f"seconds: {seconds!r} must be above 0 and at most {MAX_SPAN:g}")
        entries = reader.layout.described.traced
        self._places = chosen([entry.path for entry in entries], paths, str(reader.about["station"]))
        if len(self._places) > MAX_TRACES:
            raise PathError(
                f"{len(self._places)} objects and signals; a scope shows at most {MAX_TRACES}: name fewer paths"
            )
        self._reader = reader
        self._seconds = seconds
        self._entries = [entries[place] for place in self._places]
        self._period = float(reader.about["period"])
        self._history = History(len(self._places), self._period, seconds + 1.0)
        self._frame: Any = None
        self._now: list[list[float]] = []
        """The last value of each trace; no value before the first frame."""

    def draw(self, more: Mapping[str, str]) -> str:
        """Take all new frames, and return the picture with a heading."""
        frames = self._reader.read()
        if len(frames):
            self._frame = frames[-1]
            self._history.add_frames(frames, self._places)
        lost = {"frames not seen": f"{self._reader.lost:,}" if self._reader.lost else ""}
        facts = self._reader.facts(self._frame) | lost | dict(more)
        return f'{STYLE}<div class="umo">{heading(self._reader.title, facts)}{self._picture()}</div>'

    def _picture(self) -> str:
        stop = max(self._history.stop, self._seconds)
        start = stop - self._seconds
        times, values = self._history.between(start, stop, range(len(self._places)))
        self._now = values[:, -1:].tolist()
        points = reduced(times, values, self._seconds / PIXELS, self._period)
        x = LEFT + (points.times - start) * (PIXELS / self._seconds)
        parts, height = [], 0.0
        for lane in self._lanes():
            top = LANE + LINE * ceil(len(lane) / LEGEND_COLUMNS) if not self._entries[lane[0]].is_binary else BAR
            draw = self._bar if top == BAR else self._curves
            parts.append(f'<g transform="translate(0 {height:g})">{draw(lane, x, points)}</g>')
            height += top
        names = escape(", ".join(entry.path for entry in self._entries))
        return (
            f'<svg viewBox="0 0 {LEFT + PIXELS + 4} {height + AXIS:g}" role="img" aria-label="{names}" font-size="12" '
            f'fill="currentColor">{"".join(parts)}{_time_axis(start, stop, height)}</svg>'
        )

    def _lanes(self) -> list[list[int]]:
        """Return the traces of each lane: numbers with the same unit share a lane, and each binary object has its
        own."""
        lanes: dict[str, list[int]] = {}
        for row, entry in enumerate(self._entries):
            lanes.setdefault(entry.path if entry.is_binary else f"={entry.unit}", []).append(row)
        return list(lanes.values())

    # Lanes ---------------------------------------------------------------------------------------------

    def _curves(self, lane: list[int], x: FloatArray, points: Points) -> str:
        top = LINE * ceil(len(lane) / LEGEND_COLUMNS) + 6
        bottom = top + LANE - 16
        low, high = _span(points.low[lane], points.high[lane])
        scale = (bottom - top) / (high - low)
        parts = []
        for level, text in _ticks(low, high, 4):
            y = bottom - (level - low) * scale
            parts.append(_line(LEFT, y, LEFT + PIXELS, y) + _text(LEFT - 6, y + 4, text, "end"))
        for number, row in enumerate(lane):
            style = f'stroke="{COLOURS[row % len(COLOURS)]}" stroke-dasharray="{DASHES[number % len(DASHES)]}"'
            path = _path(x, bottom - (points.low[row] - low) * scale, bottom - (points.high[row] - low) * scale)
            parts.append(f'<path d="{path}" fill="none" {style} stroke-width="1.4" stroke-linecap="round"/>')
            place = LEFT + number % LEGEND_COLUMNS * (PIXELS / LEGEND_COLUMNS)
            line = LINE * (number // LEGEND_COLUMNS) + 12
            parts.append(f'<path d="M{place:g} {line - 4}h24" {style} stroke-width="2.5"/>')
            parts.append(_text(place + 30, line, self._said(row)))
        return "".join([*parts, _text(4, 12, shown_unit(self._entries[lane[0]].unit))])

    def _bar(self, lane: list[int], x: FloatArray, points: Points) -> str:
        """Return a bar: full where the object was in its 1 state, pale where it was in both within a pixel."""
        (row,) = lane
        parts = [_line(LEFT, BAR - 3, LEFT + PIXELS, BAR - 3)]
        ends = np.append(x[1:], LEFT + PIXELS)
        for level, opacity in ((2, 0.55), (1, 0.25)):
            ones = (points.low[row] > 0.5).astype(int) + (points.high[row] > 0.5) == level
            edges = np.flatnonzero(np.diff(np.concatenate(([0], ones, [0]))))
            for begin, end in zip(edges[::2], edges[1::2] - 1, strict=True):
                width = max(ends[end] - x[begin], 1.0)
                parts.append(
                    f'<rect x="{x[begin]:.1f}" y="4" width="{width:.1f}" height="{BAR - 7}" '
                    f'fill="{COLOURS[row % len(COLOURS)]}" opacity="{opacity}"/>'
                )
        return "".join([*parts, _text(LEFT + 4, BAR - 7, self._said(row))])

    def _said(self, row: int) -> str:
        """Return the name of a trace and its last value as text."""
        path = self._entries[row].path
        name = path if len(path) <= MAX_NAME_LENGTH else f"...{path[3 - MAX_NAME_LENGTH :]}"
        return f"{name}  {self._entries[row].text(*self._now[row])}"


def _span(low: FloatArray, high: FloatArray) -> tuple[float, float]:
    """Return the range that a lane shows: that of all values, with a margin."""
    known = np.concatenate([low[np.isfinite(low)], high[np.isfinite(high)]])
    least, most = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = 0.06 * (most - least) or 0.05 * abs(most) or 1.0
    return least - margin, most + margin


def _ticks(low: float, high: float, most: int) -> Iterator[tuple[float, str]]:
    """Return at most this number of round numbers, and their texts."""
    rough = (high - low) / most
    size = 10.0 ** floor(log10(rough))
    step = next(size * factor for factor in (1, 2, 5, 10) if size * factor >= rough)
    levels = [round(number * step, 12) for number in range(ceil(low / step), floor(high / step) + 1)]
    return zip(levels, scale_texts(levels), strict=True)


def _path(x: FloatArray, low: FloatArray, high: FloatArray) -> str:
    """Return the path of a line through the smallest and the largest value of each point. The line is interrupted at
    points without a value."""
    known = np.isfinite(low)
    begins = known & ~np.concatenate(([False], known[:-1]))
    tenths = (np.round(each[known], 1).tolist() for each in (x, low, high))
    parts = []
    for at, one, other, begin in zip(*tenths, begins[known].tolist(), strict=True):
        parts.append(f"{'M' if begin else 'L'}{at} {one}")
        if begin or other != one:  # one point alone is drawn too
            parts.append(f"V{other}")
    return "".join(parts)


def _time_axis(start: float, stop: float, height: float) -> str:
    parts = []
    for time, text in _ticks(start, stop, 8):
        x = LEFT + (time - start) * (PIXELS / (stop - start))
        parts.append(_line(x, 0, x, height) + _text(x, height + 16, f"{text} s", "middle"))
    return "".join(parts)


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="currentColor" opacity="0.18"/>'


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'
