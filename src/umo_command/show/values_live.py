"""`umo show values`: shows a running station in the terminal, from its frames."""

from __future__ import annotations

import os
import re
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from umo.digits import number_text
from umo.objects import Quality
from umo.objects.presentation.rows import (
    FOLDED_FROM,
    TableRow,
    families,
    folded,
    quality_of,
    raw_of,
    restriction,
    value_of,
    worst_of,
)
from umo.objects.presentation.run_facts import ALARMS, IN_FAULT, fault_texts
from umo.process.frames import RunReader, Stage
from umo.process.frames.alarm_list import alarms_text
from umo.process.frames.search import reading
from umo.recording.scope.history import samples
from umo.text import others, printable, some
from umo.wiring.patterns import chosen
from umo_command.console import out, plain_table
from umo_command.show.stations import attach_first, how_ended
from umo_command.show.traces import TRACE_SPAN, Traces, spark, traced_span

PICTURES_PER_SECOND = 10
OTHER_LINES = 6
"""Number of lines of a screen above and below the table."""
HEADINGS = ("object or signal", "value", f"last {TRACE_SPAN:g} s", "least to most", "raw")
MAX_REASONS = 3
"""Largest number of reasons of inhibitions that are reported."""
WARNINGS = ("no frame for", "not seen")
"""Facts that are shown in another colour."""
OWN_LINE_FACTS = (IN_FAULT, "driven", ALARMS)
"""Facts that are shown on separate lines."""
COLUMN_GAP = 2
"""Number of characters between two columns."""
KEYS = "enter: fold, a: all, arrows, page, home, end, q: quit"
PAUSE_RATIO = 9
"""Pause after an update of the screen, as a multiple of the time that the update took. It is needed because the station
needs the computer, and the terminal may be slow."""
MARKS = {True: "▾ ", False: "▸ "}
SEQUENCES = {
    b"\x1b[A": "up",
    b"\x1b[B": "down",
    b"\x1b[5~": "page up",
    b"\x1b[6~": "page down",
    b"\x1b[H": "home",
    b"\x1b[F": "end",
    b"\x1b[1~": "home",
    b"\x1b[4~": "end",
    b"\x1bOA": "up",
    b"\x1bOB": "down",
    b"\x1bOH": "home",
    b"\x1bOF": "end",
    b"\r": "enter",
    b"\n": "enter",
    b" ": "enter",
    b"a": "all",
    b"q": "quit",
}
"""Characters that a terminal sends (ECMA-48, xterm), with the name of the key."""
SENT = re.compile(rb"\x1b[\[O][\x00-\x3f\x7f-\xff]*[\x40-\x7e]?|.", re.S)
"""Pattern of a control sequence up to its last character, or of a single character."""

Wait = Callable[[float], list[str]]


