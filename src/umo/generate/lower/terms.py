"""Terms: the meanings of expressions during translation. A term is a value of the form, a live object or several of
them, or an iterable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from umo.generate.c_types import ArrayType, CType, plain_number
from umo.generate.form import Value


@dataclass(frozen=True)
class Code:
    """A value that the controller computes."""

    type: CType
    value: Value

    @property
    def as_plain(self) -> Code:
        """The number in C, without the mark that it is a number of numpy or of Python."""
        of = plain_number(self.type)
        return self if of is self.type else replace(self, type=of)


@dataclass(frozen=True)
class Elementwise(Code):
    """An array that is computed element by element: `value` is the element at the current index."""


@dataclass(frozen=True)
class SliceView(Elementwise):
    """A slice of an array: the elements of the array under other indices."""

    base: Value
    place: Callable[[Value], Value]
    """Function that returns the place of an element in the array."""


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
    """The indices of the true elements of an array. Their number is not known before run time."""

    array: Code


@dataclass(frozen=True)
class RingMethod:
    """A method of a deque."""

    base: Known
    name: str


@dataclass(frozen=True, eq=False)
class Known:
    """A value that is known when the code is generated."""

    value: Any
    owner: Any = None
    """The live object that has the value as an attribute."""
    name: str = ""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Known) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


NO_VALUE = "on some branches it has no value or another object", "give it a value first, or use one name per object"
"""The obstacle for a name that is read, and what to write instead."""


class UnknownText(str):
    """A text that is made at run time. A controller does not have such texts. It may be the message of an error."""

    __slots__ = ("field",)
    field: tuple[int, str] | None
    """The attribute from which the text is read, by the id of its object; None if it is not read from an attribute."""

    @classmethod
    def of(cls, field: tuple[int, str] | None) -> UnknownText:
        text = cls()
        text.field = field
        return text


TEXT = UnknownText.of(None)


@dataclass(frozen=True)
class TupleTerm:
    """A tuple of terms."""

    terms: tuple[Term, ...]
    names: tuple[str, ...] = ()
    kind: Any = None


@dataclass(frozen=True)
class NullTest:
    """A value that is only compared with None, such as the reason of an inhibition."""

    test: Value
    """The condition that the value is not None."""


@dataclass(frozen=True)
class TruthTest:
    """A value of which only the truth is used, such as `a and b` of a bool and a state."""

    test: Value


@dataclass(frozen=True)
class OneOf:
    """One of several live objects, chosen at run time."""

    place: Value
    """The number of the object. It does not change any more."""
    options: tuple[Known, ...]


@dataclass(frozen=True)
class Selection:
    """A list of the elements that a condition has selected. Their number is not known before run time."""

    at: Value
    """The place of the elements: the first ones of a list of `of`."""
    count: Value
    of: ArrayType


Term = Code | Known | TupleTerm | NullTest | TruthTest | OneOf | Selection


@dataclass(frozen=True)
class Turns:
    """The values in each turn of a loop."""

    count: int
    find: Callable[[int], Term]
    """Function that returns the values of the turn with this number."""
    find_at: Callable[[Value], Term] | None = None
    """Function that returns the turn for a computed number; None if the turns differ in more than their values."""
    arrays: tuple[Value, ...] = ()
    """The lists and arrays whose elements are read."""
    until: Value | None = None
    """The number of turns if it varies. `count` is then the maximum number."""
