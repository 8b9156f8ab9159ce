"""The state of an alarm (ISA-18.2, figure 3), as a table.

In addition to the states of the standard there are two states for a condition that cannot be evaluated. Such a
condition counts as true, like the condition of an interlock. A shelved alarm has two states, so that the history of its
condition is recorded. "Suppressed by design" is not a state here, because a condition can contain the suppression.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from functools import cache

from umo.text import NamedNumber


class AlarmState(NamedNumber):
    """The state of an alarm. The numbers are stored in frames."""

    NORMAL = 0
    UNACKNOWLEDGED = 1
    """The alarm is active, and nobody has acknowledged it."""
    ACKNOWLEDGED = 2
    """The alarm is active and acknowledged."""
    RETURNED = 3
    """The alarm is no longer active, and nobody has acknowledged it (RTN unacknowledged)."""
    LATCHED_UNACKNOWLEDGED = 4
    """The alarm is no longer active; it stays until it is acknowledged and reset."""
    LATCHED_ACKNOWLEDGED = 5
    """The alarm is no longer active, and it is acknowledged; it stays until it is reset."""
    SHELVED = 6
    """An operator has shelved the alarm for a time, and it is not active."""
    OUT_OF_SERVICE = 7
    """The alarm is removed from service for maintenance, until it is returned to service."""
    BAD_UNACKNOWLEDGED = 8
    """The condition of the alarm cannot be evaluated, and nobody has acknowledged this."""
    BAD_ACKNOWLEDGED = 9
    """The condition of the alarm cannot be evaluated, and this is acknowledged."""
    SHELVED_ACTIVE = 10
    """The alarm is shelved, and it is active or cannot be evaluated."""


class Operation(IntEnum):
    """The causes of a change: the first three come from the alarm's condition, the others come from a client or the end
    of a time."""

    INACTIVE = 0
    ACTIVE = 1
    CANNOT_EVALUATE = 2
    ACKNOWLEDGE = 3
    RESET = 4
    SHELVE = 5
    UNSHELVE = 6
    REMOVE = 7
    """The alarm is removed from service."""
    RETURN = 8
    """The alarm is returned to service."""


_S, _O = AlarmState, Operation
TO_BE_ACKNOWLEDGED = frozenset((_S.UNACKNOWLEDGED, _S.RETURNED, _S.LATCHED_UNACKNOWLEDGED, _S.BAD_UNACKNOWLEDGED))
"""The states that an acknowledgement changes."""
BAD_STATES = frozenset((_S.BAD_UNACKNOWLEDGED, _S.BAD_ACKNOWLEDGED))
"""The states of an alarm whose condition cannot be evaluated."""
ACTIVE = BAD_STATES | {_S.UNACKNOWLEDGED, _S.ACKNOWLEDGED, _S.SHELVED_ACTIVE}
"""The states of an active alarm, shown or shelved."""
SHELVED_STATES = frozenset((_S.SHELVED, _S.SHELVED_ACTIVE))
PUT_AWAY = SHELVED_STATES | {_S.OUT_OF_SERVICE}
PUTTING_AWAY = frozenset((_O.SHELVE, _O.UNSHELVE, _O.REMOVE, _O.RETURN))
"""The operations that shelve alarms, remove them from service, or end either."""
ANNUNCIATED = frozenset(AlarmState) - PUT_AWAY - {_S.NORMAL}
"""The states of alarms that are shown to an operator."""

_PLAIN: Mapping[tuple[AlarmState, Operation], AlarmState] = {
    (_S.NORMAL, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.UNACKNOWLEDGED, _O.INACTIVE): _S.RETURNED,
    (_S.UNACKNOWLEDGED, _O.ACKNOWLEDGE): _S.ACKNOWLEDGED,
    (_S.ACKNOWLEDGED, _O.INACTIVE): _S.NORMAL,
    (_S.RETURNED, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.RETURNED, _O.ACKNOWLEDGE): _S.NORMAL,
    (_S.LATCHED_UNACKNOWLEDGED, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.LATCHED_UNACKNOWLEDGED, _O.ACKNOWLEDGE): _S.LATCHED_ACKNOWLEDGED,
    (_S.LATCHED_ACKNOWLEDGED, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.LATCHED_ACKNOWLEDGED, _O.RESET): _S.NORMAL,
    (_S.BAD_UNACKNOWLEDGED, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.BAD_UNACKNOWLEDGED, _O.INACTIVE): _S.RETURNED,
    (_S.BAD_UNACKNOWLEDGED, _O.ACKNOWLEDGE): _S.BAD_ACKNOWLEDGED,
    (_S.BAD_ACKNOWLEDGED, _O.ACTIVE): _S.UNACKNOWLEDGED,
    (_S.BAD_ACKNOWLEDGED, _O.INACTIVE): _S.NORMAL,
    (_S.SHELVED, _O.ACTIVE): _S.SHELVED_ACTIVE,
    (_S.SHELVED, _O.CANNOT_EVALUATE): _S.SHELVED_ACTIVE,
    (_S.SHELVED_ACTIVE, _O.INACTIVE): _S.SHELVED,
    (_S.SHELVED, _O.UNSHELVE): _S.NORMAL,
    (_S.SHELVED_ACTIVE, _O.UNSHELVE): _S.NORMAL,
    (_S.OUT_OF_SERVICE, _O.RETURN): _S.NORMAL,
    **{(state, _O.CANNOT_EVALUATE): _S.BAD_UNACKNOWLEDGED for state in _S if state not in PUT_AWAY},
    (_S.BAD_ACKNOWLEDGED, _O.CANNOT_EVALUATE): _S.BAD_ACKNOWLEDGED,
    **{(state, _O.SHELVE): _S.SHELVED for state in _S if state is not _S.OUT_OF_SERVICE},
    **{(state, _O.SHELVE): _S.SHELVED_ACTIVE for state in ACTIVE},
    **{(state, _O.REMOVE): _S.OUT_OF_SERVICE for state in _S},
}
_LATCHED = {_S.RETURNED: _S.LATCHED_UNACKNOWLEDGED, _S.NORMAL: _S.LATCHED_ACKNOWLEDGED}
"""The states that a latched alarm is in when it is no longer active, by those of others."""
_UNASKED = {
    _S.UNACKNOWLEDGED: _S.ACKNOWLEDGED,
    _S.RETURNED: _S.NORMAL,
    _S.LATCHED_UNACKNOWLEDGED: _S.LATCHED_ACKNOWLEDGED,
    _S.BAD_UNACKNOWLEDGED: _S.BAD_ACKNOWLEDGED,
}
"""The states of an alarm that needs no acknowledgement, by those of others."""


def operations(state: AlarmState) -> frozenset[Operation]:
    """Return the operations of a client that lead an alarm from this state to another one."""
    found = {operation for (at, operation), to in _PLAIN.items() if at is state and to is not state}
    return frozenset(each for each in found if each > Operation.CANNOT_EVALUATE)


@cache
def transitions(latch: bool, acknowledge: bool) -> Mapping[tuple[AlarmState, Operation], AlarmState]:
    """Return the next state for each state and operation, for alarms with these options. A combination that is missing
    changes nothing."""
    table = dict(_PLAIN)
    if latch:
        table |= {at: _LATCHED.get(to, to) for at, to in table.items() if at[1] is _O.INACTIVE}
    else:
        table = {at: to for at, to in table.items() if at[0] not in _LATCHED.values()}
    if not acknowledge:
        table = {at: _UNASKED.get(to, to) for at, to in table.items() if at[0] not in _UNASKED}
    return table