def watch(words: list[str], once: bool, seconds: float | None) -> None:
    """Show a running station until it ends, until q or Ctrl-C, or for `seconds` s. `words`: the name or pid of the
    station, then paths and patterns. The name may be left out if only one station is running."""
    reader, paths = attach_first(words)
    with reader, reading(reader.path):
        rows = chosen(reader.paths + reader.signals, paths, reader.about["station"])
        reader.skip_older_half()
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
    """Draw until the station has ended (True), or until the user quits."""
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
    """The screen: the last frame, and traces of earlier ones."""

    def __init__(self, reader: RunReader, rows: list[int]) -> None:
        entries = reader.layout.described.traced
        self._reader = reader
        self._rows = rows
        self._names = [entries[row].path for row in rows]
        self._others = len(entries) - len(rows)
        self.view = View(self._names)
        self._frame: Any = reader.latest()
        self.traces = Traces(len(rows))
        self._times: deque[Any] = deque(maxlen=PICTURES_PER_SECOND)

    def update(self) -> bool:
        """Read all frames since the last call. Return True after the last frame."""
        ended = self._reader.state is Stage.ENDED
        frames = self._reader.read()
        if len(frames):
            self._frame = frames[-1]
            self._times.append(frames[["wake", "execution"]].copy())
            self.traces.add(frames["time"], samples(frames)[:, self._rows])
        return ended

    def whole(self) -> Group | Text:
        """Return all selected objects, one per line."""
        lines = View(self._names, fold=False).lines
        rest = f"{others(self._others)} not shown" if self._others else ""
        return self._draw(lines, None, self._remarks(), rest, out.width)

    def screen(self, console: Console, keys: bool = False, hint: str = "Ctrl-C: quit") -> Group | Text:
        """Draw as much as fits the terminal. If there is a keyboard, also draw a cursor and the meaning of the keys."""
        remarks = self._remarks()
        height = max(1, console.size.height - OTHER_LINES - len(remarks))
        lines, total = self.view.visible(height), len(self.view.lines)
        rest = f"{others(self._others)} not selected; " if self._others else ""
        how = KEYS if keys else hint
        rest = f"lines {self.view.top + 1} to {self.view.top + len(lines)} of {total}; {rest}{how}".rstrip("; ")
        cursor = self.view.lines[self.view.cursor] if keys else None
        return self._draw(lines, cursor, remarks, rest, console.width)

    def _draw(self, lines: list[Line], cursor: Line | None, remarks: list[Text], rest: str, width: int) -> Group | Text:
        if self._frame is None:
            return Text("no frame yet")
        return Group(self._heading(), self._table(lines, cursor, width), *remarks, Text(rest, "dim", no_wrap=True))

    def _heading(self) -> Text:
        reader = self._reader
        facts = reader.facts(self._frame)
        facts["not seen"] = f"{reader.lost:,} frames" if reader.lost else ""
        progress = facts.pop("progress")
        for name in OWN_LINE_FACTS:
            facts.pop(name, None)
        text = Text(reader.title + (f": {progress}" if progress else "") + "\n", style="bold", no_wrap=True)
        for place, (name, fact) in enumerate((name, fact) for name, fact in facts.items() if fact):
            style = "yellow" if name in WARNINGS else "none"
            text.append(f"{' · ' if place else ''}{name}: {fact}", style)
        text.append(f"\n{self._paces()}", "none")
        return text

    def _paces(self) -> str:
        """Return the times of execution and of waking up over the last second, as text."""
        if not self._times:
            return ""
        times = np.concatenate(list(self._times))
        text = f"execution {_percentiles(times['execution'])}"
        wakes = times["wake"][times["wake"] >= 0]
        return f"{text}; waking up {_percentiles(wakes)}" if wakes.size else text

    def _table(self, lines: list[Line], cursor: Line | None, width: int) -> Table:
        """Return a table of the lines. If the width is too small, the last columns are omitted."""
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

    def _remarks(self) -> list[Text]:
        """Return lines on equipment in fault and on driven and inhibited actuators; none before the first frame."""
        faults = self._reader.faults(self._frame)
        driven = self._reader.driven(self._frame)
        texts = [_remark(f"✕ {IN_FAULT}: {text}") for text in fault_texts(faults)]
        texts += [_remark(f"! {text}") for text in alarms_text(self._reader.alarms(self._frame))]
        texts += [_remark(f"driven: {driven}", "yellow")] * bool(driven)
        return texts + self._inhibited([restriction(f"{path} is in fault") for path in faults])

    def _inhibited(self, told: Sequence[str]) -> list[Text]:
        """Return a line for each of the first few reasons of inhibitions, without those that were shown before."""
        taken: dict[str, list[str]] = {}
        if self._frame is not None:
            places = [row for row in self._rows if row < len(self._frame["quality"])]
            held = [place for place in places if self._frame["restrictions"][place]]
            for row in self._reader.rows(self._frame, held):
                if row.note and row.note not in told:
                    taken.setdefault(row.note, []).append(row.about.path)
        found = [f"{note}: {some(names)}" for note, names in taken.items()]
        more = [f"and {others(len(found) - MAX_REASONS)}"] if len(found) > MAX_REASONS else []
        return [_remark(text) for text in found[:MAX_REASONS] + more]


