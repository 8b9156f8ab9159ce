"""What an expression is while it is translated: a value of the form, a live object, or several of them; and what is
gone through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from umo.generate.c_types import ArrayType, CType
from umo.generate.form import Value


@dataclass(frozen=True)
class Code:
    """A value that the controller computes."""

    type: CType
    value: Value


@dataclass(frozen=True)
class Elementwise(Code):
    """An array that is computed element by element: `value` is the one at the place `Here`."""


@dataclass(frozen=True)
class SliceView(Elementwise):
    """A slice of an array, which has its elements under other names."""

    base: Value
    place: Callable[[Value], Value]
    """Where an element is in the array."""


@dataclass(frozen=True)
class ArrayMethod:
    """A method of an array."""

    array: Code
    name: str


@dataclass(frozen=True)
class RecordReplace:
    """`_replace` of a NamedTuple."""

    record: Term


@dataclass(frozen=True)
class TruePlaces:
    """The places of the elements of an array that are true: how many there are is of run time."""

    array: Code


@dataclass(frozen=True)
class RingMethod:
    """A method of a deque."""

    base: Known
    name: str


@dataclass(frozen=True, eq=False)
class Known:
    """Something that is known when the code is generated."""

    value: Any
    owner: Any = None
    """The live object whose attribute it is."""
    name: str = ""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Known) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


NO_VALUE = "on some ways it has no value, or another object", "give it a value first, a name for each object"
"""A name that is read: what is told of it, and what to write."""


class UnknownText(str):
    """A text that is made at run time: a controller has none. It may be the message of an error."""

    __slots__ = ("field",)
    field: tuple[int, str] | None
    """The attribute that it is read from, by the id of its object; None: from none."""

    @classmethod
    def of(cls, field: tuple[int, str] | None) -> UnknownText:
        text = cls()
        text.field = field
        return text


TEXT = UnknownText.of(None)


@dataclass(frozen=True)
class Many:
    """A tuple of terms."""

    terms: tuple[Term, ...]
    names: tuple[str, ...] = ()
    kind: Any = None


@dataclass(frozen=True)
class Present:
    """Something that is only asked for whether it is None, such as the reason of an inhibition."""

    test: Value
    """The condition under which it is not None."""


@dataclass(frozen=True)
class Truth:
    """Something that is only asked for whether it is true, such as `a and b` of a bool and a state."""

    test: Value


@dataclass(frozen=True)
class OneOf:
    """One of several live objects, of which it is computed which one."""

    place: Value
    """The number of the object, which nothing changes any longer."""
    options: tuple[Known, ...]


@dataclass(frozen=True)
class Selection:
    """A list of those that a condition has chosen: how many there are is of run time."""

    at: Value
    """Where they are: the first ones of a list of `of`."""
    count: Value
    of: ArrayType


Term = Code | Known | Many | Present | Truth | OneOf | Selection


@dataclass(frozen=True)
class Turns:
    """What is gone through."""

    count: int
    find: Callable[[int], Term]
    """What the turn of this number finds."""
    find_at: Callable[[Value], Term] | None = None
    """The same for a number that is computed; None: turns differ in more than it."""
    arrays: tuple[Value, ...] = ()
    """The lists and arrays whose elements are read."""
    until: Value | None = None
    """How many turns there are, where it changes; `count` is then the most of them."""
