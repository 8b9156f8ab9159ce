"""The attributes of live objects that become fields of structs, and what type they have."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from umo.generate.c_text import identifier, real
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
    TupleType,
    array,
    joined,
    list_of,
    optional,
    plain_number,
    state,
    unmixed,
)
from umo.generate.translation import ControllerTarget, StructField
from umo.generate.translation_memory import TranslationMemory
from umo.generate.value_kinds import is_plain_enum, is_plain_record, is_plain_word
from umo.objects import Node, Quality

MOST_INT = 2**31 - 1
ACCEPTED = "_accept"
"""Attributes of this name are qualities that are accepted, one or several."""
DTYPES = (np.float64, np.int64, np.bool_)
"""Numbers of arrays; smaller ones are rounded and cut by numpy."""
PLAIN: dict[Any, CType] = {float: REAL, int: INT, bool: BOOL}


@dataclass
class LiveStruct:
    """The fields of one live object."""

    owner: Any
    path: str
    member: str
    """The member of the machine's struct."""
    fields: dict[str, CType] = field(default_factory=dict)


class LiveFields:
    """The structs of the live objects of one machine, as far as translated code uses them."""

    def __init__(self, memory: TranslationMemory, target: ControllerTarget) -> None:
        self._memory, self._target = memory, target
        self.structs: dict[int, LiveStruct] = {}
        self._names: set[str] = set()
        self.tuples: dict[str, TupleType] = {}
        self.lengths: set[int] = set()
        """Of the arrays that translated code computes."""

    def known(self, owner: Any, path: str) -> LiveStruct:
        """The struct of an object; `path` is its path if it is new."""
        found = self.structs.get(id(owner))
        if found is None:
            path = owner._path if isinstance(owner, Node) else path
            member = identifier(path) or "machine"
            while member in self._names or member in RESERVED or not is_plain_word(member):
                member += "_"
            self._names.add(member)
            found = self.structs[id(owner)] = LiveStruct(owner, path, member)
        return found

    def type_of(self, owner: Any, name: str, value: Any) -> CType | None:
        """The type of an attribute as a field; None: it is none. It tells reals that may be whole numbers."""
        key = id(owner), name
        assigned = key in self._memory.assigned
        if name.isupper() and not assigned:
            return None
        if name == ACCEPTED:
            return MASK
        found = self.type_of_value(value)
        hinted = _hinted(type(owner), name)
        if found is None or (found == NOTHING and not assigned and hinted is None):
            return None
        for each in (hinted, self._memory.fields.get(key)):
            if each is not None:
                try:
                    found = joined(found, each)
                except TypeError:
                    return None
        return found

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
            return self.tuple_type([self.type_of_value(each) for each in value], getattr(kind, "_fields", ()), kind)
        return None

    def tuple_type(self, types: list[CType | None], names: tuple[str, ...], kind: Any) -> TupleType | None:
        """The type of a tuple of numbers; None if it has others. Those of a NamedTuple are as it declares them."""
        if names:
            types = [_hinted(kind, name) or each for name, each in zip(names, types, strict=True)]
        if any(isinstance(each, MixedNumber | NumpyNumber) for each in types):
            return None  # a tuple would forget it
        types = [each and plain_number(each) for each in types]
        if any(isinstance(each, ArrayType) and each.listed for each in types):
            return None  # a list is no value of C: it has one place
        if not all(each in PLAIN.values() or isinstance(each, StateType | ArrayType) for each in types):
            return None
        letters = "".join(map(_letter, types))
        members = tuple(zip(names or [f"_{n}" for n in range(len(types))], types, strict=True))
        name = f"machine_tuple_{letters}"
        if names:
            if not all(map(is_plain_word, names)):
                return None
            name = self._memory.record_name(kind, members)
        found = TupleType(name, members, kind if names or kind is list else None)  # type: ignore[arg-type]
        self.tuples.setdefault(name, found)
        return found

    def field(self, owner: Any, name: str, of: CType, path: str) -> str:
        """The text of a field in C."""
        found = self.known(owner, path)
        found.fields[name] = unmixed(of)
        return f"m->{found.member}.{identifier(name)}"

    # The texts -----------------------------------------------------------------------------------------

    def header(self) -> str:
        """Structs, one for each kind of array, each tuple and each object."""
        parts = [_structs(each) for each in self._arrays() if not isinstance(each.of, TupleType)]
        parts += map(_structs, self.tuples.values())
        parts += [_structs(each) for each in self._arrays() if isinstance(each.of, TupleType)]
        for live in self.filled:
            parts.append(f"/* {live.path or 'the machine'}: {type(live.owner).__qualname__} */\n")
            members = [(identifier(name), of) for name, of in live.fields.items()]
            parts.append(_struct(f"machine_of_{live.member}", members))
        return "\n".join(parts)

    def use(self, of: CType) -> None:
        """The C has something of this type."""
        if isinstance(of, OptionalType):
            self.use(of.of)
        elif isinstance(of, TupleType):
            for _, each in of.members:
                self.use(each)
        elif isinstance(of, ArrayType):
            self.lengths.add(int(of.length))

    def _arrays(self) -> list[ArrayType]:
        """Every kind of array that there may be: those of numbers have a kind for each length."""
        for each in self.filled:
            for of in each.fields.values():
                self.use(of)
        lengths = sorted(self.lengths)
        of_numbers = [array(of, length) for length in lengths for of in (REAL, INT, BOOL)]
        fields = (of for each in self.filled for of in each.fields.values())
        others = [of for of in fields if isinstance(of, ArrayType)]
        return [*{each.name: each for each in (*others, *of_numbers)}.values()]

    def members(self) -> str:
        return "".join(f"    machine_of_{each.member} {each.member};\n" for each in self.filled)

    def init(self) -> str:
        lines = []
        for each in self.filled:
            for name, of in each.fields.items():
                place = f"m->{each.member}.{identifier(name)}"
                lines += self._set(place, of, getattr(each.owner, name))
        body = "".join(f"    {line}\n" for line in lines) or "    (void)m;\n"
        return f"static void init_objects(umo_machine *m)\n{{\n{body}}}\n"

    def access(self) -> str:
        """The function that gives the structs by their numbers."""
        cases = "".join(f"    case {n}:\n        return &m->{each.member};\n" for n, each in enumerate(self.filled))
        access = f"    switch (number) {{\n{cases}    default:\n        (void)m;\n        return NULL;\n    }}\n"
        return f"void *machine_struct(umo_machine *m, int16_t number)\n{{\n{access}}}\n"

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

    def _set(self, place: str, of: CType, value: Any) -> list[str]:
        """Statements that give a field its value."""
        if isinstance(of, ArrayType):
            each = list(value) * (of.length // len(value))  # one element is taken for each
            return [line for n, one in enumerate(each) for line in self._set(f"{place}.at[{n}]", of.of, one)]
        if isinstance(of, TupleType):
            pairs = zip(of.members, value, strict=True)
            return [line for (name, kind), each in pairs for line in self._set(f"{place}.{name}", kind, each)]
        if isinstance(of, OptionalType):
            if value is None:
                return [f"{place}.has = false;"]
            return [f"{place}.has = true;", *self._set(f"{place}.value", of.of, value)]
        return [f"{place} = {self.literal(value, of)};"]

    def literal(self, value: Any, of: CType) -> str:
        """A live value as text of this type; ValueError if it does not fit."""
        if of == MASK:
            return f"{mask_of(value)}u"
        if of == REAL:
            return real(float(value), self._target)
        if of == BOOL:
            return "true" if value else "false"
        if isinstance(of, StateType):
            return str([*of.kind].index(value))
        if not -MOST_INT <= value <= MOST_INT:
            raise ValueError(f"{value} does not fit 32 bits")
        return str(int(value))


RESERVED = {"core", "objects", "outputs", "conditionings", "interlocks"}
"""Other members of the machine's struct."""


def mask_of(accept: Any) -> int:
    """The qualities of an `accept` as bits."""
    one = isinstance(accept, Quality)
    return sum(1 << each for each in Quality if (each is accept if one else each in accept))


def _structs(of: CType) -> str:
    """A type of several numbers, and the same or None."""
    if isinstance(of, ArrayType):
        own = f"typedef struct {{\n    {of.of.name} at[{of.length}];\n}} {of.name};\n"
    else:
        assert isinstance(of, TupleType)
        own = _struct(of.name, of.members)
    return own + _struct(optional(of).name, [("has", BOOL), ("value", of)])


def _letter(of: CType | None) -> str:
    if isinstance(of, ArrayType):
        return f"_{of.name.removeprefix('machine_')}_"
    return {REAL: "r", INT: "i", BOOL: "b"}.get(of, "s")  # type: ignore[arg-type]


def _struct(name: str, members: Any) -> str:
    lines = [f"    {of.name} {each};\n" for each, of in members]
    return f"typedef struct {{\n{''.join(lines)}}} {name};\n"


def _hinted(owner: Any, name: str) -> CType | None:
    """The type that a class declares for an attribute, if it is a number, a state, or one of these or None."""
    for each in owner.__mro__:
        if name in getattr(each, "__annotations__", {}):
            try:
                hint = get_type_hints(each, vars(sys.modules[each.__module__]), include_extras=False).get(name)
            except Exception:  # names that exist for type checkers only
                return None
            return _type_of_hint(hint)
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
    """The type that a function declares for a parameter."""
    hint = function.__annotations__.get(name)
    if isinstance(hint, str):
        try:
            hint = eval(hint, function.__globals__)
        except Exception:  # names that exist for type checkers only
            return None
    return _type_of_hint(hint)
