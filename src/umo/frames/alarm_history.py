"""Writing the history of a station's alarms from its frames, in a process beside the control process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from umo.alarms import alarm_file
from umo.cycle.events import ALARM, Event
from umo.errors import text_of


class AlarmHistory:
    """The history of one station. `say` is told once, if it cannot be written."""

    def __init__(self, station: str, say: Callable[[str], object], clock: Callable[[], float] = time.time) -> None:
        self._station, self._say, self._clock = station, say, clock
        self._fails = False

    def append(self, events: Iterable[Event]) -> None:
        """Add the changes of alarms among new events. It raises nothing: without a disk there is no history."""
        now = self._clock()
        changes = [each for each in events if each.asked == ALARM]
        if not changes or self._fails:
            return
        records = [alarm_file.AlarmRecord(now, each.time, each.path, each.text, each.who) for each in changes]
        try:
            alarm_file.append(alarm_file.file_of(self._station), records)
        except OSError as error:
            self._fails = True
            self._say(f"the history of alarms is no longer written: {text_of(error)}")
