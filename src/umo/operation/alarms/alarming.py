"""The alarms of a connected machine, as a capability, including the alarms of the machine itself and the commands of
clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from umo.cycle.capability import Capability
from umo.cycle.equipment import equipment_in
from umo.cycle.events import ALARM, Event
from umo.cycle.inhibition import Inhibition, owned_interlocks
from umo.cycle.machine import ConnectedMachine
from umo.duration import duration
from umo.errors import CommandRefused, PathError, UmoError
from umo.objects import Compound
from umo.objects.paths import is_pattern
from umo.objects.presentation.rows import ANY
from umo.operation.alarms.alarm_log import AlarmLog
from umo.operation.alarms.alarm_states import Operation
from umo.operation.alarms.collecting import DeclaredAlarm, FunctionCondition, InFault, alarms_of, joined, own_alarm
from umo.operation.alarms.conditions import FREE_PER_PERIOD, turns_of
from umo.operation.alarms.declaration import Priority
from umo.operation.alarms.engine import AlarmEngine, AlarmRequest
from umo.text import some
from umo.wiring.patterns import places_below

ALARMS = "alarms"
"""The name of the alarm states that are kept from one run to the next, by path (`ConnectedMachine.states`)."""
DONE: Mapping[Operation, str] = {
    Operation.ACKNOWLEDGE: "acknowledged",
    Operation.RESET: "reset",
    Operation.SHELVE: "shelved",
    Operation.UNSHELVE: "unshelved",
    Operation.REMOVE: "out of service",
    Operation.RETURN: "returned to service",
}
"""The word for the result of each operation of a client."""


def declared_alarms(root: Compound) -> list[DeclaredAlarm]:
    """Return all alarms of a machine, in the order of frames. The result is empty if no class of the machine has the
    keyword `alarms`. Raises DeclarationError for an invalid declaration."""
    return alarms_of(root, partial(_own_alarms, root))


def alarm_log(root: Compound) -> AlarmLog | None:
    """Return an observer that records when the alarms of a machine are active, or None if it has no alarms."""
    declared = declared_alarms(root)
    return AlarmLog([each.describe() for each in declared]) if declared else None


class AttachedAlarms(Capability):
    """The alarms of one machine."""

    engine: AlarmEngine

    def __init__(self, declared: Sequence[DeclaredAlarm]) -> None:
        self._declared = declared
        self.alarm_rows = len(declared)

    def attach(self, machine: ConnectedMachine) -> None:
        equipment, declared, clock, events = machine.equipment.all, self._declared, machine.clock, machine.events
        in_fault = {each.path: equipment[each.test.number] for each in declared if isinstance(each.test, InFault)}
        for each in declared:
            if isinstance(call := getattr(each.test, "call", None), Latched):
                call.inhibitions = machine.claims.inhibitions

        def tell(path: str, text: str, who: str) -> None:
            if path in in_fault and (reason := in_fault[path].fault):
                text = f"{text}; {reason}"
            events.add(Event(clock.now, path, text, who, asked=ALARM))

        self.engine = AlarmEngine(declared, machine.image, lambda: clock.now, tell)
        self.engine.restore(machine.states.get(ALARMS, {}))
        machine.phases.showing.append(self.engine.look)


def attached(root: Compound) -> AttachedAlarms | None:
    """Return the capability of a machine, or None if it declares no alarm."""
    declared = declared_alarms(root)
    return AttachedAlarms(declared) if declared else None


def engine_of(machine: ConnectedMachine) -> AlarmEngine | None:
    """Return the alarms of a connected machine, or None."""
    found = machine.find(AttachedAlarms)
    return None if found is None else found.engine


def turn_text(declared: Sequence[DeclaredAlarm], period: float | None) -> str:
    """Return a sentence that says that the functions among the conditions are called in turn, with the time of one
    turn; "" if each function is called in every period. `period` is in s."""
    count = sum(isinstance(each.test, FunctionCondition) for each in declared)
    if (turns := turns_of(count)) == 1:
        return ""
    time = f" ({duration(turns * period)})" if period else ""
    return (
        f"alarms: {count} functions are called in turn, {FREE_PER_PERIOD} in each period, so each is called every "
        f"{turns} periods{time}"
    )


class Latched:
    """The condition that the interlock with a given number inhibits its actuators."""

    def __init__(self, number: int) -> None:
        self._number = number
        self.inhibitions: Sequence[Inhibition] = ()
        """The interlocks of the connected machine."""

    def __call__(self) -> bool:
        """Return True if the interlock inhibits. Raises UmoError while its condition cannot be evaluated."""
        if self._number >= len(self.inhibitions):
            return False
        inhibition = self.inhibitions[self._number]
        if cause := inhibition.cause:
            raise UmoError(cause)
        return inhibition.reason is not None


def _own_alarms(root: Compound) -> list[DeclaredAlarm]:
    """Return the alarms for equipment in fault and for latched interlocks that inhibit."""
    found = []
    for number, compound in enumerate(equipment_in(root)):
        alarm = own_alarm(f"{compound._path} is in fault", Priority.HIGH)
        found.append(DeclaredAlarm(joined(compound._path, "fault"), alarm, InFault(number)))
    counts: dict[str, int] = {}
    for number, (owner, interlock) in enumerate(owned_interlocks(root)):
        if interlock.latched:
            place = counts[owner._path] = counts.get(owner._path, -1) + 1
            path = joined(owner._path, f"interlock.{place}")
            found.append(
                DeclaredAlarm(path, own_alarm(interlock.reason, Priority.MEDIUM), FunctionCondition(Latched(number)))
            )
    return found


def operate(alarms: AlarmEngine | None, operation: Operation, path: str, who: str, seconds: float = 0.0) -> str:
    """Carry out an operation of a client for the alarms at a path: the path of an alarm, of an object or compound, or a
    pattern; "" means all alarms. `seconds`: the shelving time, up to `LONGEST_SHELF`. Returns the result of the
    operation as text. Raises CommandRefused if the machine has no alarms, or if the path names a single alarm whose
    state does not permit the operation; an acknowledgement without effect is no error. Raises PathError if the path
    names no alarm."""
    if alarms is None:
        raise CommandRefused("the machine has no alarms")
    done, words = DONE[operation], f"for {duration(seconds)}" if seconds else ""
    told = f"{done} {words}, or until the run ends" if seconds else done
    rows = named(alarms, path)
    able = alarms.able(rows, operation)
    if not able and operation is Operation.ACKNOWLEDGE:
        return "nothing to acknowledge"
    if not able and path in alarms.paths:
        raise CommandRefused(f"{path} is {alarms.state_of(rows[0])}: it cannot be {done}")
    alarms.request(able, AlarmRequest(operation, who, seconds, words))
    return f"{told}: {some([alarms.paths[row] for row in able])}" if able else f"none of these alarms can be {done}"


def named(alarms: AlarmEngine, path: str) -> Sequence[int]:
    """Return the numbers of the alarms that a path or pattern names."""
    found: Sequence[int] = alarms.below.get(path, ())
    if not found and is_pattern(path):
        found = places_below(path, alarms.paths)
    if not found:
        raise PathError(f"there is no alarm {path!r}{f'; {ANY} stands for one part of a path' if ANY in path else ''}")
    return found
