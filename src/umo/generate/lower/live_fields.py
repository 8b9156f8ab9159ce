"""The attributes of live objects that become fields of structs, and the types of these fields."""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cache, partial
from types import UnionType
from typing import Annotated, Any, ForwardRef, Union, get_args, get_origin

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    MASK,
    NOTHING,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    array,
    joined,
    list_of,
    optional,
    plain_number,
    state,
    unmixed,
)
from umo.generate.form import FALSE, TRUE, Assign, Element, Field, Literal, Member, Statement, Value, has, inside
from umo.generate.function_source import NoSource, bound, nodes_of
from umo.generate.known_values import is_installed
from umo.generate.lower.translation_memory import TranslationMemory
from umo.generate.names import identifier, member_name
from umo.generate.translation import StructField
from umo.generate.value_kinds import is_plain_dataclass, is_plain_enum, is_plain_record, parts_of
from umo.objects import Node, Quality

MOST_INT = 2**31 - 1
ACCEPTED = "_accept"
"""The name of attributes that have one or several accepted qualities."""
DTYPES = (np.float64, np.int64, np.bool_)
"""The accepted types of numbers in arrays. numpy rounds and cuts numbers of smaller types."""
PLAIN: dict[Any, CType] = {float: REAL, int: INT, bool: BOOL}


@dataclass
class LiveStruct:
    """The fields of one live object."""

    owner: Any
    path: str
    member: str
    """The name of the member in the machine's struct."""
    fields: dict[str, CType] = field(default_factory=dict)
    kinds: dict[str, CType] = field(default_factory=dict)
    """The types in Python of those fields whose class of numbers differs from that in C."""


