"""The alarms of one connected machine: their conditions with delays, their states, what clients do with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from itertools import islice, repeat
from typing import NamedTuple

import numpy as np

from umo.alarms.alarm_states import PUT_AWAY, PUTTING_AWAY, AlarmState, Operation, transitions
from umo.alarms.collecting import DeclaredAlarm
from umo.alarms.conditions import BAD, FALSE, NEVER, TRUE, AlarmImage, Conditions
from umo.alarms.telling import Telling

CHANGES_PER_PERIOD = 20
"""Number of the changes of conditions, of delays that end, and of operations of clients, each, that are carried out in
a period at most: an avalanche of alarms does not delay the loop. The others follow in the next periods."""
LONGEST_SHELF = 7 * 86_400.0
"""Longest time in s for which an alarm can be shelved."""
A_TICK = 1e-9
"""Tolerance in s of a sum of periods (rounding)."""

RESULTS = {
    AlarmState.UNACKNOWLEDGED: TRUE,
    AlarmState.ACKNOWLEDGED: TRUE,
    AlarmState.BAD_UNACKNOWLEDGED: BAD,
    AlarmState.BAD_ACKNOWLEDGED: BAD,
}
"""The results of conditions that belong to active states."""
TellChange = Callable[[str, str, str], object]
"""Function that is told a change: path of the alarm, words, client ("": the machine itself)."""


class AlarmRequest(NamedTuple):
    """What a client wants with an alarm."""

    operation: Operation
    who: str
    seconds: float = 0.0
    """Of a shelf: how long, in s."""
    words: str = ""
    """Of a shelf: this in words."""


class AlarmEngine:
    """Alarms of one machine. `now` gives the time in s on the cycle's clock. The states stand in the image's column."""

    def __init__(
        self, declared: Sequence[DeclaredAlarm], image: AlarmImage, now: Callable[[], float], tell: TellChange
    ) -> None:
        self.declared = list(declared)
        self.paths = [each.path for each in declared]
        self.below = _rows_below(self.paths)
        """The numbers of the alarms at and below each path; "": of all."""
        self.states = image.columns.alarms
        """The number of the `AlarmState` of each alarm."""
        self._conditions = Conditions(declared, image)
        self._now = now
        self._telling = Telling(len(self.declared), lambda row, text, who: tell(self.paths[row], text, who))
        self._words = [""] * len(self.declared)
        """The words of the last change of each."""
        self._tables = [transitions(each.alarm.latch, each.alarm.acknowledge) for each in declared]
        options = [(latch, acknowledge) for latch in (False, True) for acknowledge in (False, True)]
        self._by_kind = [transitions(*each) for each in options]
        """The tables by the kind of an alarm, which is the number of its options."""
        self._kinds = np.array([2 * each.alarm.latch + each.alarm.acknowledge for each in declared], np.intp)
        count = len(self.declared)
        self._seen = np.zeros(count, np.uint8)
        """The results of the conditions that were taken note of."""
        self._counting = np.zeros(count, np.uint8)
        """Those that count: after their delays."""
        self._differs = np.zeros(count, bool)
        self._due, self._until = np.full(count, NEVER), np.full(count, NEVER)
        """The times in s when a delay ends, and a shelf."""
        self._next = NEVER
        """The first of these times."""
        self._last = -1
        """The alarm whose change was taken note of last."""
        self._requests: dict[int, tuple[AlarmRequest, ...]] = {}
        """What clients have asked for and was not carried out yet, by alarm; those of one command share it."""

    @property
    def turns(self) -> int:
        """Number of periods in which each of the user's functions is called once."""
        return self._conditions.turns

    def restore(self, states: Mapping[str, int]) -> None:
        """Go on with the states of an earlier run, by path, before the first look; nothing is told. An alarm whose path
        or state there is not, begins as normal; so does a shelved one: its time is not known. One that was active stays
        so until its condition has ended."""
        for row, path in enumerate(self.paths):
            number = states.get(path, AlarmState.NORMAL)
            reachable = {*self._tables[row].values()} - {AlarmState.SHELVED}
            if number not in reachable:
                continue
            self.states[row] = number
            if result := RESULTS.get(AlarmState(number), FALSE):
                self._seen[row] = self._counting[row] = result
                self._conditions.hold(row, result)

    def look(self) -> None:
        """Once per period, after the laws. It raises nothing."""
        conditions = self._conditions
        conditions.evaluate()
        np.not_equal(conditions.results, self._seen, out=self._differs)
        changed = bool(self._differs.any())
        if changed:
            self._notice()
        if self._next <= self._now() + A_TICK:
            self._end_times()
            changed = True
        if self._requests:
            self._obey()
            changed = True
        if changed:
            self._next = float(min(self._due.min(), self._until.min(), self._telling.due.min()))

    # By conditions -------------------------------------------------------------------------------------

    def _notice(self) -> None:
        """Take note of some of the conditions that have changed, each in its turn."""
        rows = np.flatnonzero(self._differs)
        start = int(np.searchsorted(rows, self._last, side="right"))
        for row in np.concatenate((rows[start:], rows[:start]))[:CHANGES_PER_PERIOD].tolist():
            self._last = row
            self._note(row, int(self._conditions.results[row]))

    def _note(self, row: int, result: int) -> None:
        self._seen[row] = result
        active = result != FALSE
        if active == (self._counting[row] != FALSE):
            self._due[row] = NEVER
            if result != self._counting[row]:
                self._count(row, result)
            return
        on_delay, off_delay = self.declared[row].alarm.delays
        delay = on_delay if active else off_delay
        if not delay:
            self._count(row, result)
        elif self._due[row] == NEVER:
            self._due[row] = self._now() + delay

    def _count(self, row: int, result: int) -> None:
        """The condition counts from now on."""
        self._counting[row], self._due[row] = result, NEVER
        self._step(row, Operation(result))

    def _end_times(self) -> None:
        """End the delays and shelves that are due."""
        now = self._now() + A_TICK
        for row in np.flatnonzero(self._due <= now)[:CHANGES_PER_PERIOD].tolist():
            self._count(row, int(self._seen[row]))
        for row in np.flatnonzero(self._until <= now)[:CHANGES_PER_PERIOD].tolist():
            self._carry_out(row, AlarmRequest(Operation.UNSHELVE, "", words="its time is over"))
        for row in np.flatnonzero(self._telling.due <= now)[:CHANGES_PER_PERIOD].tolist():
            self._telling.tell_state(row, self._text(row), now)

    # By clients ----------------------------------------------------------------------------------------

    def able(self, rows: Sequence[int], operation: Operation) -> list[int]:
        """Those of some alarms that an operation would change, as they are when all that was asked for is done; of a
        shelf the time too."""
        chosen = np.asarray(rows, np.intp)
        facts = [column[chosen].tolist() for column in (self._kinds, self.states, self._counting)]
        waiting = list(map(self._requests.get, rows, repeat(())))
        accepts = lru_cache(maxsize=None)(partial(self._accepts, operation))  # many are alike
        return [row for row, yes in zip(rows, map(accepts, *facts, waiting), strict=True) if yes]

    def _accepts(
        self, operation: Operation, kind: int, state: int, counting: int, waiting: tuple[AlarmRequest, ...]
    ) -> bool:
        """The same of one kind of alarm in one state, with a condition that has this result."""
        table, then = self._by_kind[kind], AlarmState(state)
        for each in waiting:
            before, then = then, table.get((then, each.operation), then)
            if before in PUT_AWAY and then not in PUT_AWAY:
                then = table.get((then, Operation(counting)), then)
        return (then, operation) in table

    def state_of(self, row: int) -> AlarmState:
        return AlarmState(int(self.states[row]))

    def request(self, rows: Sequence[int], request: AlarmRequest) -> None:
        """Carry it out with each of these alarms at the next looks, in the order asked. Of what puts an alarm away, or
        brings it back, the last one counts."""
        joined = lru_cache(maxsize=None)(partial(_joined, request))  # many wait for the same
        waiting = map(self._requests.get, rows, repeat(()))
        self._requests.update(zip(rows, map(joined, waiting), strict=False))

    def _obey(self) -> None:
        for row in list(islice(self._requests, CHANGES_PER_PERIOD)):
            for each in self._requests.pop(row):
                self._carry_out(row, each)

    def _carry_out(self, row: int, request: AlarmRequest) -> None:
        operation = request.operation
        if (self.state_of(row), operation) not in self._tables[row]:
            return  # it has changed since
        self._until[row] = self._now() + request.seconds if operation is Operation.SHELVE else NEVER
        put_away = self.state_of(row) in PUT_AWAY
        self._step(row, operation, request.who, request.words)
        if put_away and self.state_of(row) not in PUT_AWAY:
            self._step(row, Operation(int(self._counting[row])))

    # States --------------------------------------------------------------------------------------------

    def _step(self, row: int, operation: Operation, who: str = "", words: str = "") -> None:
        """The next state, which is told."""
        before = self.state_of(row)
        state = self._tables[row].get((before, operation))
        if state is None or (state is before and operation is not Operation.SHELVE):
            return
        self.states[row] = state
        if operation is Operation.CANNOT_EVALUATE:
            words = f"cannot be evaluated: {self._conditions.causes.get(row, '')}"
        self._words[row] = words
        self._telling.change(row, self._text(row), who, self._now())

    def _text(self, row: int) -> str:
        return told_text(self.state_of(row), self.declared[row], self._words[row])


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
    """The text of an event: `unacknowledged (high): the tank is too full`, then more words."""
    alarm = declared.alarm
    return f"{state} ({alarm.priority}): {alarm.text}" + (f"; {words}" if words else "")
