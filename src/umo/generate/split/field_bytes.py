"""Converts the fields of a part to bytes on the link. The numbers of each field follow one another as in the memory of
the controller."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from typing import Any

import numpy as np

from umo.errors import DriverError
from umo.generate.c_types import BOOL, INT, MASK, REAL, ArrayType, CType, OptionalType, StateType, TupleType
from umo.generate.lower.live_fields import LiveStruct, mask_of
from umo.generate.names import member_name
from umo.generate.value_kinds import parts_of

LETTERS = {INT: "i", BOOL: "?", MASK: "I"}
ZEROS = {"?": False}


class FieldBytes:
    """One field of a live object: its bytes, its numbers in C, and the attribute for which it stands."""

    def __init__(self, live: LiveStruct, name: str, of: CType, changes: bool, real: str) -> None:
        self.owner, self.name, self.type = live.owner, name, of
        self.path = f"{live.path}.{name}".lstrip(".")
        self.place = f"{live.member}.{member_name(name)}"
        """The member of the machine's struct."""
        self.changes = changes
        """True if the controller assigns it."""
        self._real = "d" if real == "double" else "f"
        self._bytes = Struct("<" + "".join(letter for _, letter in self._numbers(of, "")))
        self.size = self._bytes.size

    def members(self) -> list[str]:
        """Return the numbers in C, as members of the machine's struct."""
        return [f"{self.place}{member}" for member, _ in self._numbers(self.type, "")]

    def live(self) -> bytes:
        """Return the bytes of the attribute's present value. Raises DriverError if a controller cannot hold it."""
        value = getattr(self.owner, self.name)
        try:
            return self._bytes.pack(*self._flat(self.type, value))
        except Exception as error:
            raise DriverError(f"{self.path} cannot be {value!r} on a controller: {error}") from None

    def assign(self, data: bytes) -> None:
        """Set the attribute to the value of these bytes."""
        value = self._value(self.type, iter(self._bytes.unpack(data)))
        before = getattr(self.owner, self.name)
        if isinstance(before, np.ndarray):
            before[:] = value[: len(before)]
        else:
            setattr(self.owner, self.name, value)

    def _numbers(self, of: CType, member: str) -> Iterator[tuple[str, str]]:
        if isinstance(of, ArrayType):
            for number in range(of.length):
                yield from self._numbers(of.of, f"{member}.at[{number}]")
        elif isinstance(of, OptionalType):
            yield f"{member}.has", "?"
            yield from self._numbers(of.of, f"{member}.value")
        elif isinstance(of, TupleType):
            for name, each in of.members:
                yield from self._numbers(each, f"{member}.{member_name(name)}")
        else:
            yield member, "B" if isinstance(of, StateType) else self._real if of == REAL else LETTERS[of]

    def _flat(self, of: CType, value: Any) -> list[Any]:
        if isinstance(of, ArrayType):
            each = list(value) * (of.length // len(value))  # one element is taken for each
            return [number for one in each for number in self._flat(of.of, one)]
        if isinstance(of, OptionalType):
            if value is None:
                return [False, *(ZEROS.get(letter, 0) for _, letter in self._numbers(of.of, ""))]
            return [True, *self._flat(of.of, value)]
        if isinstance(of, TupleType):
            pairs = zip(of.members, parts_of(value), strict=True)
            return [number for (_, kind), each in pairs for number in self._flat(kind, each)]
        if of == MASK:
            return [value if type(value) is int else mask_of(value)]
        if isinstance(of, StateType):
            return [[*of.kind].index(value)]
        return [bool(value) if of == BOOL else value]

    def _value(self, of: CType, numbers: Iterator[Any]) -> Any:
        if isinstance(of, ArrayType):
            return [self._value(of.of, numbers) for _ in range(of.length)]
        if isinstance(of, OptionalType):
            has, value = next(numbers), self._value(of.of, numbers)
            return value if has else None
        if isinstance(of, TupleType):
            parts = [self._value(each, numbers) for _, each in of.members]
            return tuple(parts) if of.kind is None else of.kind(*parts)
        number = next(numbers)
        return [*of.kind][number] if isinstance(of, StateType) else number
