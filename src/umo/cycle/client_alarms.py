"""The commands of clients for alarms: to acknowledge, reset, shelve them, and to put them out of service."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from umo.cycle.client_commands import ClientCommand
from umo.errors import CommandRefused, PathError, RangeError
from umo.objects.paths import is_pattern
from umo.presentation.durations import duration
from umo.text import some
from umo.wiring.patterns import places_below

if TYPE_CHECKING:
    from umo.alarms import AlarmEngine

ALARM_COMMANDS: Mapping[str, tuple[str, str]] = {
    "acknowledge alarm": ("ACKNOWLEDGE", "acknowledged"),
    "reset alarm": ("RESET", "reset"),
    "shelve": ("SHELVE", "shelved"),
    "unshelve": ("UNSHELVE", "unshelved"),
    "remove from service": ("REMOVE", "out of service"),
    "return to service": ("RETURN", "returned to service"),
}
"""The name of the `Operation` of each command, and the word for what it has done."""


def operate(alarms: AlarmEngine | None, command: ClientCommand) -> str:
    """Carry out a command for the alarms at its path: one alarm, those of an object or compound, or of a pattern; "":
    all. Returns what it did. CommandRefused if the machine has no alarms, or one that is named by its own path is in no
    state for it; PathError if there is none; RangeError for a wrong time of a shelf."""
    if alarms is None:
        raise CommandRefused("the machine has no alarms")
    from umo.alarms import Operation
    from umo.alarms.engine import AlarmRequest

    name, done = ALARM_COMMANDS[command.do]
    operation = Operation[name]
    seconds = _shelf(command.value) if operation is Operation.SHELVE else 0.0
    words = f"for {duration(seconds)}" if seconds else ""
    rows = named(alarms, command.path)
    able = alarms.able(rows, operation)
    if not able and command.path in alarms.paths:
        raise CommandRefused(f"{command.path} is {alarms.state_of(rows[0])}: it cannot be {done}")
    alarms.request(able, AlarmRequest(operation, command.who, seconds, words))
    return f"{done}: {some([alarms.paths[row] for row in able])}" if able else f"no alarm there can be {done}"


def named(alarms: AlarmEngine, path: str) -> Sequence[int]:
    """The numbers of the alarms that a path or pattern names."""
    found: Sequence[int] = alarms.below.get(path, ())
    if not found and is_pattern(path):
        found = places_below(path, alarms.paths)
    if not found:
        raise PathError(f"no alarm {path!r}")
    return found


def _shelf(value: Any) -> float:
    """The time of a shelf in s."""
    from umo.alarms.engine import LONGEST_SHELF

    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= LONGEST_SHELF:
        raise RangeError(f"an alarm is shelved for a time of up to {LONGEST_SHELF:g} s (7 days), not {value!r}")
    return float(value)
