"""`umo record`: record a running station, save what a flight recorder has, repair a file."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from umo.errors import FramesError, OptionError, UmoError, text_of
from umo.exit_status import ExitStatus
from umo.presentation.durations import duration

from .background import step_back
from .console import out, say
from .record_beside import SUFFIX, check_installed, order_of


def record_station(station: str, file: Path | None, changes: Mapping[str, Any]) -> int:
    """Record a running station until it ends, or Ctrl-C or SIGTERM."""
    order = order_of(file, changes, None, _default(station))
    from umo.recording.record_settings import RecordSettings
    from umo.remote.search import find_running

    from .record_work import RecordingWork, record_to_the_end

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with find_running(station, say) as reader:
        step_back()
        work = RecordingWork(reader, order.file, RecordSettings(**order.settings), say)
        out.print(f"records {reader.about['station']}; Ctrl-C ends the record, the machine runs on", soft_wrap=True)
        record_to_the_end(work, stop.is_set, stop.wait)
    return ExitStatus.NOT_RECORDED if work.failed else 0


def save_flight(station: str, file: Path | None) -> int:
    """Save what the flight recorder of a station has."""
    order = order_of(file, {}, None, _default(station))
    from umo.recording import Recording, flight_folder

    folder = flight_folder.find(station)
    try:
        folder.save(order.file)
    except OSError as error:
        raise UmoError(f"{order.file} could not be written: {text_of(error)}") from None
    with Recording(order.file) as recording:
        frames = sum(len(block.frames) for block in recording.blocks(full=False))
    out.print(f"saved: {order.file} ({frames} periods)", soft_wrap=True)
    if not folder.is_written:
        out.print("its recorder was killed: these are the last seconds that it had written", soft_wrap=True)
    return 0


def repair_file(file: Path) -> int:
    """Make a file that was cut or torn whole."""
    check_installed()
    from umo.recording import Recording
    from umo.recording.copying import repair

    try:
        chunks, cut = repair(file)
    except OSError as error:
        raise FramesError(f"{file} could not be repaired: {text_of(error)}") from None
    with Recording(file, later=False) as recording:
        frames = recording.frames()
    what = f"{chunks} chunks, {len(frames)} periods"
    if len(frames):
        what += f", {duration(float(frames['time'][-1]))} on the machine's clock"
    out.print(f"{file}: {f'repaired, {cut} bytes cut off' if cut else 'whole'}: {what}", soft_wrap=True)
    return 0


def _default(station: str) -> Path:
    name = Path(station).name or "station"
    return Path(f"{name}-{time.strftime('%Y%m%d-%H%M%S')}{SUFFIX}")


def checked(words: list[str], save: bool, repair: bool) -> None:
    """OptionError if the words and options of the command do not fit together."""
    if save and repair:
        raise OptionError("--save and --repair: one of them")
    if repair and len(words) != 1:
        raise OptionError("--repair takes one FILE.mcap")
    if not repair and not 1 <= len(words) <= 2:
        raise OptionError("give a STATION (see umo ps), and perhaps a FILE.mcap")
