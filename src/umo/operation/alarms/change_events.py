"""The selection of the changes of alarms that are reported individually, so that chattering alarms and floods of alarms
do not displace all other events.

The number of kept events is small, and clients find their answers among them. So only a few changes per second are
reported for each alarm, and not many more for all alarms together. Half of these are reserved for the most important
alarms, the other half for the alarms that have waited longest, so that no alarm waits for ever even in a long flood.
The changes that are left out are counted, and their number is reported with the next change or when there is room. The
last state of every alarm is always reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

WINDOW = 1.0
"""Time in s for which changes are counted."""
MOST_OF_ONE, MOST_OF_ALL = 6, 200
"""The largest number of changes of one alarm, and of all alarms, that are reported within `WINDOW`. Changes by clients
are always reported."""
MOST_IN_A_PERIOD = 20
"""Largest number of changes by conditions that are reported in a period."""
NOT_DUE = float("inf")
"""The value of `due` for an alarm that is not due."""
LEFT_OUT = "changes before this one are not shown"


class ChangeEvents:
    """The reports of the changes of alarms with these priorities. `tell` is called with the number of an alarm, the
    client that has changed the alarm ("" for the machine itself), and the number of earlier changes that were not
    reported."""

    def __init__(self, priorities: Sequence[int], tell: Callable[[int, str, int], object]) -> None:
        count = len(priorities)
        self._tell = tell
        self._urgency = np.array(priorities, float)
        self._told = np.zeros(count, np.int64)
        """The number of changes of each alarm that were reported in this window."""
        self._told_in_all = 0
        self._window = -NOT_DUE
        """The end of the window in s."""
        self._told_now, self._now = 0, -NOT_DUE
        """Number of changes by conditions that were reported in the present period, and its time in s."""
        self._untold = np.zeros(count, np.int64)
        """The number of changes of each alarm since the last report."""
        self.due = np.full(count, NOT_DUE)
        """The time in s from which on the state of an alarm is to be reported if there is room."""
        self._since = np.full(count, NOT_DUE)
        """The time in s of the first change of each alarm that was not reported."""

    def changed(self, rows: NDArray[np.intp], now: float) -> None:
        """Note that conditions have changed these alarms. The next `tell` reports them if there is room."""
        self._begin_window(now)
        self._untold[rows] += 1
        self._since[rows] = np.minimum(self._since[rows], now)
        due = np.where(self._told[rows] < MOST_OF_ONE, now, self._window)
        self.due[rows] = np.minimum(self.due[rows], due)

    def changed_by(self, row: int, who: str, now: float) -> None:
        """Report immediately that a client has changed an alarm, or that its shelf has ended."""
        self._begin_window(now)
        self._untold[row] += 1
        self._tell_one(row, who)

    def tell(self, now: float) -> None:
        """Report the states that are due, if there is room (`_chosen`)."""
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
        """Return half of the most important alarms (of equals those that have waited longest), and half of those that
        have waited longest (of equals the most important)."""
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
        self._untold[row], self.due[row], self._since[row] = 0, NOT_DUE, NOT_DUE
        self._tell(row, who, left_out)
