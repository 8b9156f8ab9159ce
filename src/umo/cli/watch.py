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
    """The rows of the objects named, or of all those below a compound named; all without names."""
    known = reader.paths
    if not paths:
        return list(range(len(known)))
    rows: list[int] = []
    for path in paths:
        below = [i for i, name in enumerate(known) if name == path or name.startswith(f"{path}.")]
        if not below:
            raise PathError(f"no object {path!r}{did_you_mean(path, known)} in {reader.about['station']}")
        rows += below
    return list(dict.fromkeys(rows))


class Picture:
    """What is on the screen: the last frame, and traces of what came before."""

    def __init__(self, reader: Reader, rows: list[int]) -> None:
        self._reader = reader
        self._rows = rows
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
            values = frames["values"][bins == number]
            self._bin, known = number, self._bin
            for row in self._rows:
                low, high = float(values[:, row].min()), float(values[:, row].max())
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
        table.add_column("object", no_wrap=True, min_width=max(map(len, self._reader.paths)))
        table.add_column("value", no_wrap=True, justify="right")
        table.add_column("raw", no_wrap=True, justify="right", min_width=7)
        table.add_column(f"last {SPAN:g} s", no_wrap=True)
        table.add_column("least to most", no_wrap=True)
        for row in self._rows:
            entry = self._reader.layout.objects[row]
            quality = Quality(int(self._frame["quality"][row]))
            value = Text(_value(entry, float(self._frame["values"][row])))
            if quality is not Quality.GOOD:
                value.append(f" {quality}", "red" if quality is Quality.BAD else "yellow")
            trace = list(self._traces[row])
            table.add_row(
                entry["path"], value, str(self._frame["raws"][row]), _spark(entry, trace), _range(entry, trace)
            )
        return table


def _value(entry: dict[str, Any], value: float) -> str:
    if "one" in entry:
        return str(entry["one"] if value else entry["zero"])
    unit = "" if entry["unit"] == "sampling_period" else f" {entry['unit']}"
    return f"{value:.1f}{unit}" if abs(value) >= 1000 else f"{value:.4g}{unit}"


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
