"""Interlocks: conditions that inhibit actuators."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from umo.errors import DeclarationError
from umo.objects.actuators import Actuator
from umo.objects.atomic import Atomic
from umo.objects.node import Node
from umo.objects.paths import atoms
from umo.objects.truth import is_one_of
from umo.text import cut_repr
from umo.user_code import check_acts_at_once


@dataclass(frozen=True, eq=False)
class Interlock:
    """While `condition()` is true, the actuators in `forbids` are inhibited: they are reset immediately, in stop order,
    and stay at their defaults. `write` returns False, and `inhibited` is the reason. After the condition has become
    false, the next write takes effect.

        class Lathe(Compound):
            door: BinarySensor[OpenClosed]
            spindle: DigitalActuator

            def interlocks(self):
                yield Interlock(lambda: self.door.read() is OpenClosed.OPEN, [self.spindle], "the door is open")

    The condition is evaluated when the machine is connected and in each period, after `sample`. In periods in which
    parts with other rates are due, it is evaluated again after their sensors were read. The condition must be quick and
    read only synchronous sensors and actuators. If it raises an error, the actuators are inhibited, too; `state_of` and
    `value_of` of `umo.control` raise an error for a bad sensor. `forbids` names actuators, or compounds, which stand
    for all actuators in them. `latched`: the interlock inhibits until the condition is false and `acknowledge()` was
    called for one of its actuators, or for a compound that contains one. Then all actuators of the interlock are free.
    The interlock latches only from the first period on; before that it only inhibits. `effect="stop"`: `write` raises
    Interlocked instead of returning False. Unless the error is caught, the equipment whose code has written enters a
    fault; outside of equipment the run ends. Default: latched=False, effect="inhibit". An interlock is not a safety
    function.
    """

    condition: Callable[[], bool]
    forbids: Iterable[Actuator | Node]
    reason: str
    latched: bool = False
    effect: Literal["inhibit", "stop"] = "inhibit"

    def actuators(self) -> list[Atomic]:
        """Return all actuators in `forbids`, in declared order. Raises DeclarationError for anything else."""
        found: list[Atomic] = []
        for node in self.forbids:
            if isinstance(node, Actuator):
                found.append(node)
            elif isinstance(node, Node) and not isinstance(node, Atomic):
                found += [item for item in atoms(node) if isinstance(item, Actuator)]
            else:
                raise DeclarationError(f"interlock {self.reason!r} forbids {node!r}, which is not an actuator")
        return found

    def __post_init__(self) -> None:
        if not callable(self.condition):
            given = cut_repr(self.condition)
            raise DeclarationError(f"the condition of an interlock must be a function, `lambda: ...`, not {given}")
        check_acts_at_once("the condition of an interlock", self.condition)
        if not isinstance(self.reason, str) or not self.reason.strip():
            raise DeclarationError(f"the reason of an interlock must be a string, not {self.reason!r}")
        if not is_one_of(self.effect, ("inhibit", "stop")):
            raise DeclarationError(f'effect={self.effect!r} is neither "inhibit" nor "stop"')
        if not isinstance(self.forbids, Iterable):
            raise DeclarationError(f"interlock {self.reason!r} must forbid a list of objects, not {self.forbids!r}")
        object.__setattr__(self, "forbids", tuple(self.forbids))
        if not self.actuators():
            raise DeclarationError(f"interlock {self.reason!r} does not name an actuator")
