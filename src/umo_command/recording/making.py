"""`umo recording make`: record a running station, save the content of a flight recorder, repair a file."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any

from umo.duration import duration, lasting
from umo.errors import FramesError, OptionError, UmoError, text_of
from umo.exit_status import ExitStatus
from umo.process.frames import RunReader
from umo_command.background import step_back
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.run.record_beside import SUFFIX, check_installed, order_of


def record_station(station: str, file: Path | None, limit: float | None, changes: Mapping[str, Any]) -> int:
    """Record a running station until it ends, for a time in s at most, or until Ctrl-C or SIGTERM."""
    if limit is not None and changes.get("last") is not None:
        raise OptionError("--for ends a recording, and --last is a flight recorder, which saves nothing at its end")
    order = order_of(file, changes, None, _default(station))
    from umo.process.frames.search import find_running
    from umo.recording.record_settings import RecordSettings
    from umo_command.run.record_work import RecordingWork, record_to_the_end

    stop = _stop_on_signals()
    with find_running(station, say) as reader:
        step_back()
        settings = RecordSettings(**order.settings)
        work, began = RecordingWork(reader, order.file, settings, say), time.monotonic()
        end = began + (inf if limit is None else limit)
        out.print(_opening(reader, order.file, settings.last, limit), soft_wrap=True)
        with OneLine(err) as line:

            def pause(seconds: float) -> None:
                if err.is_terminal:
                    line.show(time.monotonic() - began, work.progress, None)
                stop.wait(min(seconds, max(end - time.monotonic(), 0.0)))

            record_to_the_end(work, lambda: stop.is_set() or time.monotonic() >= end, pause)
    return ExitStatus.NOT_RECORDED if work.failed else 0


def _stop_on_signals() -> threading.Event:
    """Set by Ctrl-C and SIGTERM."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def _opening(reader: RunReader, file: Path, last: float | None, limit: float | None) -> str:
    """Return the lines printed at the start: what is recorded, and how to end it."""
    frame = reader.latest()
    name, since = reader.title, 0.0 if frame is None else float(frame["time"])
    with reader.again() as other:
        oldest = other.read(1)["time"]
    before = f", with the {duration(since - float(oldest[0]))} before this command" if len(oldest) else ""
    state = f"{reader.state} for {lasting(since)}"
    if last is None:
        end = "Ctrl-C" if limit is None else f"--for {duration(limit)}, or Ctrl-C,"
        return f"recording {name} ({state}) in {file}{before}; {end} ends the recording, and the machine continues"
    station = reader.about["station"]
    return (
        f"keeping the last {duration(last)} of {name} ({state}); this time is saved by umo recording save {station}, "
        f"and if the run fails; Ctrl-C ends the flight recorder, and the machine continues"
    )


def save_flight(station: str, file: Path | None) -> int:
    """Save the content of a station's flight recorder."""
    order = order_of(file, {}, None, _default(station))
    from umo.recording import flight_folder
    from umo.recording.recording import Recording

    folder = flight_folder.find(station)
    try:
        folder.save(order.file)
    except OSError as error:
        raise UmoError(f"{order.file} could not be written: {text_of(error)}") from None
    with Recording(order.file) as recording:
        periods = recording.periods
    out.print(f"saved: {order.file} ({periods} periods)", soft_wrap=True)
    if not folder.is_written:
        out.print("the recorder has ended: the file has only the data that it had written", soft_wrap=True)
    return 0


def repair_file(file: Path) -> int:
    """Repair a file that was truncated or damaged."""
    check_installed()
    from umo.recording.copying import repair
    from umo.recording.recording import Recording

    try:
        changed = repair(file)
    except OSError as error:
        raise FramesError(f"{file} could not be repaired: {text_of(error)}") from None
    with Recording(file, later=False) as recording:
        periods, (_, last) = recording.periods, recording.span
        missing = "" if not (lost := recording.lost) else f"; {lost:,} periods are missing"
        chunks = recording.chunks
    what = f"{chunks} chunks, {periods} periods"
    if periods:
        what += f", {duration(last)} on the machine's clock"
    out.print(f"{file}: {'repaired' if changed else 'complete'}: {what}{missing}", soft_wrap=True)
    return 0


def _default(station: str) -> Path:
    name = Path(station).name or "station"
    return Path(f"{name}-{time.strftime('%Y%m%d-%H%M%S')}{SUFFIX}")
