"""Finds what a run leaves for the page: its newest black box as text, and how the run ended."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from umo.cycle.events import CommandState, Event
from umo.errors import FramesError
from umo.process.frames import Reader, blackbox
from umo.process.frames.causes import explain_all, sentences
from umo.system.device_record import Ended, left_by

UNKNOWN_END = "the run ended without a report: all of its processes were killed"
MAX_OCCASIONS = 3
"""Number of the last missed periods of a black box that are shown."""
RUN_FACTS = ("pid", "started", "started_monotonic")
"""Facts that identify a run. Only the black boxes of this run contain the same facts."""


class BoxInWords(NamedTuple):
    name: str = ""
    """Name of the file, or empty if there is none."""
    text: str = ""
    reason: str = ""
    """The reason why the black box was written."""


def newest_box(about: Mapping[str, Any], known: BoxInWords) -> BoxInWords:
    """Return the newest black box of a run, or `known` if none is newer. The function opens files and takes some 10 ms,
    so call it in a thread."""
    try:
        found = blackbox.boxes(blackbox.folder())
    except (FramesError, OSError):
        return known
    run = _identity(about)
    for path in reversed(found):
        if path.name == known.name:
            break
        if _run_of(path) == run:
            return _read(path)
    return known


def _identity(about: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(about.get(name) for name in RUN_FACTS)


@lru_cache(4 * blackbox.MAX_BOXES)
def _run_of(path: Path) -> tuple[Any, ...] | None:
    """Return the identity of the run to which a black box belongs, or None if the black box cannot be read. A black box
    never changes, so the result is cached by path."""
    try:
        with Reader(path) as reader:
            return _identity(reader.about)
    except Exception:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return None


def _read(path: Path) -> BoxInWords:
    """Return when and why a black box was written, and the causes of the last missed periods in it."""
    try:
        with Reader(path) as reader:
            frames, about = reader.read(), reader.about
            verdicts = explain_all(frames, reader.layout)
            reason = str(about.get("reason", ""))
            lines = [f"{blackbox.kept_at(about)}: {reason}"]
            lines += sentences(frames, reader.layout, verdicts, MAX_OCCASIONS)
            return BoxInWords(path.name, "\n".join(lines), reason)
    except Exception as error:  # of a damaged file: whatever json, struct, numpy, mmap raise
        return BoxInWords(path.name, f"{path.name} cannot be read ({type(error).__name__})")


class Ending(NamedTuple):
    failed: bool
    text: str


def ending_of(about: Mapping[str, Any], last: Event | None, box: BoxInWords) -> Ending | None:
    """Return the end of the run that `about` describes, or None if it is not known. `last` is the event of the run that
    reports the end. The function reads records, so call it in a thread. Call it again after a while, because the
    guardian may still be resetting the machine."""
    stands = _record(about)
    if stands is not None:
        left = f"not reached: {', '.join(stands.unreached)}" if stands.unreached else "every actuator was reset"
        return Ending(True, f"{stands.what}; {left}")
    if last is not None:
        return Ending(last.state is CommandState.FAILED, last.text)
    if box.reason not in ("", blackbox.MISSED_PERIOD, blackbox.ON_DEMAND):
        return Ending(True, box.reason)
    return None


def _record(about: Mapping[str, Any]) -> Ended | None:
    """Return the record that this run has left on its devices; None if the run ended safely, or this is not known."""
    with suppress(OSError):
        return next((ended for ended in left_by(about) if ended.state == "stopped"), None)
    return None
