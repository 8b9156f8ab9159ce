"""Two-state types: the paper's `binary_enum` (Listing 1), one type for each pair of names.

A two-state type names two states and carries no level; which state is the electrical 1 is said where an
object is declared (`one=`), as in the paper. A state has no truth value, so `if sensor.read():` is an error:
write `if sensor.read() is OnOff.ON:`.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from umo.errors import DeclarationError


class TwoState(Enum):
    """Base of all two-state types; derive one by naming exactly two states."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if len(cls.__members__) != 2 or len(list(cls)) != 2:
            raise DeclarationError(
                f"{cls.__name__} has {len(list(cls))} states; a two-state type must have exactly two"
            )

    if not TYPE_CHECKING:  # typed, its NoReturn would make mypy skip whatever follows an `if state:`

        def __bool__(self):
            raise TypeError(f"{self} has no truth value; compare it: `is {type(self).__name__}.{self.name}`")

    def __str__(self) -> str:
        return self.name


class ZeroOne(TwoState):
    ZERO = "zero"
    ONE = "one"


class OnOff(TwoState):
    ON = "on"
    OFF = "off"


class LeftRight(TwoState):
    LEFT = "left"
    RIGHT = "right"


class UpDown(TwoState):
    UP = "up"
    DOWN = "down"


class HighLow(TwoState):
    HIGH = "high"
    LOW = "low"


class FrontBack(TwoState):
    FRONT = "front"
    BACK = "back"


class Rotation(TwoState):
    """Clockwise and counterclockwise."""

    CW = "clockwise"
    CCW = "counterclockwise"


class EnableDisable(TwoState):
    ENABLE = "enable"
    DISABLE = "disable"


class PassFail(TwoState):
    PASS = "pass"
    FAIL = "fail"


class CompleteIncomplete(TwoState):
    COMPLETE = "complete"
    INCOMPLETE = "incomplete"


class OpenClosed(TwoState):
    OPEN = "open"
    CLOSED = "closed"
