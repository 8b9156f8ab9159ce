"""`umo watch`: a running station in the terminal, from its frames."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from umo.frames import Reader, Stage
from umo.objects import Quality
from umo.presentation.digits import number_text
from umo.presentation.rows import TableRow, quality_of, raw_of, value_of, worst_of
from umo.remote.search import reading
from umo.scope.history import samples
from umo.text import printable, some
from umo.wiring.patterns import chosen

from .console import out, plain_table
from .keys import Wait, pressed
from .ps import attach_first, how_ended
from .traces import TRACE_SPAN, Traces, spark, traced_span
from .watch_lines import Line, View

PICTURES_PER_SECOND = 10
OTHER_LINES = 6
"""Lines of a screen above and below those of the table."""
HEADINGS = ("object or signal", "value", f"last {TRACE_SPAN:g} s", "least to most", "raw")
MAX_REASONS = 3
"""Reasons of inhibitions that are told, at most."""
WARNINGS = ("no frame for", "not seen")
"""Facts in another colour."""
COLUMN_GAP = 2
"""Characters between two columns."""
KEYS = "enter: fold, a: all, arrows, page, home, end, q: quit"
PAUSE_RATIO = 9
"""Pause after a picture, in times of what it took: the computer is the station's, and the terminal may be slow."""


def watch(words: list[str], once: bool, seconds: float | None) -> None:
    """Show a running station until it ends, until q or Ctrl-C, or for `seconds` s. `words`: its name or pid, then paths
    and patterns; only these if one station is running."""
    reader, paths = attach_first(words)
    with reader, reading(reader.path):
        rows = chosen(reader.paths + reader.signals, paths, reader.about["station"])
        picture = WatchScreen(reader, rows)
        if once or not sys.stdout.isatty():
            picture.update()
            out.print(picture.whole())
            return
        try:
            over = _live(picture, None if seconds is None else time.monotonic() + seconds)
        except KeyboardInterrupt:
            return
        if over:
            out.print(picture.screen(out, hint=""))
            out.print(how_ended(reader), soft_wrap=True)


def _live(picture: WatchScreen, until: float | None) -> bool:
    """Draw it until the station has ended (True), or until nobody wants to see it any more."""
    with pressed() as wait, Live(console=out, auto_refresh=False, screen=True) as live:
        while until is None or time.monotonic() < until:
            began = time.monotonic()
            ended = picture.update()
            live.update(picture.screen(out, keys=wait is not None), refresh=True)
            if ended:
                return True
            for key in _keys(wait, max(1 / PICTURES_PER_SECOND, PAUSE_RATIO * (time.monotonic() - began))):
                if key == "quit":
                    return False
                picture.view.press(key, out.size.height - OTHER_LINES)
    return False


def _keys(wait: Wait | None, seconds: float) -> Iterable[str]:
    if wait is not None:
        return wait(seconds)
    time.sleep(seconds)
    return ()


