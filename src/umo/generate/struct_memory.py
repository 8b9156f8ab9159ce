"""Reads and writes the fields of a compiled machine from Python, in the memory that its C uses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from ctypes import POINTER, Structure, addressof, c_bool, c_double, c_float, c_int32, c_uint8, c_uint32, cast
from dataclasses import is_dataclass
from operator import is_
from typing import Any

import numpy as np

from umo.cycle.conversion import extension
from umo.generate.c_types import (
    BOOL,
    INT,
    MASK,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    plain,
    plain_number,
)
from umo.generate.lower.live_fields import LiveStruct, mask_of
from umo.generate.value_kinds import parts_of

PLAIN = {REAL: "d", INT: "i", BOOL: "?"}
"""Formats of numbers in memory, as in the module struct. A real is a double."""

CHANGEABLE = set, np.ndarray
"""Types, other than lists, whose values are changed in place."""
WRONG = (TypeError, ValueError, KeyError, OverflowError, AttributeError, IndexError)
"""Errors for a value that a field cannot hold."""
EXACT = 2**53
"""Integers up to this one are exact as reals."""


class ValueDoesNotFit(ValueError):
    """Raised if a live object has a value with which C would compute a different result than Python."""


def require(of: CType, value: Any) -> None:
    """Raise TypeError or ValueError for a value with which C would compute a different result than Python: a number of
    another class, a number that a real cannot represent, or an array of another length."""
    kind = type(value)
    if isinstance(of, MixedNumber):
        wrong = kind not in (int, float, *((bool,) if of.is_bool else ())) or (kind is int and abs(value) > EXACT)
    elif isinstance(of, NumpyNumber):
        require(of.of, value.item() if isinstance(value, np.generic) else value)
        return
    elif of == REAL:
        wrong = kind is not float
    elif of == INT:
        wrong = kind is not int or not -(2**31) <= value < 2**31
    elif of == BOOL:
        wrong = kind is not bool
    elif isinstance(of, TextType):
        wrong = kind is not str or value not in of.kind
    elif isinstance(of, StateType):
        wrong = kind is not of.kind
    elif isinstance(of, TupleType):
        parts = parts_of(value) if kind is (of.kind or tuple) else ()
        wrong = len(parts) != len(of.members)
        for (_, each), part in zip(of.members, () if wrong else parts, strict=not wrong):
            require(each, part)
    elif isinstance(of, ArrayType):
        wrong = not _is_array(of, value)
        for each in value if of.listed and not wrong else ():
            require(of.of, each)
    else:
        wrong = False
        if isinstance(of, OptionalType) and value is not None:
            require(of.of, value)
    if wrong:
        raise TypeError(f"{value!r:.60} is not of this type")


def _of_numpy(of: CType, value: Any) -> Any:
    """Return a number or an array as one of numpy, if the type is one."""
    if isinstance(of, NumpyNumber):
        return np.asarray(value)[()]
    return np.array(value) if isinstance(of, ArrayType) and not of.listed else value


def _listed(values: Any) -> list[Any] | None:
    """Return the numbers of an array as Python numbers, or None."""
    return values if values is None else [each.item() if isinstance(each, np.generic) else each for each in values]


def _is_array(of: ArrayType, value: Any) -> bool:
    """True if this is a list or an array of this length. The elements of a list are not checked."""
    if of.listed:
        return type(value) is list and len(value) == of.length
    if type(value) is not np.ndarray or value.shape not in ((of.length,), (1 if of.loose else of.length,)):
        return False
    if of.of == INT:
        return value.dtype.kind == "i" and bool((value == value.astype(np.int32)).all())
    return bool(value.dtype == (np.float64 if of.of == REAL else np.bool_))


def _own(value: Any) -> Any:
    """Return a number, or those of a list, as Python numbers. Laws in Python may have numpy numbers, which the
    comparison takes into account."""
    if isinstance(value, np.generic):
        return value.item()
    return _listed(value) if isinstance(value, list) else value


class StructMemory:
    """One struct. Its fields are read as Python values: a state as a member of its Enum, None as None."""

    def __init__(self, struct: LiveStruct, address: int, real: str = "double", keep: Any = None) -> None:
        """`keep`: the object that must live as long as a numpy array in this memory."""
        self._struct = struct
        self._types: dict[Any, Any] = {
            INT: c_int32,
            BOOL: c_bool,
            MASK: c_uint32,
            REAL: c_double if real == "double" else c_float,
        }
        fields = [(_member(name), self._type(of)) for name, of in struct.fields.items()]
        kind = type(f"Machine_{struct.member}", (Structure,), {"_fields_": fields})
        self._memory: Any = cast(address, POINTER(kind)).contents
        self._memory.keep = keep
        places = {name: getattr(kind, _member(name)) for name in struct.fields}
        self._slices = {name: slice(place.offset, place.offset + place.size) for name, place in places.items()}
        self._pushed: dict[str, Any] = {}
        """The values that `push` has written, as the live object had them."""
        self._before = b""
        """The memory after `push`."""

    @property
    def fields(self) -> Mapping[str, CType]:
        return self._struct.fields

    @property
    def path(self) -> str:
        return self._struct.path

    @property
    def label(self) -> str:
        """The name of the object in messages."""
        return self._struct.path or type(self._struct.owner).__name__

    @property
    def mixed(self) -> list[str]:
        """The fields whose values have different classes in Python at different times."""
        return [name for name, of in self._struct.kinds.items() if isinstance(plain(of), MixedNumber)]

    def check(self, name: str, value: Any) -> None:
        """Raise ValueDoesNotFit if the live object may not have this value."""
        try:
            require(self._struct.kinds[name], value)
        except WRONG:
            is_whole = type(value) is int and plain(self._struct.kinds[name]) == REAL
            near = f", where the laws have a real number; {float(value)!r}" if is_whole else ""
            raise ValueDoesNotFit(f"{self.label}.{name} is set to {value!r:.60}{near}") from None

    def _bytes(self, name: str) -> Any:
        return memoryview(self._memory).cast("B")[self._slices[name]]

    def content(self) -> bytes:
        """Return a copy of all bytes."""
        return bytes(self._memory)

    def view(self, name: str, kind: Any) -> Any:
        """Return the memory of a field with one number, as a memoryview with this format."""
        return self._bytes(name).cast(kind)

    def array(self, name: str, of: ArrayType) -> Any:
        """Return the memory of an array field as a numpy array."""
        return np.frombuffer(self._bytes(name), {REAL: np.float64, INT: np.int32, BOOL: np.bool_}[of.of])

    def attribute(self, name: str, put: Any) -> Any:
        """Return a descriptor in C that reads and sets this field of the live object. `put(owner, value)` sets values
        that are not plain. Return None if the type or the extension has no such descriptor."""
        at = addressof(self._memory) + self._slices[name].start
        return self._attribute(self._struct.fields[name], at, put)

    def _attribute(self, of: CType, at: int, put: Any) -> Any:
        if not hasattr(extension, "Field"):
            return None
        if of in PLAIN:
            return extension.Field(PLAIN[of], at, None, None, put)
        if isinstance(of, StateType):
            return extension.Field("s", at, (*of.kind,), None, put)
        if isinstance(of, OptionalType):
            inner = self._attribute(of.of, at + self._type(of).value.offset, put)
            return None if inner is None else extension.Field("o", at, None, (inner,), put)
        if not isinstance(of, TupleType) or is_dataclass(of.kind):
            return None
        offsets = [getattr(self._type(of), name).offset for name, _ in of.members]
        parts = [self._attribute(each, at + way, put) for way, (_, each) in zip(offsets, of.members, strict=True)]
        return None if None in parts else extension.Field("t", at, of.kind, (*parts,), put)

    def element(self, name: str, number: int) -> Any:
        of = self._struct.fields[name]
        assert isinstance(of, ArrayType)
        return self._value(of.of, getattr(self._memory, _member(name))[number])

    def read(self, name: str) -> Any:
        return self._value(self._struct.fields[name], getattr(self._memory, _member(name)))

    def write(self, name: str, value: Any) -> None:
        of = self._struct.fields[name]
        self._set(of, self._memory, _member(name), value)

    def at(self, address: int, of: CType) -> Any:
        """Return a value of this type, at another address of the library's memory, as a Python value."""
        place = type("Place", (Structure,), {"_fields_": [("value", self._type(plain_number(of)))]})
        return _of_numpy(of, self._value(plain_number(of), place.from_address(address).value))  # type: ignore[attr-defined]

    def push(self) -> None:
        """Copy the values of the live object to the fields. Unchanged values are not written again. Raises
        ValueDoesNotFit if a value does not fit."""
        there = bytes(self._memory)
        for name in self._struct.fields:
            value = getattr(self._struct.owner, name)
            if not self._is_kept(name, value, there):
                self.check(name, _own(value))
                self.write(name, value)
                self._pushed[name] = [*value] if isinstance(value, list) else value
        self._before = bytes(self._memory)

    def forget(self) -> None:
        """Forget the values that were pushed, so that no reference to them remains."""
        self._pushed.clear()

    def _is_kept(self, name: str, value: Any, memory: bytes) -> bool:
        """True if neither the live object nor the memory has changed since `push`."""
        place = self._slices[name]
        return self._is_pushed(name, value) and memory[place] == self._before[place]

    def _is_pushed(self, name: str, value: Any) -> bool:
        before = self._pushed.get(name, self)
        if isinstance(value, list) and isinstance(before, list):
            return len(value) == len(before) and all(map(is_, value, before))
        return value is before and not isinstance(value, CHANGEABLE)

    def differences(self) -> Iterator[str]:
        """Return the fields that differ from the live object."""
        after = bytes(self._memory)
        for name, of in self._struct.fields.items():
            there = getattr(self._struct.owner, name)
            if self._is_kept(name, there, after):
                continue
            here = self.read(name)
            if here.__class__ is float and here == there and here != 0.0:
                continue  # nearly always
            if of == MASK:
                there = mask_of(there)
            elif isinstance(of, ArrayType) or isinstance(there, np.ndarray):
                here, there = _listed(here), _listed(there)
                if isinstance(of, ArrayType) and of.loose and there is not None and len(there) == 1:
                    there = there * of.length  # one element is taken for each
            elif of == REAL:
                there = float(there)
            if repr(here) != repr(there) and not (
                isinstance(of, TupleType) and repr(parts_of(here)) == repr(parts_of(there))
            ):
                yield f"{self.label}.{name}: Python has {_told(there)}, C has {_told(here)}"

    def _type(self, of: CType) -> Any:
        if isinstance(of, ArrayType):
            return self._type(of.of) * of.length
        if isinstance(of, StateType):
            return c_uint8
        if isinstance(of, OptionalType):
            return self._made(of.name, [("has", c_bool), ("value", self._type(of.of))])
        if isinstance(of, TupleType):
            return self._made(of.name, [(name, self._type(each)) for name, each in of.members])
        return self._types[of]

    def _made(self, name: str, fields: Sequence[tuple[str, Any]]) -> Any:
        if name not in self._types:
            self._types[name] = type(name, (Structure,), {"_fields_": list(fields)})
        return self._types[name]

    def _value(self, of: CType, raw: Any) -> Any:
        if isinstance(of, ArrayType):
            return [self._value(of.of, each) for each in raw]
        if isinstance(of, StateType):
            return [*of.kind][raw]
        if isinstance(of, OptionalType):
            return self._value(of.of, raw.value) if raw.has else None
        if isinstance(of, TupleType):
            parts = [self._value(each, getattr(raw, name)) for name, each in of.members]
            return tuple(parts) if of.kind is None else of.kind(*parts)
        return raw

    def _set(self, of: CType, owner: Any, name: str, value: Any) -> None:
        if isinstance(of, ArrayType):
            for number, each in enumerate(list(value) * (of.length // len(value))):
                self._set_element(of.of, getattr(owner, name), number, each)
        elif isinstance(of, TupleType):
            for (member, each), part in zip(of.members, parts_of(value), strict=True):
                self._set(each, getattr(owner, name), member, part)
        elif isinstance(of, OptionalType):
            place = getattr(owner, name)
            place.has = value is not None
            if value is not None:
                self._set(of.of, place, "value", value)
        else:
            setattr(owner, name, self._raw(of, value))

    def _set_element(self, of: CType, array: Any, number: int, value: Any) -> None:
        if isinstance(of, TupleType):
            for (member, each), part in zip(of.members, parts_of(value), strict=True):
                self._set(each, array[number], member, part)
        else:
            array[number] = self._raw(of, value)

    def _raw(self, of: CType, value: Any) -> Any:
        if of == MASK:
            return value if isinstance(value, int) and not hasattr(value, "name") else mask_of(value)
        if isinstance(of, StateType):
            return [*of.kind].index(value)
        return value


def _told(value: Any) -> str:
    """Return a value, and the class of a number, for a message."""
    return f"{value!r} of {type(value).__name__}" if isinstance(value, int | float | np.generic) else repr(value)


def _member(name: str) -> str:
    """Return the name of a field in ctypes, which reserves some names."""
    return f"of {name}"
