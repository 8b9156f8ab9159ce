"""Alarms in the cycle: those that the machine itself brings, the engine of a connected machine, commands of clients.

`umo.alarms` is imported only for a machine that declares some.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from umo.cycle.client_commands import ClientCommand
from umo.cycle.events import ALARM, Event
from umo.cycle.image import Image
from umo.cycle.inhibition import Inhibition, owned_interlocks
from umo.errors import CommandRefused, PathError, RangeError, UmoError
from umo.objects import Compound, walk
from umo.objects.paths import is_pattern
from umo.presentation.durations import duration
from umo.text import some
from umo.wiring.patterns import places_below

if TYPE_CHECKING:
    from umo.alarms import AlarmEngine, DeclaredAlarm
    from umo.alarms.alarm_log import AlarmLog
    from umo.cycle.command_stage import CommandStage
    from umo.cycle.equipment import Equipment

ALARM_COMMANDS: Mapping[str, tuple[str, str]] = {
    "acknowledge alarm": ("ACKNOWLEDGE", "acknowledged"),
    "reset alarm": ("RESET", "reset"),
    "shelve": ("SHELVE", "shelved"),
    "unshelve": ("UNSHELVE", "unshelved"),
    "remove from service": ("REMOVE", "out of service"),
    "return to service": ("RETURN", "returned to service"),
}
"""The name of the `Operation` of each command, and the word for what it has done."""


def declared_alarms(root: Compound) -> list[DeclaredAlarm]:
    """Every alarm of a machine, in the order of frames: none if no class of it has the keyword `alarms`.
    DeclarationError for a declaration that fits nothing."""
    compounds = (node for node in (root, *walk(root)) if isinstance(node, Compound))
    if not any(node._settings.alarms for node in compounds):
        return []
    from umo.alarms import alarms_of

    return alarms_of(root, partial(_own_alarms, root))


def alarm_log(root: Compound) -> AlarmLog | None:
    """An observer that keeps when the alarms of a machine are active; None: it has none."""
    if not (declared := declared_alarms(root)):
        return None
    from umo.alarms.alarm_log import AlarmLog

    return AlarmLog([each.describe() for each in declared])


def engine_of(
    declared: Sequence[DeclaredAlarm], image: Image, commands: CommandStage, equipment: Sequence[Equipment]
) -> AlarmEngine | None:
    """The alarms of a connected machine; None: it has none."""
    if not declared:
        return None
    from umo.alarms import AlarmEngine
    from umo.alarms.collecting import InFault

    in_fault = {each.path: equipment[each.test.number] for each in declared if isinstance(each.test, InFault)}
    for each in declared:
        if isinstance(call := getattr(each.test, "call", None), Latched):
            call.inhibitions = commands.inhibitions

    def tell(path: str, text: str, who: str) -> None:
        if path in in_fault and (reason := in_fault[path].fault):
            text = f"{text}; {reason}"
        commands.events.add(Event(image.clock.now, path, text, who, asked=ALARM))

    return AlarmEngine(declared, image, lambda: image.clock.now, tell)


def turn_text(declared: Sequence[DeclaredAlarm], period: float | None) -> str:
    """The sentence that the functions among the conditions take turns, and how long that takes; "": each is called in
    every period. `period` in s."""
    from umo.alarms.collecting import Free
    from umo.alarms.conditions import FREE_PER_PERIOD, turns_of

    count = sum(isinstance(each.test, Free) for each in declared)
    if (turns := turns_of(count)) == 1:
        return ""
    time = f" ({duration(turns * period)})" if period else ""
    return (
        f"alarms: {count} functions take turns, {FREE_PER_PERIOD} a period: each is called every {turns} periods{time}"
    )


class Latched:
    """The condition that an interlock, by its number, inhibits its actuators."""

    def __init__(self, number: int) -> None:
        self._number = number
        self.inhibitions: Sequence[Inhibition] = ()
        """The interlocks of the connected machine."""

    def __call__(self) -> bool:
        """Whether it inhibits; UmoError while its condition cannot be evaluated."""
        if self._number >= len(self.inhibitions):
            return False
        inhibition = self.inhibitions[self._number]
        if cause := inhibition.cause:
            raise UmoError(cause)
        return inhibition.reason is not None


def _own_alarms(root: Compound) -> list[DeclaredAlarm]:
    """Of equipment in fault, and of latched interlocks that inhibit."""
    from umo.alarms import DeclaredAlarm, Priority
    from umo.alarms.collecting import Free, InFault, joined, own_alarm
    from umo.cycle.equipment import equipment_in

    found = []
    for number, compound in enumerate(equipment_in(root)):
        alarm = own_alarm(f"{compound._path} is in fault", Priority.HIGH)
        found.append(DeclaredAlarm(joined(compound._path, "fault"), alarm, InFault(number)))
    counts: dict[str, int] = {}
    for number, (owner, interlock) in enumerate(owned_interlocks(root)):
        if interlock.latched:
            place = counts[owner._path] = counts.get(owner._path, -1) + 1
            path = joined(owner._path, f"interlock.{place}")
            found.append(DeclaredAlarm(path, own_alarm(interlock.reason, Priority.MEDIUM), Free(Latched(number))))
    return found


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
