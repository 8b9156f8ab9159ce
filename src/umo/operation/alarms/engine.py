"""The alarms of one connected machine: their conditions with delays, their states, and operations of clients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import islice, repeat
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from umo.duration import TIME_TOLERANCE
from umo.objects.scaling import ByteArray
from umo.operation.alarms.alarm_states import (
    BAD_STATES,
    PUT_AWAY,
    PUTTING_AWAY,
    SHELVED_STATES,
    AlarmState,
    Operation,
    transitions,
)
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.alarms.change_events import LEFT_OUT, NOT_DUE, ChangeEvents
from umo.operation.alarms.collecting import DeclaredAlarm
from umo.operation.alarms.conditions import BAD, FALSE, TRUE, AlarmImage, Conditions

REQUESTS_PER_PERIOD = 20
"""Largest number of operations of clients, and of shelves whose time is over, that are carried out in a period. Further
operations follow in the next periods. Changes of conditions take effect in their period, regardless of their number."""
LONGEST_SHELF = 7 * 86_400.0
"""Longest time in s for which an alarm can be shelved."""

RESULTS = {
    AlarmState.UNACKNOWLEDGED: TRUE,
    AlarmState.ACKNOWLEDGED: TRUE,
    AlarmState.BAD_UNACKNOWLEDGED: BAD,
    AlarmState.BAD_ACKNOWLEDGED: BAD,
}
"""The results of conditions that belong to active states, except shelved ones."""
Rows = NDArray[np.intp]
"""The numbers of some alarms."""
TellChange = Callable[[str, str, str], object]
"""The function that is called for a change with the path of the alarm, the text and the client ("" for the machine
itself)."""


class AlarmRequest(NamedTuple):
    """The request of a client for an alarm."""

    operation: Operation
    who: str
    seconds: float = 0.0
    """Shelving time in s."""
    words: str = ""
    """Shelving time as text."""


class AlarmEngine:
    """The alarms of one machine. `now` returns the time in s on the cycle's clock. The states are in a column of the
    image."""

    def __init__(
        self, declared: Sequence[DeclaredAlarm], image: AlarmImage, now: Callable[[], float], tell: TellChange
    ) -> None:
        self.declared = list(declared)
        self.paths = [each.path for each in declared]
        self.below = _rows_below(self.paths)
        """The numbers of the alarms at and below each path; "" for all alarms."""
        self.states = image.columns.alarms
        """The number of the `AlarmState` of each alarm."""
        self._conditions = Conditions(declared, image)
        self._now = now
        priorities = [each.alarm.priority for each in declared]
        self._events = ChangeEvents(priorities, self._tell)
        self._tell_change = tell
        self._words: dict[int, str] = {}
        """The words of the last change of an alarm, if a client or the end of a shelving time made this change."""
        options = [(latch, acknowledge) for latch in (False, True) for acknowledge in (False, True)]
        self._by_kind = [transitions(*each) for each in options]
        """The tables by the kind of an alarm, which is the number of its options."""
        self._next_states = np.array([_next_states(table) for table in self._by_kind], np.uint8)
        self._kinds = np.array([2 * each.alarm.latch + each.alarm.acknowledge for each in declared], np.intp)
        self._delays = np.array([each.alarm.delays for each in declared], float).reshape(len(declared), 2).T.copy()
        """The on-delays and off-delays in s."""
        count = len(self.declared)
        self.times = np.full((len(AlarmTimes._fields), count), nan)
        """The times of each alarm. The rows are the fields of `AlarmTimes`."""
        self.raised, self.first_raised, self.last_raised, self._until = self.times
        self.raised.fill(0)
        self._until.fill(NOT_DUE)
        self.revision = 0
        """A number that grows with each change of `times`."""
        self._seen = np.zeros(count, np.uint8)
        """The results of the conditions that have been processed."""
        self._counting = np.zeros(count, np.uint8)
        """The active alarms, after their delays."""
        self._due = np.full(count, NOT_DUE)
        """The times in s at which a delay ends."""
        self._next = NOT_DUE
        """The first time at which a delay or a shelving ends."""
        self._requests: dict[int, tuple[AlarmRequest, ...]] = {}
        """The requests of clients that were not carried out yet, by alarm. The alarms of one command share a
        request."""

    @property
    def turns(self) -> int:
        """Number of periods in which each of the user's functions is called once."""
        return self._conditions.turns

    def restore(self, states: Mapping[str, int]) -> None:
        """Continue with the states of an earlier run, by path. Call this before the first evaluation; there are no
        events. An alarm without a valid state begins as normal, and so does a shelved alarm, because the remaining time
        is not known. An active alarm stays active until its condition has ended."""
        for row, path in enumerate(self.paths):
            number = states.get(path, AlarmState.NORMAL)
            reachable = {*self._table(row).values()} - SHELVED_STATES
            if number not in reachable:
                continue
            self.states[row] = number
            if result := RESULTS.get(AlarmState(number), FALSE):
                self._seen[row] = self._counting[row] = result
                self._conditions.hold(row, result)

    def look(self) -> None:
        """Evaluate the conditions and change the states. Called once per period, after the laws. It raises no error."""
        conditions = self._conditions
        conditions.evaluate()
        changed = conditions.results.tobytes() != self._seen.tobytes()  # quicker than a comparison of arrays
        if changed:
            self._notice(np.flatnonzero(conditions.results != self._seen))
        if self._next < NOT_DUE and self._next <= self._now() + TIME_TOLERANCE:
            self._end_times()
            changed = True
        if changed:
            self._events.tell(self._now())  # before what clients do with them
        if self._requests:
            self._obey()
            self._events.tell(self._now())
            changed = True
        if changed:
            self._next = float(min(self._due.min(), self._until.min(), self._events.due.min()))

    # By conditions -------------------------------------------------------------------------------------

    def _notice(self, rows: Rows) -> None:
        """Take note of the conditions that have changed: they count at once, or after a delay."""
        results = self._conditions.results[rows]
        self._seen[rows] = results
        counting = self._counting[rows]
        active = results != FALSE
        turned = active != (counting != FALSE)
        delays = np.where(active, self._delays[0, rows], self._delays[1, rows])
        waits = turned & (delays > 0.0)
        begins = waits & (self._due[rows] == NOT_DUE)
        self._due[rows[~turned]] = NOT_DUE
        self._due[rows[begins]] = self._now() + delays[begins]
        counts = ~waits & (results != counting)
        self._count(rows[counts], results[counts])

    def _count(self, rows: Rows, results: ByteArray) -> None:
        """These conditions count from now on."""
        came = rows[(self._counting[rows] == FALSE) & (results != FALSE)]
        self._counting[rows], self._due[rows] = results, NOT_DUE
        if len(came):
            self.revision += 1
            self.raised[came] += 1
            self.last_raised[came] = self._now()
            self.first_raised[came] = np.fmin(self.first_raised[came], self._now())
        self._step(rows, results)

    def _step(self, rows: Rows, operations: ByteArray) -> None:
        """The next states by conditions, whose results are the numbers of operations."""
        before = self.states[rows]
        after = self._next_states[self._kinds[rows], before, operations]
        moved = rows[after != before]
        self.states[rows] = after
        for row in self._words.keys() & set(moved.tolist()) if self._words else ():
            del self._words[row]
        self._events.changed(moved, self._now())

    def _end_times(self) -> None:
        """End the delays and shelves that are due."""
        now = self._now() + TIME_TOLERANCE
        rows = np.flatnonzero(self._due <= now)
        self._count(rows, self._seen[rows])
        for row in np.flatnonzero(self._until <= now)[:REQUESTS_PER_PERIOD].tolist():
            self._carry_out(row, AlarmRequest(Operation.UNSHELVE, "", words="the shelving time has ended"))

    # By clients ----------------------------------------------------------------------------------------

    def able(self, rows: Sequence[int], operation: Operation) -> list[int]:
        """Return the alarms that an operation would change after all requests so far are carried out. For shelving,
        these include alarms of which only the time changes."""
        chosen = np.asarray(rows, np.intp)
        facts = [column[chosen].tolist() for column in (self._kinds, self.states, self._counting)]
        waiting = list(map(self._requests.get, rows, repeat(())))
        accepts = lru_cache(maxsize=None)(partial(self._accepts, operation))  # many are alike
        return [row for row, yes in zip(rows, map(accepts, *facts, waiting), strict=True) if yes]

    def _accepts(
        self, operation: Operation, kind: int, state: int, counting: int, waiting: tuple[AlarmRequest, ...]
    ) -> bool:
        """True if one kind of alarm accepts the operation in one state, with this result of its condition."""
        table, then = self._by_kind[kind], AlarmState(state)
        for each in waiting:
            before, then = then, table.get((then, each.operation), then)
            if before in PUT_AWAY and then not in PUT_AWAY:
                then = table.get((then, Operation(counting)), then)
        return (then, operation) in table

    def state_of(self, row: int) -> AlarmState:
        return AlarmState(int(self.states[row]))

    def request(self, rows: Sequence[int], request: AlarmRequest) -> None:
        """Carry out a request for each of these alarms at the next calls of `look`, in the order of the requests. If
        several requests shelve an alarm, remove it from service, or end either, the last one counts."""
        joined = lru_cache(maxsize=None)(partial(_joined, request))  # many wait for the same
        waiting = map(self._requests.get, rows, repeat(()))
        self._requests.update(zip(rows, map(joined, waiting), strict=False))

    def _obey(self) -> None:
        for row in list(islice(self._requests, REQUESTS_PER_PERIOD)):
            for each in self._requests.pop(row):
                self._carry_out(row, each)

    def _carry_out(self, row: int, request: AlarmRequest) -> None:
        before, operation = self.state_of(row), request.operation
        state = self._table(row).get((before, operation))
        if state is None:
            return  # it has changed since
        self._until[row] = self._now() + request.seconds if operation is Operation.SHELVE else NOT_DUE
        self.revision += 1
        if state is not before or operation is Operation.SHELVE:
            self.states[row] = state
            self._words[row] = request.words
            self._events.changed_by(row, request.who, self._now())
        if before in PUT_AWAY and state not in PUT_AWAY:
            self._step(np.array([row]), self._counting[[row]])

    def _table(self, row: int) -> Mapping[tuple[AlarmState, Operation], AlarmState]:
        return self._by_kind[int(self._kinds[row])]

    def _tell(self, row: int, who: str, left_out: int) -> None:
        """Make an event of the state of an alarm, with the number of its earlier changes that had none."""
        state, words = self.state_of(row), self._words.get(row, "")
        if state in BAD_STATES and not words:
            words = f"cannot be evaluated: {self._conditions.causes.get(row, '')}"
        more = f"{left_out} {LEFT_OUT}" if left_out > 0 else ""
        text = told_text(state, self.declared[row], "; ".join(filter(None, (words, more))))
        self._tell_change(self.paths[row], text, who)


