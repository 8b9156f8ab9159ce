"""What is known of the values that a text is made of: the live object, or the classes that they may have."""

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
from umo.generate.lower.terms import Code, Many, OneOf, Present, Selection, Term, TruePlaces, Truth, UnknownText
from umo.generate.value_kinds import is_plain_enum, own_methods

NUMBERS = frozenset({bool, int, float})
PLAIN = NUMBERS | {str, bytes, NoneType, complex}


@dataclass(frozen=True)
class LiveKind:
    """An object of the machine, or what a name of a module stands for."""

    value: Any


@dataclass(frozen=True)
class Some:
    """A value of one of these classes."""

    kinds: frozenset[type]


@dataclass(frozen=True)
class RowKind:
    """An array or a list of numbers; `count`: how many; None: it is not known."""

    of: type
    count: int | None


@dataclass(frozen=True)
class Several:
    """A tuple of these."""

    parts: tuple[Kind, ...]
    names: tuple[str, ...] = ()


Kind: TypeAlias = LiveKind | Some | RowKind | Several
TEXT = Some(frozenset({str}))


def some(*kinds: type) -> Some:
    return Some(frozenset(kinds))


def kind_of_type(of: CType) -> Kind:
    """What a value of translated code is in Python."""
    if isinstance(of, OptionalType):
        inner = kind_of_type(of.of)
        return Some(inner.kinds | {NoneType}) if isinstance(inner, Some) else some(object)
    if isinstance(of, ArrayType):
        element = kind_of_type(of.of)
        (kind,) = element.kinds if isinstance(element, Some) and len(element.kinds) == 1 else (object,)
        return RowKind(kind, None if of.loose else of.length)
    if isinstance(of, TupleType):
        names, types = zip(*of.members, strict=True)
        return Several(tuple(map(kind_of_type, types)), names)
    if isinstance(of, StateType):
        return TEXT if isinstance(of, TextType) else some(of.kind)
    kinds = {REAL: float, INT: int, BOOL: bool}
    if isinstance(of, MixedNumber):
        return Some(NUMBERS)
    return some(kinds.get(plain_number(of), object))


def kind_of_term(term: Term) -> Kind:
    if isinstance(term, Code):
        return kind_of_type(term.type)
    if isinstance(term, Many):
        return Several(tuple(map(kind_of_term, term.terms)), term.names)
    if isinstance(term, Present):
        return some(str, NoneType)
    if isinstance(term, Truth | OneOf | Selection):
        return some(object)
    if isinstance(term.value, TruePlaces):
        return RowKind(int, None)
    return TEXT if isinstance(term.value, UnknownText) else LiveKind(term.value)


def is_plain(value: Any) -> bool:
    """Whether this is a number, a text, a state, None, or a tuple of these."""
    if type(value) is tuple:
        return all(map(is_plain, value))
    return type(value) in PLAIN or isinstance(value, np.generic | Enum)


def plain_kinds(kind: Kind) -> frozenset[type] | None:
    """The classes that a plain value has; None: it is an object of its own."""
    if isinstance(kind, Some):
        return kind.kinds
    return frozenset({type(kind.value)}) if isinstance(kind, LiveKind) and is_plain(kind.value) else None


def is_bare(kind: type) -> bool:
    """Whether Python itself tells if an object of this class is true."""
    return not own_methods(kind, ("__bool__", "__len__"))


def are_one_enum(kinds: set[type]) -> bool:
    rest = kinds - {NoneType}
    return len(rest) == 1 and all(issubclass(each, Enum) and is_plain_enum(each) for each in rest)
