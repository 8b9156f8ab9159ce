"""The types of translated code: what a value of Python is in C."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any


@dataclass(frozen=True)
class CType:
    """A type of C. `name` is its text."""

    name: str


@dataclass(frozen=True)
class StateType(CType):
    """A member of an Enum, as its number in the order of the members."""

    kind: Any


@dataclass(frozen=True)
class OptionalType(CType):
    """A value, or None."""

    of: CType


@dataclass(frozen=True)
class TupleType(CType):
    """A struct of numbers: a NamedTuple, or a tuple."""

    members: tuple[tuple[str, CType], ...]
    kind: Any = None
    """The class of a NamedTuple."""


@dataclass(frozen=True)
class ArrayType(CType):
    """A list of one length, or an array of numbers of one dimension. It exists as a field only."""

    of: CType
    length: int


REAL, INT, BOOL = CType("umo_real"), CType("int32_t"), CType("bool")
MASK = CType("uint32_t")
"""The qualities that are accepted besides GOOD and STALE, a bit each."""
NOTHING = CType("void")
"""None."""
OPTIONALS = {REAL: "umo_optional_real", INT: "umo_optional_int", BOOL: "umo_optional_bool"}


def state(kind: type[Enum]) -> StateType:
    return StateType("uint8_t", kind)


def optional(of: CType) -> OptionalType:
    """The type of a value that may be None; TypeError for one that has none."""
    if isinstance(of, OptionalType):
        return of
    if isinstance(of, TupleType):
        return OptionalType(f"{of.name}_or_none", of)
    name = "umo_optional_state" if isinstance(of, StateType) else OPTIONALS.get(of)
    if name is None:
        raise TypeError
    return OptionalType(name, of)


def joined(one: CType, other: CType) -> CType:
    """The type of a value that has either; TypeError if there is none."""
    if one == other:
        return one
    if NOTHING in (one, other):
        return optional(other if one == NOTHING else one)
    if isinstance(one, OptionalType) or isinstance(other, OptionalType):
        return optional(joined(plain(one), plain(other)))
    if {one, other} == {REAL, INT} or {one, other} == {REAL, BOOL}:
        return REAL
    if {one, other} == {INT, BOOL}:
        return INT
    if isinstance(one, TupleType) and isinstance(other, TupleType) and len(one.members) == len(other.members):
        pairs = zip(one.members, other.members, strict=True)
        if all(joined(a[1], b[1]) in (a[1], b[1]) for a, b in pairs):
            return one if one.kind is not None else other
    raise TypeError


def plain(of: CType) -> CType:
    """The type without None."""
    return of.of if isinstance(of, OptionalType) else of


def is_number(of: CType) -> bool:
    return of in (REAL, INT, BOOL)
