"""Which changes of alarms are told: not those of an alarm that comes and goes all the time, and no avalanche at once.

Events are few, and clients find their answers among them. So of one alarm a few changes are told in a second, and of
all alarms together not many more. What was left out is told with the next change, or when the second is over: the last
state of every alarm is told in any case.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

WINDOW = 1.0
"""Time in s for which changes are counted."""
MOST_OF_ONE, MOST_OF_ALL = 6, 200
"""Number of changes of one alarm, and of all, that are told in this time at most. Those by clients are always told."""
NEVER = float("inf")
LEFT_OUT = "changes before this one are left out"


class Telling:
    """Tells the changes of so many alarms. `tell` is given the number of the alarm, its state in words, the client."""

    def __init__(self, count: int, tell: Callable[[int, str, str], object]) -> None:
        self._tell = tell
        self._told = np.zeros(count, np.int64)
        """Number of changes of each that were told in this window."""
        self._told_in_all = 0
        self._window = -NEVER
        """The end of the window, s."""
        self._left_out = np.zeros(count, np.int64)
        self.due = np.full(count, NEVER)
        """The time in s when the state of an alarm is to be told (`tell_state`)."""

    def change(self, row: int, text: str, who: str, now: float) -> None:
        """An alarm has changed."""
        self._begin_window(now)
        if not who and self._is_spent(row):
            self._left_out[row] += 1
            self.due[row] = self._window
            return
        self._tell_with(row, text, who, int(self._left_out[row]))

    def tell_state(self, row: int, text: str, now: float) -> None:
        """Tell the state of an alarm whose last change was left out."""
        self._begin_window(now)
        if self._is_spent(row):
            self.due[row] = self._window
        else:
            self._tell_with(row, text, "", int(self._left_out[row]) - 1)

    def _begin_window(self, now: float) -> None:
        if now >= self._window:
            self._window, self._told_in_all = now + WINDOW, 0
            self._told.fill(0)

    def _is_spent(self, row: int) -> bool:
        return bool(self._told[row] >= MOST_OF_ONE or self._told_in_all >= MOST_OF_ALL)

    def _tell_with(self, row: int, text: str, who: str, left_out: int) -> None:
        self._told[row] += 1
        self._told_in_all += 1
        self._left_out[row], self.due[row] = 0, NEVER
        self._tell(row, f"{text}; {left_out} {LEFT_OUT}" if left_out > 0 else text, who)
