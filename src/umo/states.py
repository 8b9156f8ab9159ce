"""Two-state types: the paper's `binary_enum` (Listing 1), one type for each pair of names.

A two-state type names two states and carries no level; which state is the electrical 1 is set in the declaration of an
object (`one=`), as in the paper. A state has no truth value, so `if sensor.read():` is an error: write `if
sensor.read() is OnOff.ON:`. A state can be compared with states of its own type and with None. A comparison with a
state of another type, a number or a string raises TypeError, with `==`, with `in` and in a `case` of a `match`. `is`
cannot raise an error: `umo check` and type checkers find a wrong comparison with `is` (decision 83).
"""

from __future__ import annotations

from enum import Enum
from numbers import Number
from typing import TYPE_CHECKING

from umo.errors import DeclarationError
from umo.text import cut_repr


class TwoState(Enum):
    """Base of all two-state types; derive a type by naming exactly two states."""

    _hash: int

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if len(cls.__members__) != 2 or len(list(cls)) != 2:
            raise DeclarationError(
                f"{cls.__name__} has {len(list(cls))} states; a two-state type must have exactly two"
            )
        for state in cls:  # not that of the name alone: in a dict or set, no text and no other type is found for it
            state._hash = hash((cls.__name__, state._name_))

    if not TYPE_CHECKING:  # typed, mypy would skip what follows an `if state:`, and not look at `state == 1`

        def __bool__(self):
            raise TypeError(f"{self} has no truth value; compare it: `is {shown(self)}`")

        def __eq__(self, other):
            if self is other:
                return True
            if type(other) is type(self):
                return False
            if is_plain(other):
                raise TypeError(f"{shown(self)} is never equal to {shown(other)}; compare it: {_nearest(self, other)}")
            return NotImplemented

        def __lt__(self, other):
            raise TypeError(f"{shown(self)} has no order; compare it: {_nearest(self, other)}")

        __gt__ = __le__ = __ge__ = __lt__

        def __hash__(self):
            return self._hash

    def __str__(self) -> str:
        return self.name


def is_plain(given: object) -> bool:
    """Return True if a value is a number, a string or a state. No object, and no state of another type, is equal to
    such a value."""
    return isinstance(given, Enum | int | float | str | bytes | Number)


def shown(given: object) -> str:
    """Return a compared value for a message: a state in the form of source code."""
    return f"{type(given).__name__}.{given.name}" if isinstance(given, Enum) else cut_repr(given)


def comparisons(states: type[TwoState], meant: object, what: str = "") -> str:
    """Return what to write instead: a comparison with the state of this name, or a comparison with each state."""
    name = str(getattr(meant, "name", meant)).upper()
    named = [name] if name in states.__members__ else list(states.__members__)
    return " or ".join(f"`{what}is {states.__name__}.{each}`" for each in named)


def _nearest(one: TwoState, other: object) -> str:
    """Return the nearest comparisons with both, as it is not known which of two states was written and which was
    read."""
    ways = [comparisons(type(one), other)]
    if isinstance(other, TwoState) and type(other) is not type(one):
        ways.append(comparisons(type(other), one))
    return ", or ".join(ways)


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
