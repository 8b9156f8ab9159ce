"""The history of a station's alarms, written from its frames in a process other than the control process."""

from __future__ import annotations

from typing import Any

from umo.cycle.events import ALARM
from umo.operation.alarms import alarm_file
from umo.operation.alarms.alarm_file import AlarmRecord
from umo.process.frames import RunReader

LOST = "{} events were overwritten before they could be stored; changes of alarms may be missing"


class AlarmHistory:
    """The history of the alarms of one run. `next`: the number of the first event that has not been examined."""

    def __init__(self, next_event: int = 0) -> None:
        self.next = next_event

    def take(self, reader: RunReader, frame: Any) -> None:
        """Write the changes of alarms among the new events, and the number of earlier events that were lost. Raises
        OSError if they cannot be written; the next call tries again. `frame`: a frame of the run, which relates the
        cycle's clock to UTC."""
        new = reader.events(self.next) if reader.layout.alarms else []
        utc_at_zero = utc_of(frame) - float(frame["time"])
        records = [
            AlarmRecord(utc_at_zero + each.time, each.time, each.path, each.text, each.who)
            for _, each in new
            if each.asked == ALARM
        ]
        if new and (lost := new[0].number - self.next):
            time = new[0].event.time
            records.insert(0, AlarmRecord(utc_at_zero + time, time, "", LOST.format(lost), ""))
        if records:
            alarm_file.append(alarm_file.file_of(str(reader.about["station"])), records)
        if new:
            self.next = new[-1].number + 1


def utc_of(frame: Any) -> float:
    """Return the time at which the period of a frame began, in s since 1970."""
    return (int(frame["began"]) + int(frame["utc"])) / 1e9