def _remark(text: str, style: str = "red") -> Text:
    """Return a separate line, which is cut at the width of the terminal."""
    return Text(printable(text), style, no_wrap=True, overflow="ellipsis")


def _percentiles(ns: Any) -> str:
    median, late = np.percentile(ns, [50, 99]) * 1e-3
    return f"{number_text(median, 0)} µs, 99 % below {number_text(late, 0)} µs"


def _value(line: list[TableRow]) -> Text:
    """Return the value, its quality if this is not good, and marks of restrictions. For a family each mark has the
    number of its objects."""
    text = Text(value_of(line))
    if worst := worst_of(line):
        text.append(f" {quality_of(line)}", "red" if worst == Quality.BAD else "yellow")
    marks = [row.note.partition(":")[0] for row in line if row.note]
    for mark in dict.fromkeys(marks):
        sign, _, word = mark.partition(" ")
        text.append(f" {sign} {f'{marks.count(mark)} ' if len(line) > 1 else ''}{word}", "red")
    return text


@dataclass(frozen=True)
class Line:
    name: str
    rows: list[int]
    """Indices of the objects in the line. A family has several."""
    family: str = ""
    """The family that the line folds and unfolds."""


class View:
    """The state of the list: the unfolded families, the cursor, and the first visible line."""

    def __init__(self, names: Sequence[str], fold: bool = True) -> None:
        self._names = names
        self._families = families(names)
        self._unfolded = set() if fold else set(self._families)
        self._plain = not fold
        self.cursor = self.top = 0
        self.lines = self._lines()

    def _lines(self) -> list[Line]:
        if self._plain:
            return [Line(name, [row]) for row, name in enumerate(self._names)]
        lines = []
        for family, rows in self._families.items():
            if len(rows) < FOLDED_FROM:
                lines += [Line(self._names[row], [row]) for row in rows]
                continue
            unfolded = family in self._unfolded
            lines.append(Line(MARKS[unfolded] + folded([self._names[row] for row in rows]), rows, family))
            if unfolded:
                lines += [Line(f"  {self._names[row]}", [row]) for row in rows]
        return lines

    def press(self, key: str, height: int) -> None:
        """Carry out a key: move the cursor, or fold or unfold the family at the cursor, or all families."""
        page = max(1, height - 1)
        steps = {"up": -1, "down": 1, "page up": -page, "page down": page, "home": -len(self.lines), "end": 10**9}
        if key in steps:
            self.cursor += steps[key]
        elif key == "enter" and (family := self.lines[self.cursor].family):
            self._unfolded ^= {family}
        elif key == "all":
            self._unfolded = set() if self._unfolded else set(self._families)
        self.lines = self._lines()
        self.cursor = min(max(self.cursor, 0), len(self.lines) - 1)

    def visible(self, height: int) -> list[Line]:
        """Return the lines that fit, with the cursor among them."""
        self.top = min(max(self.top, self.cursor - height + 1), self.cursor, max(0, len(self.lines) - height))
        return self.lines[self.top : self.top + height]


@contextmanager
def pressed() -> Iterator[Wait | None]:
    """Return a context that yields a function, or None without a keyboard. The function waits for keys, at most a time
    in s, and returns their names."""
    try:
        import termios
        import tty

        before = termios.tcgetattr(file := sys.stdin.fileno())
    except (ImportError, AttributeError, OSError, ValueError):  # no such module, no stdin, one that is not a file
        yield None
        return
    except termios.error:
        yield None
        return
    try:
        tty.setcbreak(file)
        yield lambda seconds: _read(file, seconds)
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


def _read(file: int, seconds: float) -> list[str]:
    if not select.select([file], [], [], max(seconds, 0.0))[0]:
        return []
    data = os.read(file, 1024)
    if not data:  # the terminal is gone
        time.sleep(max(seconds, 0.0))
    return parse(data)


def parse(data: bytes) -> list[str]:
    """Return the names of the keys in the input of a terminal. Unknown keys are skipped."""
    return [SEQUENCES[sent] for sent in SENT.findall(data) if sent in SEQUENCES]
