"""`umo watch`: a running station in the terminal, from its frames."""

from __future__ import annotations

import sys
import time
from collections import deque
from typing import Any

import numpy as np
from rich import box
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from umo.errors import PathError
from umo.frames import Reader, Stage
from umo.objects import Quality
from umo.text import did_you_mean, printable

from .console import out
from .running import attach_first

PICTURES = 10
"""A second."""
TRACE = 16
"""Characters of a trace, the newest at the right."""
SPAN = 16.0
"""s that a trace shows."""
BLOCKS = "▁▂▃▄▅▆▇█"


def watch(words: list[str], once: bool, seconds: float | None) -> None:
    """Show a running station until it ends, until Ctrl-C, or for `seconds` s. `words`: its name or pid, then paths;
    only paths if one station is running."""
    reader, paths = attach_first(words)
    with reader:
        picture = Picture(reader, _chosen(reader, paths))
        if once or not sys.stdout.isatty():
            picture.take()
            out.print(picture.draw())
            return
        until = None if seconds is None else time.monotonic() + seconds
        ended = False
        try:
            with Live(picture.draw(), console=out, auto_refresh=False, screen=False) as live:
                while not ended and (until is None or time.monotonic() < until):
                    ended = reader.state is Stage.ENDED
                    picture.take()
                    live.update(picture.draw(), refresh=True)
                    if not ended:
                        time.sleep(1 / PICTURES)
        except KeyboardInterrupt:
            return
        if ended:
            out.print(f"{reader.about['station']} has ended")


def _chosen(reader: Reader, paths: list[str]) -> list[int]:
    """The rows of the objects and signals named, or of all those below a compound or law named; all without names."""
    known = reader.paths + reader.signals
    if not paths:
        return list(range(len(known)))
    rows: list[int] = []
    for path in paths:
        below = [i for i, name in enumerate(known) if name == path or name.startswith(f"{path}.")]
        if not below:
            raise PathError(f"no object or signal {path!r}{did_you_mean(path, known)} in {reader.about['station']}")
        rows += below
    return list(dict.fromkeys(rows))


class Picture:
    """What is on the screen: the last frame, and traces of what came before."""

    def __init__(self, reader: Reader, rows: list[int]) -> None:
        self._reader = reader
        self._rows = rows
        self._entries = [*reader.layout.objects, *reader.layout.signals]
        reader.next = max(reader.next, reader.head - reader.slots // 2)
        self._frame: Any = reader.latest()
        self._traces: dict[int, deque[tuple[float, float]]] = {row: deque(maxlen=TRACE) for row in rows}
        self._bin = -1
        self._times: deque[Any] = deque(maxlen=PICTURES)

    def take(self) -> None:
        """All frames since the last time."""
        frames = self._reader.read()
        if not len(frames):
            return
        self._frame = frames[-1]
        self._times.append(frames[["wake", "execution"]].copy())
        bins = (frames["time"] * (TRACE / SPAN)).astype(int)
        for number in np.unique(bins):
            values = _values(frames[bins == number])
            self._bin, known = number, self._bin
            for row in self._rows:
                seen = values[:, row][np.isfinite(values[:, row])]
                if not len(seen):
                    continue
                low, high = float(seen.min()), float(seen.max())
                trace = self._traces[row]
                if number == known and trace:
                    before = trace.pop()
                    low, high = min(low, before[0]), max(high, before[1])
                trace.append((low, high))

    def draw(self) -> Group | Text:
        if self._frame is None:
            return Text("no frame yet")
        return Group(self._heading(), self._table())

    def _heading(self) -> Text:
        reader, frame = self._reader, self._frame
        about = reader.about
        name = f"{about['station']} ({about['wiring']})" if about["wiring"] else about["station"]
        progress = printable(frame["progress"].decode(errors="replace"))
        done = f", {frame['done']} of {frame['total']}" if frame["total"] else ""
        lost = f", {reader.lost:,} frames not seen" if reader.lost else ""
        text = Text(f"{name}: {progress}{done}\n", style="bold")
        text.append(
            f"{frame['time']:.3f} s, period {about['period'] * 1e3:g} ms, missed {reader.missed:,}{lost}\n", "none"
        )
        text.append(self._paces(), "none")
        return text

    def _paces(self) -> str:
        """Waking up and execution over the last second, in us."""
        if not self._times:
            return ""
        times = np.concatenate(list(self._times))
        median, late = np.percentile(times["execution"], [50, 99]) * 1e-3
        text = f"execution {median:.0f} us, 99 % below {late:.0f} us"
        if (wakes := times["wake"][times["wake"] >= 0]).size:
            median, late = np.percentile(wakes, [50, 99]) * 1e-3
            text += f"; waking up {median:.0f} us, 99 % below {late:.0f} us"
        return text

    def _table(self) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
        table.add_column("object or signal", no_wrap=True, min_width=max(len(entry["path"]) for entry in self._entries))
        table.add_column("value", no_wrap=True, justify="right")
        table.add_column("raw", no_wrap=True, justify="right", min_width=7)
        table.add_column(f"last {SPAN:g} s", no_wrap=True)
        table.add_column("least to most", no_wrap=True)
        values, objects = _values(self._frame[np.newaxis])[0], len(self._reader.layout.objects)
        for row in self._rows:
            entry, trace = self._entries[row], list(self._traces[row])
            value = Text(_value(entry, float(values[row])))
            quality = Quality(int(self._frame["quality"][row])) if row < objects else Quality.GOOD
            if quality is not Quality.GOOD:
                value.append(f" {quality}", "red" if quality is Quality.BAD else "yellow")
            raw = str(self._frame["raws"][row]) if row < objects else ""
            table.add_row(entry["path"], value, raw, _spark(entry, trace), _range(entry, trace))
        return table


def _values(frames: Any) -> Any:
    """Of the objects, then of the signals: a row for each frame."""
    return np.hstack([frames["values"], frames["signals"]])


def _value(entry: dict[str, Any], value: float) -> str:
    if "one" in entry:
        return str(entry["one"] if value else entry["zero"])
    if np.isnan(value):
        return "-"
    unit = "" if entry["unit"] == "sampling_period" else f" {entry['unit']}"
    return (f"{value:.1f}{unit}" if abs(value) >= 1000 else f"{value:.4g}{unit}").rstrip()


def _spark(entry: dict[str, Any], trace: list[tuple[float, float]]) -> str:
    """A block for each stretch of time, at the middle of what was seen in it."""
    if not trace:
        return ""
    middles = [(low + high) / 2 for low, high in trace]
    least, most = (0.0, 1.0) if "one" in entry else (min(middles), max(middles))
    if most == least:
        return BLOCKS[0] * len(trace)
    return "".join(BLOCKS[round((middle - least) / (most - least) * (len(BLOCKS) - 1))] for middle in middles)


def _range(entry: dict[str, Any], trace: list[tuple[float, float]]) -> str:
    if not trace or "one" in entry:
        return ""
    return f"{_short(min(low for low, _ in trace))} to {_short(max(high for _, high in trace))}"


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
