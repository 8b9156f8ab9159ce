"""`umo recording info`, `umo recording export` and `umo recording plot`: describe a recording, and write or draw its
content."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from umo.cycle.trace import MAX_ROWS
from umo.errors import FramesError, OptionError
from umo.objects.presentation.run_facts import title
from umo.system.packages import how_to_install
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.run.record_beside import check_installed
from umo_command.values import check_picture

MAX_DAMAGE = 3
"""Number of damaged places that are reported. They are the latest ones."""
MAX_NUMBERS = 1 << 25
"""Approximate maximum number of values that are kept for a plot."""


@dataclass(frozen=True)
class ValueSelection:
    """The selected values of a recording."""

    paths: Sequence[str] = ()
    start: float | None = None
    stop: float | None = None


def info(file: Path, as_json: bool) -> int:
    """Describe a recording."""
    check_installed()
    from umo.recording.recording import Recording
    from umo.recording.tables.recording_summary import facts_of, lines_of

    with Recording(file) as recording:
        facts = facts_of(recording)
    if as_json:
        out.print(json.dumps(facts, indent=2, default=str), soft_wrap=True)
        return 0
    lines = lines_of(facts)
    width = max(len(name) for name, _ in lines)
    for name, text in lines:
        out.print(f"{name:{width}}  {text}", soft_wrap=True)
    return 0


def export(file: Path, target: Path, wanted: ValueSelection) -> int:
    """Write a recording as Parquet, CSV or NumPy."""
    check_installed()
    from umo.recording.recording import Recording
    from umo.recording.tables import recording_export

    if found := [path for path in wanted.paths if Path(path).suffix in recording_export.SUFFIXES]:
        raise OptionError(f"{found[0]} is not a path of the machine; to write a file, give --out {found[0]}")
    if target.suffix == ".parquet" and find_spec("pyarrow") is None:
        raise OptionError(f"Parquet needs pyarrow: {how_to_install('analysis')}")
    with Recording(file) as recording, OneLine(err) as line:
        values = _values(recording, wanted)

        def progress(moment: float) -> None:
            line.show(moment, f"writing {target.name}", values.share(moment))

        count = recording_export.export(values, target, progress)
        values.look_for_damage()
    out.print(f"{target}: {count:,} periods, {target.stat().st_size / 1e6:,.1f} MB", soft_wrap=True)
    _tell_missing(values)
    return 0


def plot(file: Path, wanted: ValueSelection, target: Path | None) -> int:
    """Draw a recording, like the plot at the end of a run."""
    check_installed()
    if find_spec("matplotlib") is None:
        raise OptionError(f"a plot needs matplotlib: {how_to_install('plot')}")
    from umo.recording.recording import Recording
    from umo.recording.tables.recording_export import replacing
    from umo_command.run.plot import save_plot

    target = file.with_suffix(".png") if target is None else target
    check_picture(target)
    with Recording(file) as recording, OneLine(err) as line:
        values = _values(recording, wanted)
        drawn = _drawn(values, line, with_alarms=not wanted.paths)
        about = recording.about
        when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(float(about.get("started", 0.0))))
        heading = f"{title(about['station'], about.get('wiring'))}: {file.name}, recorded from {when} on"
        with replacing(target) as new:
            rest = save_plot(drawn, new, heading)
        values.look_for_damage()
    out.print(f"{target}{f'; the plot does not show {rest}' if rest else ''}", soft_wrap=True)
    _tell_missing(values)
    return 0


def _drawn(values: Any, line: OneLine, with_alarms: bool = False) -> Any:
    """Return at most about `MAX_ROWS` rows of the recording, its progress, and the times at which its alarms were
    active."""
    import numpy as np

    from umo.operation.alarms.alarm_log import AlarmLog
    from umo_command.run.plot import Curve, Curves

    most = max(min(MAX_ROWS, MAX_NUMBERS // (3 + len(values.entries))), 1)
    stride, first = max(1, -(-values.periods // most)), 0
    parts: list[Any] = []
    notes: list[tuple[float, str]] = []
    alarms = AlarmLog(values.layout.alarms if with_alarms else ())
    for frames, _ in values.parts():
        kept = frames["missed"] > 0
        kept[(-first) % stride :: stride] = True
        chosen, first = frames[kept], first + len(frames)
        for place in np.flatnonzero(np.append(True, frames["progress"][1:] != frames["progress"][:-1])):
            text = frames["progress"][place].decode(errors="replace")
            if not notes or notes[-1][1] != text:
                notes.append((float(frames["time"][place]), text))
        if with_alarms:
            alarms.add_frames(frames)
        if len(chosen):
            before = np.column_stack([chosen["time"], chosen["missed"], chosen["execution"] * 1e-3])
            parts.append(np.hstack([before, values.of(chosen)]))
        line.show(float(frames["time"][-1]), "reading", values.share(float(frames["time"][-1])))
    curves = [Curve.of(about, 3 + i) for i, about in enumerate(values.entries)]
    rows = np.concatenate(parts) if parts else np.zeros((0, 3 + len(curves)))
    return Curves(rows, curves, notes, "umo recording export writes all of them", alarms)


def _values(recording: Any, wanted: ValueSelection) -> Any:
    """Return the selected values. Raises FramesError if there are none."""
    from umo.recording.tables.recorded_values import RecordedValues

    values = RecordedValues(recording, wanted.paths, wanted.start, wanted.stop)
    if next(values.parts(), None) is None:
        first, last = recording.span
        raise FramesError(
            f"{recording.path} has no values at these times; its periods are from {first:g} s to {last:g} s"
        )
    return values


def _tell_missing(values: Any) -> None:
    """Report what the recording lacks."""
    if values.bare:
        say(f"{values.bare:,} periods are not shown: of these the recording has only the data that a replay needs")
    if values.lost:
        say(f"{values.lost:,} periods are missing in the recording (umo recording info)", "red")
    for text in values.damage[-MAX_DAMAGE:]:
        say(text, "red")