def _next_states(table: Mapping[tuple[AlarmState, Operation], AlarmState]) -> list[list[int]]:
    """The next state by the numbers of state and operation; the same one where nothing changes."""
    return [[table.get((state, operation), state) for operation in Operation] for state in AlarmState]


def _rows_below(paths: Sequence[str]) -> Mapping[str, list[int]]:
    """The places of some paths at and below each path; made once: a command looks them up."""
    found: dict[str, list[int]] = {"": list(range(len(paths)))}
    for row, path in enumerate(paths):
        place = 0
        while place >= 0:
            place = path.find(".", place + 1)
            found.setdefault(path if place < 0 else path[:place], []).append(row)
    return found


def _joined(request: AlarmRequest, waiting: tuple[AlarmRequest, ...]) -> tuple[AlarmRequest, ...]:
    """A request behind those that wait."""
    if request.operation in PUTTING_AWAY:
        waiting = tuple(each for each in waiting if each.operation not in PUTTING_AWAY)
    return *waiting, request


def told_text(state: AlarmState, declared: DeclaredAlarm, words: str = "") -> str:
    """Return the text of an event: `unacknowledged (high): the tank is too full`, followed by `words`."""
    alarm = declared.alarm
    return f"{state} ({alarm.priority}): {alarm.text}" + (f"; {words}" if words else "")
