"""The known facts about the values in a text: the live object that a value is, or the classes that it may have."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from types import NoneType
from typing import Any, TypeAlias

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    plain_number,
)
from umo.generate.lower.terms import (
    Code,
    NullTest,
    OneOf,
    Selection,
    Term,
    TruePlaces,
    TruthTest,
    TupleTerm,
    UnknownText,
)
from umo.generate.value_kinds import is_plain_enum, own_methods

NUMBERS = frozenset({bool, int, float})
PLAIN = NUMBERS | {str, bytes, NoneType, complex}


@dataclass(frozen=True)
class LiveKind:
    """A live object: an object of the machine, or the value of a name of a module."""

    value: Any


@dataclass(frozen=True)
class ClassKind:
    """A value of one of these classes."""

    kinds: frozenset[type]


@dataclass(frozen=True)
class RowKind:
    """An array or a list of numbers. `count` is the number of the elements, or None if it is not known."""

    of: type
    count: int | None


@dataclass(frozen=True)
class TupleKind:
    """A tuple of values of these kinds."""

    parts: tuple[Kind, ...]
    names: tuple[str, ...] = ()


Kind: TypeAlias = LiveKind | ClassKind | RowKind | TupleKind
TEXT = ClassKind(frozenset({str}))


def some(*kinds: type) -> ClassKind:
    return ClassKind(frozenset(kinds))


def kind_of_type(of: CType) -> Kind:
    """Return the kind of a value of translated code in Python."""
    if isinstance(of, OptionalType):
        inner = kind_of_type(of.of)
        return ClassKind(inner.kinds | {NoneType}) if isinstance(inner, ClassKind) else some(object)
    if isinstance(of, ArrayType):
        element = kind_of_type(of.of)
        (kind,) = element.kinds if isinstance(element, ClassKind) and len(element.kinds) == 1 else (object,)
        return RowKind(kind, None if of.loose else of.length)
    if isinstance(of, TupleType):
        names, types = zip(*of.members, strict=True)
        return TupleKind(tuple(map(kind_of_type, types)), names)
    if isinstance(of, StateType):
        return TEXT if isinstance(of, TextType) else some(of.kind)
    kinds = {REAL: float, INT: int, BOOL: bool}
    if isinstance(of, MixedNumber):
        return ClassKind(NUMBERS)
    return some(kinds.get(plain_number(of), object))


def kind_of_term(term: Term) -> Kind:
    if isinstance(term, Code):
        return kind_of_type(term.type)
    if isinstance(term, TupleTerm):
        return TupleKind(tuple(map(kind_of_term, term.terms)), term.names)
    if isinstance(term, NullTest):
        return some(str, NoneType)
    if isinstance(term, TruthTest | OneOf | Selection):
        return some(object)
    if isinstance(term.value, TruePlaces):
        return RowKind(int, None)
    return TEXT if isinstance(term.value, UnknownText) else LiveKind(term.value)


def is_plain(value: Any) -> bool:
    """True if this is a number, a string, a state, None, or a tuple of these."""
    if type(value) is tuple:
        return all(map(is_plain, value))
    return type(value) in PLAIN or isinstance(value, np.generic | Enum)


def plain_kinds(kind: Kind) -> frozenset[type] | None:
    """Return the classes of a plain value, or None if the value is an object."""
    if isinstance(kind, ClassKind):
        return kind.kinds
    return frozenset({type(kind.value)}) if isinstance(kind, LiveKind) and is_plain(kind.value) else None


def is_bare(kind: type) -> bool:
    """True if Python itself, and not the class, decides whether an object of this class is true."""
    return not own_methods(kind, ("__bool__", "__len__"))


def are_one_enum(kinds: set[type]) -> bool:
    rest = kinds - {NoneType}
    return len(rest) == 1 and all(issubclass(each, Enum) and is_plain_enum(each) for each in rest)
