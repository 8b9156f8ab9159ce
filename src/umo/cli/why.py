"""`umo why`: shows the causes of missed periods from the newest black box."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from umo.errors import FramesError
from umo.frames import Reader
from umo.frames.layout import USAGE
from umo.latency import blackbox
from umo.latency.causes import AFTER, WAKE, counts, explain_all, sentence, split, tally
from umo.presentation.durations import duration
from umo.remote.search import frames_at, reading, station_name
from umo.text import did_you_mean

from .console import out
from .running import attach

AROUND = 2
"""Periods shown before the one that reports the miss."""


def why(station: str | None, now: bool, file: Path | None) -> int:
    """Print the newest black box: of a station, or of all; or keep one of a running station first."""
    if now:
        file = _keep(station)
    elif file is None:
        file = _newest(station)
    with frames_at(file) as reader, reading(file):
        _report(reader, file)
    return 0


def _newest(station: str | None) -> Path:
    found = blackbox.boxes(blackbox.folder())
    if station is not None:
        names = [blackbox.station_of(path) for path in found]
        found = [path for path, name in zip(found, names, strict=True) if name == station_name(station)]
        if not found and names:
            known = ", ".join(dict.fromkeys(names))
            raise FramesError(f"no black box of {station!r}{did_you_mean(station, names)}; there are those of: {known}")
    if not found:
        raise FramesError(
            "no black box yet: one is written when a period is missed in real time; `umo why --now` writes one at once"
        )
    return found[-1]


def _keep(station: str | None) -> Path:
    """A black box of a running station, written by this process from its frames."""
    with attach(station) as reader:
        file = blackbox.name_for(blackbox.folder(), str(reader.about["station"]), time.time())
        blackbox.save(reader, file, blackbox.ON_DEMAND)
        blackbox.thin(file.parent)
        return file


def _report(reader: Reader, file: Path) -> None:
    frames, about = reader.read(), reader.about
    if not len(frames):
        raise FramesError(f"no period is in {file}")
    out.print(f"{reader.title}, {blackbox.kept_at(about)}: {about.get('reason', '')}")
    out.print(
        f"the last {len(frames)} periods of {duration(about['period'])}; {reader.missed} missed in the whole run",
    )
    verdicts = explain_all(frames, reader.layout)
    if not verdicts:
        out.print("no period was missed in these; usual times:")
        out.print(_usual(reader, frames))
        return
    for verdict in verdicts[-10:]:
        out.print(sentence(frames, verdict), style="bold")
    if len(verdicts) > 1:
        counts = ", ".join(f"{cause} {count}" for cause, count in tally(verdicts).items())
        out.print(f"all {len(verdicts)} occasions: {counts}")
    out.print(_around(reader, frames, verdicts[-1].row))
    out.print(str(file), style="dim")


def _parts(reader: Reader, frames: Any) -> tuple[list[str], Any]:
    parts = split(frames, reader.layout)
    return list(parts), np.array(list(parts.values())) * 1e-3


def _usual(reader: Reader, frames: Any) -> Table:
    names, times = _parts(reader, frames)
    table = Table("µs", *map(_title, names), header_style="bold")
    for title, q in (("median", 50), ("99 %", 99), ("longest", 100)):
        table.add_row(title, *(f"{value:.1f}" for value in np.percentile(times, q, axis=1)))
    return table


def _around(reader: Reader, frames: Any, row: int) -> Table:
    """The periods before and after a miss, in us, and what was counted from one to the next."""
    names, times = _parts(reader, frames)
    rows = [i for i in range(row - AROUND, row + 2) if 1 <= i < len(frames)]
    table = Table("", "median", *(f"{frames['time'][i]:.4f} s" for i in rows), header_style="bold")
    table.add_row("missed", "", *(str(frames["missed"][i] or "") for i in rows))
    for name, values in zip(names, times, strict=True):
        table.add_row(f"{_title(name)}, µs", f"{np.median(values):.1f}", *(f"{values[i]:.1f}" for i in rows))
    units = {name: unit for name, _, _, unit in USAGE}
    for name, counted in counts(frames).items():
        scale = 1e-3 if units[name] else 1.0
        if counted[rows].any():
            title = name.replace("_", " ") + (", µs" if units[name] else "")
            table.add_row(title, "", *(f"{counted[i] * scale:.0f}" for i in rows), style="dim")
    return table


def _title(name: str) -> str:
    return {WAKE: "waking up", AFTER: "after update"}.get(name, name)