class WatchScreen:
    """The screen: the last frame, and traces of those before."""

    def __init__(self, reader: Reader, rows: list[int]) -> None:
        entries = [*reader.layout.objects, *reader.layout.signals]
        self._reader = reader
        self._rows = rows
        self._entries = [entries[row] for row in rows]
        self._names = [str(entry["path"]) for entry in self._entries]
        self._others = len(entries) - len(rows)
        self.view = View(self._names)
        reader.next = max(reader.next, reader.head - reader.slots // 2)
        self._frame: Any = reader.latest()
        self.traces = Traces(len(rows))
        self._times: deque[Any] = deque(maxlen=PICTURES_PER_SECOND)

    def update(self) -> bool:
        """All frames since the last time; whether these were the last."""
        ended = self._reader.state is Stage.ENDED
        frames = self._reader.read()
        if len(frames):
            self._frame = frames[-1]
            self._times.append(frames[["wake", "execution"]].copy())
            self.traces.add(frames["time"], samples(frames)[:, self._rows])
        return ended

    def whole(self) -> Group | Text:
        """Everything that was asked for, each object in a line."""
        lines = View(self._names, fold=False).lines
        rest = f"{self._others} other objects and signals are not shown" if self._others else ""
        return self._draw(lines, None, self._inhibited(), rest, out.width)

    def screen(self, console: Console, keys: bool = False, hint: str = "Ctrl-C: quit") -> Group | Text:
        """Draw as much as fits the terminal; with keys, a cursor and what they do."""
        reasons = self._inhibited()
        height = max(1, console.size.height - OTHER_LINES - len(reasons))
        lines, total = self.view.visible(height), len(self.view.lines)
        rest = f"{self._others} others not asked for; " if self._others else ""
        how = KEYS if keys else hint
        rest = f"lines {self.view.top + 1} to {self.view.top + len(lines)} of {total}; {rest}{how}".rstrip("; ")
        cursor = self.view.lines[self.view.cursor] if keys else None
        return self._draw(lines, cursor, reasons, rest, console.width)

    def _draw(self, lines: list[Line], cursor: Line | None, reasons: list[Text], rest: str, width: int) -> Group | Text:
        if self._frame is None:
            return Text("no frame yet")
        return Group(self._heading(), self._table(lines, cursor, width), *reasons, Text(rest, "dim", no_wrap=True))

    def _heading(self) -> Text:
        reader = self._reader
        facts = reader.facts(self._frame)
        facts["not seen"] = f"{reader.lost:,} frames" if reader.lost else ""
        progress = facts.pop("progress")
        text = Text(reader.title + (f": {progress}" if progress else "") + "\n", style="bold", no_wrap=True)
        for place, (name, fact) in enumerate((name, fact) for name, fact in facts.items() if fact):
            style = "yellow" if name in WARNINGS else "none"
            text.append(f"{' · ' if place else ''}{name}: {fact}", style)
        text.append(f"\n{self._paces()}", "none")
        return text

    def _paces(self) -> str:
        """Waking up and execution over the last second."""
        if not self._times:
            return ""
        times = np.concatenate(list(self._times))
        text = f"execution {_percentiles(times['execution'])}"
        wakes = times["wake"][times["wake"] >= 0]
        return f"{text}; waking up {_percentiles(wakes)}" if wakes.size else text

    def _table(self, lines: list[Line], cursor: Line | None, width: int) -> Table:
        """Table of the lines, with the columns that fit: the last ones go first."""
        rows = [self._row(line) for line in lines]
        name = max(len(line.name) for line in self.view.lines + lines)
        left = width - max(name, len(HEADINGS[0])) - COLUMN_GAP
        table = plain_table()
        table.add_column(HEADINGS[0], no_wrap=True, min_width=name)
        count = 1
        for number, heading in enumerate(HEADINGS[1:], 1):
            needed = max([len(heading), *(len(row[number]) for row in rows)])
            left -= needed + COLUMN_GAP
            if left < 0 and number > 1:
                break
            table.add_column(heading, no_wrap=True, justify="right" if heading in ("value", "raw") else "left")
            count += 1
        for line, row in zip(lines, rows, strict=True):
            table.add_row(*row[:count], style="reverse" if line is cursor else None)
        return table

    def _row(self, line: Line) -> tuple[str, Text, str, str, str]:
        shown = self._reader.rows(self._frame, (self._rows[row] for row in line.rows))
        traced = self.traces.of(line.rows), shown[0].about
        return line.name, _value(shown), spark(*traced), traced_span(*traced), raw_of(shown)

    def _inhibited(self) -> list[Text]:
        """A line for each reason for which something that is shown is inhibited, the first few; none before the first
        frame."""
        taken: dict[str, list[str]] = {}
        if self._frame is not None:
            places = [row for row in self._rows if row < len(self._frame["quality"])]
            held = [place for place in places if self._frame["restrictions"][place]]
            for row in self._reader.rows(self._frame, held):
                if row.note:
                    taken.setdefault(row.note, []).append(row.about["path"])
        found = [f"{note}: {some(names)}" for note, names in taken.items()]
        more = [f"and {len(found) - MAX_REASONS} other reasons"] if len(found) > MAX_REASONS else []
        return [Text(printable(text), "red", no_wrap=True) for text in found[:MAX_REASONS] + more]


def _percentiles(ns: Any) -> str:
    median, late = np.percentile(ns, [50, 99]) * 1e-3
    return f"{number_text(median, 0)} µs, 99 % below {number_text(late, 0)} µs"


def _value(line: list[TableRow]) -> Text:
    """The value, with its quality where that is not good, and with a mark where it is restricted: of a family how many
    are."""
    text = Text(value_of(line))
    if worst := worst_of(line):
        text.append(f" {quality_of(line)}", "red" if worst == Quality.BAD else "yellow")
    marks = [row.note.partition(":")[0] for row in line if row.note]
    for mark in dict.fromkeys(marks):
        sign, _, word = mark.partition(" ")
        text.append(f" {sign} {f'{marks.count(mark)} ' if len(line) > 1 else ''}{word}", "red")
    return text
