"""Which changes of alarms are told one by one: not those of an alarm that comes and goes all the time, and no avalanche
at once.

Events are few, and clients find their answers among them. So of one alarm a few changes are told in a second, and of
all alarms together not many more. Half of these are of the most important alarms, the other half of those that have
waited longest: in a flood that lasts no alarm waits for ever. What was left out is counted, and told with the next
change or when there is room: the last state of every alarm is told in any case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

WINDOW = 1.0
"""Time in s for which changes are counted."""
MOST_OF_ONE, MOST_OF_ALL = 6, 200
"""Number of changes of one alarm, and of all, that are told in this time at most. Those by clients are always told."""
MOST_IN_A_PERIOD = 20
"""Number of changes by conditions that are told in a period at most."""
NEVER = float("inf")
LEFT_OUT = "changes before this one are left out"


class Telling:
    """Tells the changes of some alarms with these priorities. `tell` is given the number of an alarm whose present
    state is to be told, the client who has changed it ("": the machine itself), and how many of its changes before were
    not told."""

    def __init__(self, priorities: Sequence[int], tell: Callable[[int, str, int], object]) -> None:
        count = len(priorities)
        self._tell = tell
        self._urgency = np.array(priorities, float)
        self._told = np.zeros(count, np.int64)
        """Number of changes of each that were told in this window."""
        self._told_in_all = 0
        self._window = -NEVER
        """The end of the window, s."""
        self._told_now, self._now = 0, -NEVER
        """Number of changes by conditions that were told in the present period, and its time in s."""
        self._untold = np.zeros(count, np.int64)
        """Number of changes of each since it was told last."""
        self.due = np.full(count, NEVER)
        """The time in s from which on the state of an alarm is to be told, as far as there is room."""
        self._since = np.full(count, NEVER)
        """The time in s of the first change of each that was not told."""

    def changed(self, rows: NDArray[np.intp], now: float) -> None:
        """Conditions have changed these alarms: they are told by the next `tell`, as far as there is room."""
        self._begin_window(now)
        self._untold[rows] += 1
        self._since[rows] = np.minimum(self._since[rows], now)
        due = np.where(self._told[rows] < MOST_OF_ONE, now, self._window)
        self.due[rows] = np.minimum(self.due[rows], due)

    def changed_by(self, row: int, who: str, now: float) -> None:
        """A client has changed an alarm, or its shelf has ended: told at once."""
        self._begin_window(now)
        self._untold[row] += 1
        self._tell_one(row, who)

    def tell(self, now: float) -> None:
        """Tell the states that are due, as far as there is room (`_chosen`)."""
        self._begin_window(now)
        if now > self._now:
            self._told_now, self._now = 0, now
        rows = np.flatnonzero(self.due <= now)
        if self._told_in_all >= MOST_OF_ALL:
            self.due[rows] = self._window
            return
        room = min(MOST_IN_A_PERIOD - self._told_now, MOST_OF_ALL - self._told_in_all)
        if len(rows) > room:
            rows = self._chosen(rows, room)
        self._told_now += len(rows)
        for row in rows.tolist():
            self._tell_one(row, "")

    def _chosen(self, rows: NDArray[np.intp], room: int) -> NDArray[np.intp]:
        """Half of them are the most important, of equal ones those that have waited longest; the others those that have
        waited longest, of equal ones the most important."""
        urgency, since = -self._urgency[rows], self._since[rows]
        by_urgency, by_wait = np.lexsort((rows, since, urgency)), np.lexsort((rows, urgency, since))
        first = by_urgency[: room - room // 2]
        waiting = by_wait[~np.isin(by_wait, first)]
        chosen: NDArray[np.intp] = rows[np.concatenate([first, waiting[: room // 2]])]
        return chosen

    def _begin_window(self, now: float) -> None:
        if now >= self._window:
            self._window, self._told_in_all = now + WINDOW, 0
            self._told.fill(0)

    def _tell_one(self, row: int, who: str) -> None:
        left_out = int(self._untold[row]) - 1
        self._told[row] += 1
        self._told_in_all += 1
        self._untold[row], self.due[row], self._since[row] = 0, NEVER, NEVER
        self._tell(row, who, left_out)
