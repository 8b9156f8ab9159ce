"""Events: what guards, clients and the machine itself did, one after another."""

from __future__ import annotations

from collections import deque
from enum import IntEnum
from typing import NamedTuple

KEPT_EVENTS = 1000
"""Number of the last events that are kept."""
LIMIT_COUNT, LIMIT_TIME = 3, 60.0
"""Number of absences of one driver that are told within so many s, each with its end."""
EVENT_TEXT_BYTES = 448
"""Length of an event's text that others see, bytes of UTF-8."""
END = "end"
"""`Event.asked` of the last event of a run. Its state is DONE (the application has ended), CANCELLED (the run was
stopped) or FAILED; it has no number of a command."""


FAULT = "fault"
"""`Event.asked` of the event that equipment, at its path, has come into fault."""
IN_FAULT = "in fault: "
"""Beginning of the text of this event; the reason follows."""
FAULT_CLEARED = "fault cleared"
"""Text of the event that the fault of the equipment at its path has ended."""
ALARM = "alarm"
"""`Event.asked` of a change of the alarm at its path; the text begins with its new state (`umo.alarms`)."""


class CommandState(IntEnum):
    """The state of a command; the numbers stand in shared memory, so they keep their meaning."""

    NONE = 0
    """The event is not a command's."""
    BEGUN = 1
    """An action, or a change to automatic mode, has begun; another event tells its end. Further ones of this state
    tell the progress of an action."""
    DONE = 2
    REFUSED = 3
    """The command is not allowed, or not valid: nothing was changed."""
    FAILED = 4
    """The command was carried out, and failed."""
    CANCELLED = 5

    def __str__(self) -> str:
        return self.name.lower()


class EventLimit:
    """How often something of one source is told: `LIMIT_COUNT` times within `LIMIT_TIME`. What flickers does not push
    all other events out."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=LIMIT_COUNT)
        self._left_out = 0

    def passed(self, now: float, text: str) -> str:
        """The text to be told at this time in s, with the number of those that were left out before; "": it is left
        out."""
        if len(self._times) == LIMIT_COUNT and now - self._times[0] < LIMIT_TIME:
            self._left_out += 1
            return ""
        self._times.append(now)
        left_out, self._left_out = self._left_out, 0
        return f"{text} ({left_out} such events before were not told)" if left_out else text


class Event(NamedTuple):
    """Something happened: when (s on the cycle's clock), to which object, what."""

    time: float
    path: str
    text: str
    """The words; for a command that has ended its result as JSON, or its error."""
    who: str = ""
    """The client; empty: the machine itself."""
    command: int = 0
    """The number of a client's command, from 1."""
    state: CommandState = CommandState.NONE
    asked: str = ""
    """The command in words."""

    @property
    def is_end(self) -> bool:
        """Whether it tells the end of the run."""
        return self.asked == END and not self.command


class Events(deque[Event]):
    """The last events; `number` counts all."""

    def __init__(self) -> None:
        super().__init__(maxlen=KEPT_EVENTS)
        self.number = 0

    def add(self, event: Event) -> None:
        self.number += 1
        self.append(event)
