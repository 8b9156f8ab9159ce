"""Lines on the terminal of a run for the changes of its alarms and of its mode.

The control process itself logs faults of equipment, interlocks and limits. It does not log alarms and commands of
clients, because they may be many: their lines are made here, from the events, and in real time outside this process.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf

from umo.cycle.events import ALARM, CommandState, Event
from umo.operation.alarms.alarm_states import PUT_AWAY
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.verbs import MODE

LINES_PER_SECOND = 10
"""The largest number of lines within a second on the wall clock. Further changes are counted."""
HIDDEN = tuple(f"{state} (" for state in PUT_AWAY)
"""The beginnings of the texts of events that concern hidden alarms."""


class EventLines:
    """Shows those events of a run that change an alarm or the mode."""

    def __init__(
        self, show: Callable[[float, str], None], mode: Mode, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`show` prints a time in s on the machine's clock, and a text. `mode`: the mode at the beginning. `clock`: the
        clock in s by which the lines of a second are counted."""
        self._show, self._clock = show, clock
        self._mode = mode_command(mode)
        """The last command that changed the mode."""
        self._end = -inf
        """Time at which the present second ends."""
        self._shown = self._left_out = 0
        """Number of lines in the present second, and of changes without a line."""
        self._time = 0.0
        """Time of the last change."""

    def add(self, event: Event) -> None:
        """Show the next event if it is such a change, and there are not too many."""
        if text := self._line_of(event):
            self.look()
            self._time = event.time
            if self._shown < LINES_PER_SECOND:
                self._shown += 1
                self._show(event.time, text)
            else:
                self._left_out += 1

    def look(self, *, is_over: bool = False) -> None:
        """Show how many changes had no line, if the second, or the run, is over."""
        if is_over or self._clock() >= self._end:
            if self._left_out:
                self._show(self._time, f"and {self._left_out:,} more changes within a second")
            self._end, self._shown, self._left_out = self._clock() + 1.0, 0, 0

    def _line_of(self, event: Event) -> str:
        """Return the line for a change of an alarm or of the mode; "" for any other event, and for an alarm that was
        hidden before."""
        by = f" ({event.who})" if event.who else ""
        if event.asked == ALARM and (event.who or not event.text.startswith(HIDDEN)):
            return f"alarm {event.path}: {event.text}{by}"
        if event.asked in MODES and event.asked != self._mode and event.state is CommandState.DONE:
            self._mode = event.asked
            return f"{event.asked}{by}"
        return ""


def mode_command(mode: Mode) -> str:
    """Return the command that changes the mode, as events have it."""
    return f"{MODE.name} {mode}"


MODES = frozenset(map(mode_command, Mode))
