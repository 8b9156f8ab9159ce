"""The alarms of a running station as an operator sees them, from a frame and the kept events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Any, NamedTuple

from umo.cycle.events import ALARM, Event
from umo.operation.alarms import AlarmState, Priority
from umo.operation.alarms.alarm_states import ACTIVE, ANNUNCIATED, SHELVED_STATES, TO_BE_ACKNOWLEDGED, operations
from umo.operation.alarms.alarm_times import AlarmTimes
from umo.operation.commands.verb import Names
from umo.operation.commands.verbs import naming

MAX_TOLD = 3
"""The largest number of alarms that are named in a line."""


class AlarmRow(NamedTuple):
    """One alarm that is not normal, or that was raised."""

    path: str
    state: AlarmState
    priority: Priority
    text: str
    since: float | None
    """The time in s on the cycle's clock at which the alarm last became active. If the alarm is normal, shelved and not
    active, or out of service: at which it entered this state. None if this is unknown."""
    who: str
    """The client that caused this state; "" means the machine itself."""
    note: str
    """Further text, such as the reason why the condition cannot be evaluated."""
    raised: int = 0
    """Number of times that the alarm has become active in this run; 0 if this is unknown."""
    first: float | None = None
    last: float | None = None
    """The times in s on the cycle's clock at which the alarm first (`first`) and last became active in this run."""
    until: float | None = None
    """The time in s on the cycle's clock at which the shelving of the alarm ends; None if it is not shelved, or if this
    is unknown."""

    @property
    def annunciated(self) -> bool:
        """True if an operator should see the alarm: that is, if it is neither shelved nor out of service."""
        return self.state in ANNUNCIATED

    @property
    def active(self) -> bool:
        """True if the alarm is active, shelved or not."""
        return self.state in ACTIVE

    @property
    def asks(self) -> bool:
        """True if the alarm must be acknowledged."""
        return self.state in TO_BE_ACKNOWLEDGED

    @property
    def verbs(self) -> list[str]:
        """The names of the verbs that have an effect on the alarm in its present state."""
        able = operations(self.state)
        return [each.name for each in naming(Names.ALARM) if each.operation is None or each.operation in able]

    def __str__(self) -> str:
        return f"{self.path}: {self.text} ({self.priority}, {self.state})"


def alarm_rows(
    entries: Sequence[Mapping[str, Any]],
    states: Iterable[int],
    events: Iterable[Event],
    times: Iterable[AlarmTimes],
    raised: bool = False,
    every: bool = False,
) -> list[AlarmRow]:
    """Return the alarms that are not normal; with `raised` also the alarms that were raised in this run, with `every`
    all alarms. Unacknowledged alarms come first, then the order is by priority, the newest first; normal alarms come
    last."""
    changes = [event for event in events if event.asked == ALARM]
    last = {event.path: event for event in changes}
    begun = {event.path: event.time for event in changes if not event.who and event.text.startswith(_ACTIVE)}
    numbered = zip(entries, states, times, strict=True)
    rows = [
        _with_times(_row(entry, AlarmState(n), last.get(entry["path"])), when, begun.get(entry["path"]))
        for entry, n, when in numbered
        if every or n in _NOT_NORMAL or (raised and when.raised > 0)
    ]
    return sorted(rows, key=_order)


def alarms_text(rows: Sequence[AlarmRow]) -> list[str]:
    """Return a text with the first few alarms, and the number of the others."""
    shown = [row for row in rows if row.annunciated]
    more = len(shown) - MAX_TOLD
    return [*map(str, shown[:MAX_TOLD]), *([f"and {more} more"] if more > 0 else [])]


_NOT_NORMAL = frozenset(AlarmState) - {AlarmState.NORMAL}
_ACTIVE = tuple(f"{state} (" for state in ACTIVE)
"""The beginnings of the texts of events that say that an alarm is active."""
_PRIORITIES = {str(priority): priority for priority in Priority}


def _row(entry: Mapping[str, Any], state: AlarmState, event: Event | None) -> AlarmRow:
    text = str(entry.get("text", ""))
    priority = _PRIORITIES.get(str(entry.get("priority")), Priority.MEDIUM)
    head = f"{state} ({priority}): {text}"
    if event is None or not event.text.startswith(f"{state} ("):
        return AlarmRow(entry["path"], state, priority, text, None, "", "")
    note = event.text.removeprefix(head).removeprefix("; ") if event.text.startswith(head) else ""
    return AlarmRow(entry["path"], state, priority, text, event.time, event.who, note)


def _with_times(row: AlarmRow, times: AlarmTimes, begun: float | None) -> AlarmRow:
    """Return a row with the times at which the alarm became active: those of the run if they are known, otherwise that
    of the last event that says so. The end of a shelving replaces the note, which has its duration."""
    if 0 < times.raised < inf:
        begun = times.last
        row = row._replace(raised=int(times.raised), first=times.first, last=times.last)
    if row.state in SHELVED_STATES and 0 < times.shelved_until < inf:
        row = row._replace(until=times.shelved_until, note="")
    return row._replace(since=begun) if row.annunciated or row.active else row


def _order(row: AlarmRow) -> tuple[Any, ...]:
    return row.state not in _NOT_NORMAL, not row.asks, not row.annunciated, -row.priority, -(row.since or 0.0), row.path
