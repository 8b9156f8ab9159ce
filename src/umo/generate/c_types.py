"""The C types of translated Python values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

from umo.generate.value_kinds import is_plain_enum


@dataclass(frozen=True)
class CType:
    """A type of C. `name` is its name in C."""

    name: str


@dataclass(frozen=True)
class StateType(CType):
    """A member of an Enum, as its number in the order of the members."""

    kind: Any


@dataclass(frozen=True)
class TextType(StateType):
    """One of the strings of a machine, as its index among them. `kind`: all strings, in a tuple; the string that was
    added last is at the end."""


@dataclass(frozen=True)
class OptionalType(CType):
    """A value or None."""

    of: CType


@dataclass(frozen=True)
class TupleType(CType):
    """A struct of numbers: a NamedTuple, or a tuple."""

    members: tuple[tuple[str, CType], ...]
    kind: Any = None
    """The class of a NamedTuple."""


@dataclass(frozen=True)
class ArrayType(CType):
    """A list of fixed length, or a one-dimensional array of numbers: a struct with the member `at`."""

    of: CType
    length: int
    listed: bool = False
    """True for a list."""
    loose: bool = False
    """True if the array may have only one element in Python, which then stands for all elements."""


@dataclass(frozen=True)
class NumpyNumber(CType):
    """A number of numpy. Division by 0 gives infinity and raises no error."""

    of: CType
    sure: bool = True
    """False if the number may also be a Python number."""


@dataclass(frozen=True)
class MixedNumber(CType):
    """A real in C that is sometimes an int and sometimes a float in Python: the two differ in the sign of zero and
    above 2**53. It is also the type of a number that may be a bool, which an object refuses."""

    of: CType
    is_bool: bool = False
    """True if the number may be a bool."""


REAL, INT, BOOL = CType("umo_real"), CType("int32_t"), CType("bool")
MASK = CType("uint32_t")
"""The accepted qualities besides GOOD and STALE, one bit each."""
NOTHING = CType("void")
"""The type of None."""
MIXED = MixedNumber(REAL.name, REAL)
UNSURE = NumpyNumber, MixedNumber
"""Types of numbers whose class in Python is not known or not fixed."""
LONG = CType("int64_t")
"""The counter of a loop whose steps may exceed 32 bits."""
PLURALS = {REAL: "reals", INT: "ints", BOOL: "bools"}
OPTIONALS = {REAL: "umo_optional_real", INT: "umo_optional_int", BOOL: "umo_optional_bool"}


class MaybeScalar(int):
    """The length of an array that may also have one element in Python."""


def array(of: CType, length: int) -> ArrayType:
    """Return the type of an array with this number of elements."""
    stem = f"{of.name}s" if isinstance(of, TupleType) else f"machine_{PLURALS.get(of, 'states')}"
    return ArrayType(f"{stem}_{length}", of, length, loose=isinstance(length, MaybeScalar))


def list_of(of: CType, length: int) -> ArrayType:
    """Return the type of a list with this number of elements."""
    return ArrayType(f"{array(of, length).name}_list", of, length, listed=True)


def numpy_number(of: CType, sure: bool = True) -> CType:
    """Return the type of an element of an array."""
    return NumpyNumber(of.name, of, sure) if of in (REAL, INT, BOOL) else of


def plain_number(of: CType) -> CType:
    """Return the C type of a number, without the mark that it is a number of numpy or of Python."""
    return of.of if isinstance(of, UNSURE) else of


def state(kind: type[Enum]) -> StateType:
    """Return the type of a state. Raises TypeError for an Enum whose members may be equal to other values."""
    if not is_plain_enum(kind):
        raise TypeError(f"{kind.__name__} defines itself which of its states are equal, or is a Flag")
    return StateType("uint8_t", kind)


def optional(of: CType) -> OptionalType:
    """Return the type of a value that may be None. Raises TypeError if the type has no optional type."""
    if isinstance(of, OptionalType):
        return of
    if isinstance(of, TupleType | ArrayType):
        return OptionalType(f"{of.name}_or_none", of)
    name = "umo_optional_state" if isinstance(of, StateType) else OPTIONALS.get(plain_number(of))
    if name is None:
        raise TypeError
    return OptionalType(name, of)


def joined(one: CType, other: CType) -> CType:
    """Return the type of a value that has one of two types. Raises TypeError if there is no such type."""
    if one == other:
        return one
    if isinstance(one, TextType) or isinstance(other, TextType):
        if not (isinstance(one, TextType) and isinstance(other, TextType)):
            raise TypeError
        return max(one, other, key=lambda each: len(each.kind))
    if NOTHING in (one, other):
        return optional(other if one == NOTHING else one)
    if isinstance(one, NumpyNumber) or isinstance(other, NumpyNumber):
        sure = all(isinstance(each, NumpyNumber) and each.sure for each in (one, other))
        of = joined(plain_number(one), plain_number(other))
        if isinstance(of, MixedNumber):
            raise TypeError
        return numpy_number(of, sure)
    if isinstance(one, OptionalType) or isinstance(other, OptionalType):
        return optional(joined(plain(one), plain(other)))
    if is_number(plain_number(one)) and is_number(plain_number(other)):
        is_real = REAL in (plain_number(one), plain_number(other))
        if may_be_bool(one) or may_be_bool(other):
            return MixedNumber(REAL.name, REAL, True) if is_real else MixedNumber(INT.name, INT, True)
        return MIXED
    if isinstance(one, ArrayType) or isinstance(other, ArrayType):
        return _joined_arrays(one, other)
    if isinstance(one, TupleType) and isinstance(other, TupleType) and len(one.members) == len(other.members):
        pairs = zip(one.members, other.members, strict=True)
        if (
            all(a[1] == b[1] for a, b in pairs)
            and None in (one.kind, other.kind)
            and list not in (one.kind, other.kind)
        ):
            return one if one.kind is not None else other
    raise TypeError


def _joined_arrays(one: CType, other: CType) -> CType:
    """Return the type of arrays of the same length. A number or an array of one element counts as an array of any
    length."""
    if any(isinstance(each, ArrayType) and each.listed for each in (one, other)):
        raise TypeError
    lengths = {each.length for each in (one, other) if isinstance(each, ArrayType)}
    if len(lengths - {1}) > 1:
        raise TypeError
    of = plain_number(joined(*(each.of if isinstance(each, ArrayType) else each for each in (one, other))))
    strict = all(isinstance(each, ArrayType) and not each.loose for each in (one, other)) and len(lengths) == 1
    length = max(lengths)
    return array(of, length if strict or length == 1 else MaybeScalar(length))


def plain(of: CType) -> CType:
    """Return the type without None."""
    return of.of if isinstance(of, OptionalType) else of


def unmixed(of: CType) -> CType:
    """Return the type of a field for a value of this type."""
    if isinstance(of, OptionalType):
        return OptionalType(of.name, plain_number(of.of))
    return plain_number(of)


def may_be_bool(of: CType) -> bool:
    """True if a value, when not None, may be a bool."""
    of = plain(of)
    return of == BOOL or (isinstance(of, MixedNumber) and of.is_bool)


def of_python(of: CType) -> CType:
    """Return the type with Python numbers instead of numpy numbers."""
    if isinstance(of, OptionalType):
        return OptionalType(of.name, of_python(of.of))
    return of.of if isinstance(of, NumpyNumber) else of


def perhaps_of_numpy(of: CType) -> CType:
    """Return the type with numbers that may be numpy's or Python's."""
    if isinstance(of, OptionalType):
        return OptionalType(of.name, perhaps_of_numpy(of.of))
    return numpy_number(plain_number(of), sure=False)


def is_number(of: CType) -> bool:
    return of in (REAL, INT, BOOL)