class LiveFields:
    """The structs of the live objects of one machine that translated code uses."""

    def __init__(self, memory: TranslationMemory) -> None:
        self._memory = memory
        self.structs: dict[int, LiveStruct] = {}
        self._names: set[str] = set()
        self.tuples: dict[str, TupleType] = {}
        self.lengths: set[int] = set()
        """The lengths of arrays that translated code computes."""
        self.lists: set[ArrayType] = set()
        """Lists that translated code makes."""

    def known(self, owner: Any, path: str) -> LiveStruct:
        """Return the struct of an object. `path` is the path for a new struct."""
        found = self.structs.get(id(owner))
        if found is None:
            path = owner._path if isinstance(owner, Node) else path
            member = member_name(identifier(path) or "machine")
            while member in self._names or member in RESERVED:
                member += "_"
            self._names.add(member)
            found = self.structs[id(owner)] = LiveStruct(owner, path, member)
        return found

    def type_of(self, owner: Any, name: str, value: Any) -> CType | None:
        """Return the type of an attribute as a field, or None if it cannot be a field. Reals that may be integers are
        noted."""
        key, assigned = (id(owner), name), self._memory.assigned
        if name.isupper() and key not in assigned:
            return None
        if name == ACCEPTED:
            return MASK
        found = self.type_of_value(value)
        if found is None and key in assigned:
            found = self.record_type(value)
        if type(value) is str and self._memory.is_text_state(owner, name):
            found = self._memory.text_type(value)
        if found is None:
            return None
        hinted = self._hinted(type(owner), name)
        if found == NOTHING and hinted is None and key not in assigned:
            return None
        found = _both(found, hinted)
        return found and self._memory.fields.look(key, partial(_both, found))

    def _hinted(self, kind: type, name: str) -> CType | None:
        hints = self._memory.hints
        if (kind, name) not in hints:
            hints[kind, name] = _hinted(kind, name)
        return hints[kind, name]

    def type_of_value(self, value: Any) -> CType | None:
        if isinstance(value, np.generic):
            value = value.item()
        kind = type(value)
        if kind in PLAIN:
            return PLAIN[kind]
        if value is None:
            return NOTHING
        if isinstance(value, Enum):
            return state(type(value)) if is_plain_enum(type(value)) else None
        if type(value) is np.ndarray and value.ndim == 1 and value.dtype in DTYPES and len(value):
            return array({"f": REAL, "b": BOOL, "i": INT}[value.dtype.kind], len(value))
        if type(value) is list and value:
            of = {self.type_of_value(each) for each in value}
            (first, *more) = of
            if not more and first is not None and (first in PLAIN.values() or isinstance(first, TupleType)):
                return list_of(first, len(value))
        if isinstance(value, tuple) and value and is_plain_record(kind):
            return self._type_of_parts(value, getattr(kind, "_fields", ()), kind)
        return None

    def record_type(self, value: Any) -> TupleType | None:
        """Return the type of a frozen dataclass as a value, or None if there is no such type."""
        if not is_plain_dataclass(type(value)):
            return None
        return self._type_of_parts(parts_of(value), tuple(each.name for each in fields(value)), type(value))

    def _type_of_parts(self, parts: Sequence[Any], names: tuple[str, ...], kind: Any) -> TupleType | None:
        """Return the type of a tuple with these values, each of the class declared for it."""
        types = [self.type_of_value(each) for each in parts]
        found = self.tuple_type(types, names, kind)
        return found if found is not None and [of for _, of in found.members] == types else None

    def tuple_type(self, types: list[CType | None], names: tuple[str, ...], kind: Any) -> TupleType | None:
        """Return the type of a tuple of numbers, or None if the tuple has other elements. The types in a NamedTuple are
        those that it declares."""
        if names:
            types = [self._hinted(kind, name) or each for name, each in zip(names, types, strict=True)]
        if any(isinstance(each, MixedNumber | NumpyNumber) for each in types):
            return None  # a tuple would forget it
        if not types:
            return None
        types = [each and plain_number(each) for each in types]
        if any(isinstance(each, ArrayType) and each.listed for each in types):
            return None  # a list is no value of C: it has one place
        if not all(each in PLAIN.values() or isinstance(each, StateType | ArrayType) for each in types):
            return None
        if any(isinstance(each, TextType) for each in types):
            return None
        letters = "".join(map(_letter, types))
        members = tuple(zip(names or [f"_{n}" for n in range(len(types))], types, strict=True))
        name = f"machine_tuple_{letters}"
        if names:
            name = self._memory.record_name(kind, members)
        found = TupleType(name, members, kind if names or kind is list else None)  # type: ignore[arg-type]
        self.tuples.setdefault(name, found)
        return found

    def field(self, owner: Any, name: str, of: CType, path: str) -> Field:
        """Return the field of an attribute."""
        found = self.known(owner, path)
        found.fields[name], found.kinds[name] = unmixed(of), of
        return Field(found.member, name)

    def use(self, of: CType) -> None:
        """Record that the C needs this type."""
        if isinstance(of, OptionalType):
            self.use(of.of)
        elif isinstance(of, TupleType):
            for _, each in of.members:
                self.use(each)
        elif isinstance(of, ArrayType):
            self.lengths.add(int(of.length))
            self.lists |= {of} if of.listed else set()

    def records(self) -> list[CType]:
        """Return the types of arrays and tuples, each after the types of its parts."""
        arrays = self._arrays()
        of_numbers = [each for each in arrays if not isinstance(each.of, TupleType)]
        return [*of_numbers, *self.tuples.values(), *(each for each in arrays if each not in of_numbers)]

    def _arrays(self) -> list[ArrayType]:
        """Return all types of arrays. Arrays of numbers have a type for each length."""
        for each in self.filled:
            for of in each.fields.values():
                self.use(of)
        lengths = sorted(self.lengths)
        of_numbers = [array(of, length) for length in lengths for of in (REAL, INT, BOOL)]
        fields = (of for each in self.filled for of in each.fields.values())
        others = [of for of in fields if isinstance(of, ArrayType)]
        lists = sorted(self.lists, key=lambda each: each.name)
        return [*{each.name: each for each in (*others, *lists, *of_numbers)}.values()]

    def begin(self) -> list[Statement]:
        """Return the statements that give each field the value of its live object."""
        return [
            line
            for each in self.filled
            for name, of in each.fields.items()
            for line in self._set(Field(each.member, name), of, getattr(each.owner, name))
        ]

    def layout(self) -> list[StructField]:
        return [
            StructField(
                each.path,
                each.member,
                name,
                of.name,
                "STATE" if (id(each.owner), name) in self._memory.assigned else "INPUT",
            )
            for each in self.filled
            for name, of in each.fields.items()
        ]

    @property
    def filled(self) -> list[LiveStruct]:
        return [each for each in self.structs.values() if each.fields]

    def _set(self, place: Value, of: CType, value: Any) -> list[Statement]:
        if isinstance(of, ArrayType):
            each = list(value) * (of.length // len(value))  # one element is taken for each
            parts: list[Any] = [(Element(place, Literal(n, INT)), of.of, one) for n, one in enumerate(each)]
        elif isinstance(of, TupleType):
            parts = [
                (Member(place, name), kind, one) for (name, kind), one in zip(of.members, parts_of(value), strict=True)
            ]
        elif isinstance(of, OptionalType):
            there = Assign(has(place), FALSE if value is None else TRUE)
            return [there, *([] if value is None else self._set(inside(place), of.of, value))]
        else:
            return [Assign(place, literal(value, of))]
        return [line for part in parts for line in self._set(*part)]


def literal(value: Any, of: CType) -> Literal:
    """Return a live value as a literal of this type. Raises ValueError if it does not fit."""
    if of == MASK:
        return Literal(mask_of(value), of)
    if of == REAL:
        return Literal(float(value), of)
    if of == BOOL:
        return Literal(bool(value), of)
    if isinstance(of, StateType):
        return Literal([*of.kind].index(value), of)
    if not -MOST_INT <= value <= MOST_INT:
        raise ValueError(f"{value} does not fit 32 bits")
    return Literal(int(value), of)


RESERVED = {"core", "objects", "outputs", "conditionings", "interlocks"}
"""Other members of the machine's struct."""


def mask_of(accept: Any) -> int:
    """Return accepted qualities (`accept`) as bits."""
    one = isinstance(accept, Quality)
    return sum(1 << each for each in Quality if (each is accept if one else each in accept))


def _both(one: CType, other: CType | None) -> CType | None:
    """Return the type of an attribute that has one type and perhaps another; None if no type holds both."""
    try:
        return one if other is None else joined(one, other)
    except TypeError:
        return None


def _letter(of: CType | None) -> str:
    if isinstance(of, ArrayType):
        return f"_{of.name.removeprefix('machine_')}_"
    return {REAL: "r", INT: "i", BOOL: "b"}.get(of, "s")  # type: ignore[arg-type]


def _hinted(owner: Any, name: str) -> CType | None:
    """Return the type that a class declares for an attribute, if it is a number or a state, or optional. Later
    declarations count only if the value may be None."""
    for each in owner.__mro__:
        names = vars(sys.modules[each.__module__])
        if name in getattr(each, "__annotations__", {}):
            return _type_of_hint(_evaluated(each.__annotations__[name], names))
        if name in _hints_of(each):
            found = _type_of_hint(_evaluated(_hints_of(each)[name], names))
            return found if isinstance(found, OptionalType) else None
    return None


@cache
def _hints_of(kind: type) -> dict[str, str]:
    """Return the annotations in `setup` and `__init__`, such as `self.name: float | None = None`."""
    found: dict[str, str] = {}
    for each in ("__init__", "setup") if not is_installed(kind.__module__) else ():
        with suppress(NoSource):
            tree = bound(vars(kind).get(each)).source.tree  # type: ignore[arg-type]
            for node in (node for node in nodes_of(tree) if isinstance(node, ast.AnnAssign)):
                if isinstance(node.target, ast.Attribute) and isinstance(node.target.value, ast.Name):
                    found[node.target.attr] = ast.unparse(node.annotation)
    return found


def _evaluated(hint: Any, names: dict[str, Any]) -> Any:
    """Return the type that an annotation names, or None if it uses names that exist only for type checkers."""
    hint = hint.__forward_arg__ if isinstance(hint, ForwardRef) else hint
    try:
        return eval(hint, names) if isinstance(hint, str) else hint
    except Exception:
        return None


def _type_of_hint(hint: Any) -> CType | None:
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    if get_origin(hint) in (Union, UnionType):
        rest = [each for each in get_args(hint) if each is not type(None)]
        inner = _type_of_hint(rest[0]) if len(rest) == 1 and len(get_args(hint)) == 2 else None
        return None if inner is None else optional(inner)
    if isinstance(hint, type) and issubclass(hint, Enum) and len(hint) and is_plain_enum(hint):
        return state(hint)
    return PLAIN.get(hint) if isinstance(hint, type) else None


def _hinted_parameter(function: Any, name: str) -> CType | None:
    """Return the type that a function declares for a parameter."""
    return _type_of_hint(_evaluated(function.__annotations__.get(name), function.__globals__))
