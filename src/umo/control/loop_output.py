"""The output of a loop: an actuator, or the setpoint of the inner law of a cascade."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

from umo.objects import Compound, DigitalActuator, Node
from umo.objects.laws import laws_of


class ActuatorOutput:
    """The output of a loop that is an actuator."""

    def __init__(self, actuator: DigitalActuator) -> None:
        self._actuator = actuator
        self.path, self.units = actuator.path, actuator.units
        self.range = actuator.minimum, actuator.maximum
        self.limited = False

    @property
    def told(self) -> dict[str, Any]:
        """The description of the output: its range and, for a setpoint, the inner law and its sensor."""
        return told_range(self.range)

    def bounds(self, limit: float) -> tuple[float, float]:
        """Return the range of the output, limited to this distance from the default."""
        (low, high), default = self.range, self._actuator.default
        return max(low, default - limit), min(high, default + limit)

    @property
    def inhibited(self) -> str | None:
        """The reason why the actuator is inhibited, or None."""
        reason = self._actuator.inhibited
        return None if reason is None else f"{self.path} is inhibited: {reason}"

    @property
    def commanded(self) -> float:
        """The last commanded value."""
        return float(self._actuator.pending)

    def write(self, value: float) -> None:
        self._actuator.write(value)


class SetpointOutput:
    """The output of a loop that is the setpoint of an inner law, within the limits of the outer law
    (`umo.control.cascade`)."""

    def __init__(self, part: Compound, outer: Any) -> None:
        self._inner = inner = outer.inner
        self._law = next((path for path, each in _laws_around(part) if each is inner), "")
        self.path = f"{self._law}.setpoint" if self._law else ""
        self.units: str = inner.sensor.units
        self.range: tuple[float, float] = outer.low, outer.high

    @property
    def told(self) -> dict[str, Any]:
        return {**told_range(self.range), "inner": self._law, "inner_sensor": self._inner.sensor.path}

    def bounds(self, limit: float) -> tuple[float, float]:
        return self.range

    @property
    def inhibited(self) -> str | None:
        if "step" in vars(self._inner):
            return f"the inner law of {self.path} is in an experiment"
        return ActuatorOutput(self._inner.actuator).inhibited

    @property
    def limited(self) -> bool:
        """True if the inner law was limited in its last step, so that it does not follow its setpoint."""
        return bool(self._inner.limited)

    @property
    def commanded(self) -> float:
        return float(self._inner.setpoint)

    def write(self, value: float) -> None:
        """Store the setpoint. Only the next `control` of the outer law passes it on."""


LoopOutput = ActuatorOutput | SetpointOutput


def output_of(part: Compound, law: Any, end: Any) -> LoopOutput | None:
    """Return the output of a law of this part. `end`: the actuator or the inner law of the law; None if it is not
    known."""
    if isinstance(end, DigitalActuator):
        return ActuatorOutput(end)
    return None if end is None else SetpointOutput(part, law)


def outer_laws(part: Compound, law: Any) -> list[Any]:
    """Return the laws of the machine whose output is the setpoint of the given law, which belongs to this part."""
    outer = (each for _, each in _laws_around(part) if getattr(each, "inner", None) is law)
    return list({id(each): each for each in outer}.values())


def _laws_around(part: Compound) -> Iterator[tuple[str, Any]]:
    """Return the laws with loops that the machine had when it was connected. Then return all laws that this part and
    the compounds around it have now. Each law comes with its path."""
    yield from ((path, law) for _, path, law in part._machine.laws)
    node: Node | None = part
    while node is not None:
        if isinstance(node, Compound):
            yield from ((f"{node._path}.{name}".lstrip("."), law) for name, law in laws_of(node))
        node = node._parent


def told_range(range_: tuple[float, float]) -> dict[str, float | None]:
    """Return a range as plain data; None for an infinite bound."""
    return {name: each if isfinite(each) else None for name, each in zip(("low", "high"), range_, strict=True)}
