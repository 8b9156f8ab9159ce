"""Finds numbers of a machine whose declared unit is not the unit in which the machine uses them: as the setpoint or a
setting of a control law, as a written value, or in a comparison with a value that is read. umo never converts the plain
numbers of control code. Only errors that are certain are reported."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from math import isclose
from typing import Any

from umo.control import PID, Cascade, Hysteresis, Servo, VectorPID, VectorServo
from umo.errors import Mistake, UmoError
from umo.objects import Atomic, Compound, numbers_of
from umo.objects.numbers import MachineNumber
from umo.objects.units import convert, is_quotient, same_unit
from umo.text import some
from umo_command.check.code_states import CodeObjects
from umo_command.check.code_values import ModuleCode, NameScope, Remarks

LAWS = (Servo, Cascade, VectorServo)
"""The laws that take a setpoint in the unit of their sensors."""


def wrong_settings(machine: Compound, place: str) -> list[Mistake]:
    """Return the errors in the units of the numbers that set a control law. `place`: where they are declared."""
    return [
        Mistake(place, path, f"{text}, not {number.declared.unit}")
        for path, number in numbers_of(machine).items()
        if number.declared.unit and (text := _other_unit(number))
    ]


def _other_unit(number: MachineNumber) -> str:
    """Return the unit in which a law uses a number; "" if this is the declared one, or unknown."""
    law, name, unit = number.owner, number.name, number.declared.unit
    if not isinstance(law, PID | VectorPID | Hysteresis):
        return ""
    measured, output = _units_of(law)
    if name == "gain":
        is_other = measured and output and is_quotient(unit, output, measured) is False
        return f"the gain of this law is in {output} for each {measured} of its measurement" if is_other else ""
    is_output = name in (("low", "high") if isinstance(law, Cascade) else ("friction", "limit"))
    taken = output if is_output else law.numbers[name].unit if name in law.numbers else ""
    return f"the law uses this number in {taken}" if taken and _differ(unit, taken) else ""


def _units_of(law: Any) -> tuple[str, str]:
    """Return the units of the measurement and of the output of a law; "" for those that it does not have."""
    if isinstance(law, Servo):
        return law.sensor.units, law.actuator.units
    if isinstance(law, Cascade):
        return law.sensor.units, law.inner.sensor.units
    if isinstance(law, VectorServo):
        return law.sensors[0].units, law.actuators[0].units
    return (law.sensor.units, "") if isinstance(law, Hysteresis) else ("", "")


def _differ(one: str, other: str) -> bool:
    """Return True if a number means different things in two units."""
    if same_unit(one, other):
        return False
    try:
        return not all(isclose(convert(number, one, other), number) for number in (1.0, 2.0))
    except UmoError:  # of another dimension
        return True


class CodeUnits:
    """The units of the expressions of one module."""

    def __init__(self, code: ModuleCode, objects: CodeObjects, declared: Mapping[tuple[int, str], str]) -> None:
        """`declared`: the units of the machine's numbers, by the id of their owner and their name."""
        self._code, self._objects, self._declared = code, objects, declared

    def called(self, node: ast.Call, scope: NameScope) -> Remarks:
        """Check the setpoint that a law is called with, and the value that is written to an object."""
        if not isinstance(node.func, ast.Attribute) or node.func.attr not in ("control", "write"):
            return
        name = "setpoint" if node.func.attr == "control" else "value"
        taken = list(self._taken(self._objects.objects(node.func.value, scope), node.func.attr))
        for given in [*node.args[:1], *(each.value for each in node.keywords if each.arg == name)]:
            if units := _pair(self.of(given, scope), taken):
                yield given, f"`{{}}` is in {units[0]}, but `{ast.unparse(node.func)}` takes a number in {units[1]}"

    def compared(self, node: ast.Compare, scope: NameScope) -> Remarks:
        """Check comparisons."""
        for one, other in zip([node.left, *node.comparators], node.comparators, strict=False):
            if units := _pair(self.of(one, scope), self.of(other, scope)):
                yield one, f"`{{}}` is in {units[0]}, but is compared with a number in {units[1]}"

    def of(self, node: ast.expr, scope: NameScope) -> list[str]:
        """Return the units that an expression may have; none if they are not certain."""
        if isinstance(node, ast.Attribute):
            found = [self._declared.get((id(each), node.attr), "") for each in self._objects.objects(node.value, scope)]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "read":
            items = self._objects.objects(node.func.value, scope)
            found = list(map(_unit_of, items))
        else:
            found = []
        return found if all(found) else []

    def _taken(self, items: list[Any], function: str) -> Iterator[str]:
        """Yield the units in which objects or laws take a number; "" if that is not known."""
        for each in items:
            if function == "write":
                yield _unit_of(each)
            else:
                is_known = isinstance(each, LAWS) and type(each).control in [law.control for law in LAWS]
                yield _units_of(each)[0] if is_known else ""


def _unit_of(item: object) -> str:
    """Return the unit of an actuator or a sensor; "" for any other object."""
    return str(getattr(item, "units", "")) if isinstance(item, Atomic) else ""


def _pair(ones: list[str], others: list[str]) -> tuple[str, str] | None:
    """Return the units of two numbers as text if they certainly differ. There may be several of each, if several
    objects use the same code; "" stands for an unknown one."""
    if not ones or not others or not all(others):
        return None
    if not all(_differ(one, other) for one in set(ones) for other in set(others)):
        return None
    return some(sorted(set(ones))), some(sorted(set(others)))


def declared_units(machine: Compound) -> dict[tuple[int, str], str]:
    """Return the units of the numbers that a machine declares, by the id of their owner and their name. Numbers that
    are only shown are left out: a law shows a difference in the unit of its sensor."""
    numbers = numbers_of(machine).values()
    return {(id(each.owner), each.name): each.declared.unit for each in numbers if each.settable}
