"""The times at which the alarms of one run were active, found from the states in its frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from umo.duration import duration
from umo.objects.presentation.run_facts import clock_text
from umo.operation.alarms.alarm_states import ACTIVE, AlarmState
from umo.operation.alarms.declaration import Priority

KEPT_SPANS = 10_000
"""The number of the most recent active spans of an alarm that are kept. All spans are counted."""
_IS_ACTIVE = np.isin(np.arange(256), [int(state) for state in ACTIVE])


class ShownStates(Protocol):
    """The alarm states in a frame."""

    time: float
    alarms: Any


@dataclass
class ActiveSpan:
    """A period in which an alarm was active, shelved or not. It ends when the alarm is removed from service."""

    path: str
    raised: float
    """The time at which the alarm became active, in s on the cycle's clock."""
    cleared: float | None = None
    """The time from which on the alarm was no longer active; None while it is active."""

    def __str__(self) -> str:
        if self.cleared is None:
            return f"since {clock_text(self.raised)}"
        return f"from {clock_text(self.raised)} to {clock_text(self.cleared)}"


@dataclass
class AlarmOfRun:
    """The history of an alarm in one run."""

    path: str
    text: str
    priority: Priority
    raised: int = 0
    """The number of times that the alarm became active."""
    cleared_s: float = 0.0
    """The total time in s for which the alarm was active, without a span that has not ended."""
    first: float = 0.0
    last: ActiveSpan | None = None
    was_removed: bool = False
    """True while the alarm is out of service, and was active before. If it is active afterwards, this counts as the
    same occurrence."""
    state: AlarmState = AlarmState.NORMAL

    def active_s(self, now: float) -> float:
        """Total time in s for which it was active, up to a time in s on the cycle's clock."""
        open_since = None if self.last is None or self.last.cleared is not None else self.last.raised
        return self.cleared_s + (0.0 if open_since is None else max(now - open_since, 0.0))

    def in_words(self, now: float) -> str:
        """Return the history as text: `the tank is too full (high): 3 times, 12.5 s in total, last from 50 s to 55
        s`."""
        times = f"{self.raised} times, {duration(self.active_s(now))} in total, last " if self.raised > 1 else ""
        return f"{self.text} ({self.priority}): {times}{self.last}"


class AlarmLog:
    """An observer that counts how often each alarm of a machine becomes active, and records when and for how long."""

    def __init__(self, described: Sequence[Mapping[str, Any]]) -> None:
        """`described`: the alarms as `DeclaredAlarm.describe` returns them, in the order of frames."""
        self.alarms = [
            AlarmOfRun(str(each["path"]), str(each["text"]), Priority[str(each["priority"]).upper()])
            for each in described
        ]
        self.spans: deque[ActiveSpan] = deque(maxlen=KEPT_SPANS)
        self.number = 0
        """The number of times that any alarm became active."""
        self.now = 0.0
        """Time of the last period, in s on the cycle's clock."""
        self._states = bytes(len(self.alarms))

    def __call__(self, frame: ShownStates) -> None:
        self._note(frame.time, frame.alarms.tobytes())

    def add_frames(self, frames: Any) -> None:
        """Add the next frames, such as those of a recording, in the order of their times."""
        states = frames["alarms"]
        changed = np.append(True, (states[1:] != states[:-1]).any(axis=1))
        for place in np.flatnonzero(changed).tolist():
            self._note(float(frames["time"][place]), states[place].tobytes())
        self.now = float(frames["time"][-1])

    def _note(self, time: float, states: bytes) -> None:
        self.now = time
        if states != self._states:
            before, after = (np.frombuffer(each, np.uint8) for each in (self._states, states))
            self._states = states
            for row in np.flatnonzero(_IS_ACTIVE[after] & ~_IS_ACTIVE[before]).tolist():
                self._raise(self.alarms[row])
            for row in np.flatnonzero(_IS_ACTIVE[before] & ~_IS_ACTIVE[after]).tolist():
                self._clear(self.alarms[row])
            for row in np.flatnonzero(after != before).tolist():
                alarm, was_active = self.alarms[row], _IS_ACTIVE[before[row]]
                alarm.state = AlarmState(int(after[row]))
                is_removed = alarm.state is AlarmState.OUT_OF_SERVICE
                alarm.was_removed = is_removed and bool(was_active or alarm.was_removed)

    @property
    def raised(self) -> list[AlarmOfRun]:
        """The alarms that were active, in the order of priority (the highest first) and then of time."""
        found = (each for each in self.alarms if each.raised)
        return sorted(found, key=lambda each: (-each.priority, each.first))

    @property
    def active(self) -> list[str]:
        """The paths of the alarms that are active now."""
        return [each.path for each in self.raised if each.last is not None and each.last.cleared is None]

    def _raise(self, alarm: AlarmOfRun) -> None:
        alarm.last = ActiveSpan(alarm.path, self.now)
        alarm.first = alarm.first if alarm.raised else self.now
        if not alarm.was_removed:
            alarm.raised += 1
            self.number += 1
        self.spans.append(alarm.last)

    def _clear(self, alarm: AlarmOfRun) -> None:
        assert alarm.last is not None
        alarm.last.cleared = self.now
        alarm.cleared_s += self.now - alarm.last.raised
