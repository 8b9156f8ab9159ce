"""The end of a run, for the page: from its last event; if it could not tell it, from what the guardian left."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from umo.cycle.events import CommandState, Event
from umo.latency import blackbox
from umo.page.box_words import BoxInWords
from umo.system.device_record import Ended, standing

UNKNOWN_END = "it ended without a word: all of its processes were killed"


class Ending(NamedTuple):
    """End of a run."""

    failed: bool
    text: str


def ending_of(about: Mapping[str, Any], last: Event | None, box: BoxInWords) -> Ending | None:
    """End of the run that `about` describes; None: nothing tells it. `last` is its event of the end. It reads
    records: call it in a thread; again after a while, as the guardian may still be resetting."""
    stands = _record(about)
    if stands is not None and stands.state == "stopped":
        left = f"not reached: {', '.join(stands.unreached)}" if stands.unreached else "every actuator was reset"
        return Ending(True, f"{stands.what}; {left}")
    if last is not None:
        return Ending(last.state is CommandState.FAILED, last.text)
    if box.reason not in ("", blackbox.MISSED_PERIOD, blackbox.ON_DEMAND):
        return Ending(True, box.reason)
    return None


def _record(about: Mapping[str, Any]) -> Ended | None:
    """The record of this run on its devices, not of a later one; None if it ended safely."""
    station, started = about.get("station"), float(about.get("started", 0.0))
    with suppress(OSError):
        for device in about.get("devices", ()):
            for ended in standing(str(device)):
                if ended.mine and ended.station == station and ended.began <= started <= ended.when:
                    return ended
    return None
