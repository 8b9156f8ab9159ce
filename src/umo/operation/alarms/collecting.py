"""The alarms of a machine: the alarms that its classes declare, and the alarms of the machine itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from umo.errors import DeclarationError, UmoError
from umo.objects.atomic import Atomic
from umo.objects.compound import Compound
from umo.objects.description import described
from umo.objects.node import Node
from umo.objects.paths import find, walk
from umo.objects.presentation.value_text import measure, span
from umo.objects.sensors import Sensor
from umo.operation.alarms.alarm_states import AlarmState
from umo.operation.alarms.declaration import MAX_TEXT, Alarm, Bad, High, In, Low, Priority
from umo.text import in_a_line
from umo.user_code import raise_as


@dataclass(frozen=True)
class Threshold:
    """The condition `sign * value > limit`. It ends when `sign * value` is no longer above `back`."""

    item: Atomic
    sign: float
    limit: float
    back: float


@dataclass(frozen=True)
class BadQuality:
    """The condition that the quality of an object is BAD."""

    item: Atomic


@dataclass(frozen=True)
class InFault:
    """The condition that the equipment with this number is in fault."""

    number: int


@dataclass(frozen=True)
class FunctionCondition:
    """The condition that a function of the user, called without arguments, returns True."""

    call: Callable[[], object]


Test = Threshold | BadQuality | InFault | FunctionCondition
KINDS = (Threshold, BadQuality, InFault, FunctionCondition)
"""The kinds of conditions, in the order of alarms in frames."""


@dataclass(frozen=True)
class DeclaredAlarm:
    """One alarm of a machine."""

    path: str
    alarm: Alarm
    test: Test

    def describe(self) -> dict[str, Any]:
        """Return the alarm as plain data."""
        alarm = self.alarm
        return {
            "path": self.path,
            "states": [str(state) for state in AlarmState],
            "text": alarm.text,
            "priority": str(alarm.priority),
            "latch": alarm.latch,
            "acknowledge": alarm.acknowledge,
        }


def has_alarms(root: Compound) -> bool:
    """Return True if a class of the machine has the keyword `alarms`."""
    return any(isinstance(node, Compound) and node._settings.alarms for node in (root, *walk(root)))


def alarms_of(root: Compound, more: Callable[[], list[DeclaredAlarm]] = list) -> list[DeclaredAlarm]:
    """Return all alarms of a machine in the order of frames; none if the machine declares no alarm. The result includes
    `more`, and alarms of the machine itself for sensors that may be marked BAD. Raises DeclarationError for an invalid
    declaration, and for two alarms with the same path."""
    if not has_alarms(root):
        return []
    compounds = (node for node in (root, *walk(root)) if isinstance(node, Compound))
    known = {node._path: node for node in walk(root)}
    declared = [each for node in compounds for each in _of(node, known)]
    marked = [node for node in walk(root) if isinstance(node, Sensor) and node._marks]
    found: dict[str, DeclaredAlarm] = {}
    for each in [*declared, *map(_of_marked, marked), *more()]:
        if each.path in found:
            raise DeclarationError(f"alarm {each.path}: there are two alarms with this path; give yours another name")
        found[each.path] = each
    return sorted(found.values(), key=lambda each: KINDS.index(type(each.test)))


def joined(path: str, name: str) -> str:
    """Return the path of the object with this name in a compound."""
    return f"{path}.{name}" if path else name


def own_alarm(text: str, priority: Priority) -> Alarm:
    """Return an alarm of the machine itself, with its condition. Line breaks in the text are removed."""
    return Alarm(lambda _: False, in_a_line(text)[:MAX_TEXT], priority=priority)


def _of_marked(sensor: Sensor) -> DeclaredAlarm:
    alarm = own_alarm(f"{sensor.path} cannot be read", Priority.MEDIUM)
    return DeclaredAlarm(f"{sensor.path}.bad", alarm, BadQuality(sensor))


def _of(node: Compound, known: Mapping[str, Node]) -> Iterator[DeclaredAlarm]:
    """The alarms that a compound declares; of names in several classes the first, that of the subclass."""
    where = node._path or type(node).__name__
    names: set[str] = set()
    for given in node._settings.alarms:
        with raise_as(DeclarationError, f"alarms of {where} failed"):
            declared = given(node) if callable(given) else given
        if not isinstance(declared, Mapping):
            raise DeclarationError(f"alarms of {where}: must be a mapping of names to Alarms, not {declared!r}")
        for name, alarm in declared.items():
            if not isinstance(name, str) or not name.strip() or "." in name or not name.isprintable():
                raise DeclarationError(f"alarms of {where}: {name!r} is not a name: a text in one line, without dots")
            if not isinstance(alarm, Alarm):
                raise DeclarationError(f"alarm {joined(where, name)}: {alarm!r} is not an Alarm")
            if name not in names:
                names.add(name)
                yield DeclaredAlarm(joined(node._path, name), alarm, _test(node, name, alarm.condition, known))


def _test(node: Compound, name: str, condition: Any, known: Mapping[str, Node]) -> Test:
    """The condition with its object. Raises DeclarationError if it does not fit that."""
    where = f"alarm {joined(node._path or type(node).__name__, name)}"
    if not isinstance(condition, High | Low | Bad | In):
        return FunctionCondition(partial(condition, node))
    try:
        item = known.get(joined(node._path, condition.of)) or find(node, condition.of)
    except UmoError as error:
        raise DeclarationError(f"{where}: {error}") from None
    if not isinstance(item, Atomic):
        raise DeclarationError(f"{where}: {condition.of} is a compound; name one of its objects")
    if isinstance(condition, Bad):
        return BadQuality(item)
    return _in(where, item, condition) if isinstance(condition, In) else _beyond(where, item, condition)


def _in(where: str, item: Atomic, condition: In) -> Threshold:
    if item._states is None:
        raise DeclarationError(f"{where}: {item.path} has no states; use High or Low")
    if not isinstance(condition.state, item._states):
        states = ", ".join(map(str, item._states))
        raise DeclarationError(
            f"{where}: {condition.state!r} is not a state of {item.path}, which has {item._states.__name__}: {states}"
        )
    if item._raws != (0, 1):
        raise DeclarationError(f"{where}: {item.path} has more than two states; give your own condition")
    sign = 1.0 if item._number(condition.state) else -1.0
    return Threshold(item, sign, 0.5 * sign, 0.5 * sign)


def _beyond(where: str, item: Atomic, condition: High | Low) -> Threshold:
    if item._has_states:
        raise DeclarationError(f"{where}: {item.path} has states and no numbers; use In")
    (low, high), unit = item.calibration[:2], described(item).unit
    sign = 1.0 if isinstance(condition, High) else -1.0
    back = condition.limit - sign * condition.deadband
    for what, value in (("limit", condition.limit), ("limit with its deadband", back)):
        if not low <= value <= high:
            shown = measure(value, unit)
            raise DeclarationError(
                f"{where}: the {what}, {shown}, is outside the range of {item.path}: {span(low, high)}"
            )
    return Threshold(item, sign, sign * condition.limit, sign * back)
