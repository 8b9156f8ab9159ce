"""The type of the message `machine`: nested like the tree of the machine, states as enums. Similar parts have one type.
All messages have the same bytes except their numbers, so numpy can fill all messages of a second in one operation."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from google.protobuf import descriptor_pb2 as pb

from umo.objects.presentation.described import Described
from umo.objects.presentation.value_text import span
from umo.process.frames.layout import Layout

PACKAGE, ROOT = "umo", "Machine"
MAX_ENUM = 126
"""Largest number of a state that fits in one byte. A value whose states have larger numbers is a plain number."""
UNKNOWN = 127
"""The name of the state of an object that was never read."""
FIXED64, VARINT, BYTES = 1, 0, 2
"""Wire types of protobuf."""


@dataclass
class Leaf:
    """A number of the machine: a column of a frame, and its index in the column."""

    column: str
    place: int
    states: Mapping[int, str] = field(default_factory=dict)
    """Names of the states by number; empty for a plain number."""
    about: str = ""
    """Unit and range, as text."""
    at: int = 0
    """Offset of the number in a message."""


@dataclass
class _Part:
    names: dict[str, Leaf | _Part] = field(default_factory=dict)


def leaves_of(layout: Layout) -> list[tuple[str, Leaf]]:
    """Return the numbers of a machine by path, in the order of a frame's columns."""
    objects, signals, _ = layout.described
    found = [(each.path, _leaf("values", place, each)) for place, each in enumerate(objects)]
    found += [(each.path, _leaf("signals", place, each)) for place, each in enumerate(signals)]
    for column, entries in (("equipment", layout.equipment), ("axes", layout.axes)):
        for place, each in enumerate(map(Described, entries)):
            found.append((f"{each.path}.{column}_state", _leaf(column, place, each)))
    return found


def _leaf(column: str, place: int, value: Described) -> Leaf:
    if value.states:
        small = all(0 <= number <= MAX_ENUM for number in value.states)
        return Leaf(column, place, value.states if small else {})
    return Leaf(column, place, {}, ", ".join(filter(None, [value.unit, span(value.minimum, value.maximum)])))


@dataclass(frozen=True, eq=False)
class EvenRun:
    """Numbers of one kind at even distances, both in a frame and in a message, so that numpy copies them in one
    operation."""

    column: str
    places: slice
    states: Mapping[int, str]
    count: int
    at: int
    """Offset of the first number in a message."""
    step: int
    """Number of bytes from one number to the next."""


def _runs(leaves: Sequence[tuple[str, Leaf]]) -> list[EvenRun]:
    alike: dict[tuple[object, ...], list[Leaf]] = {}
    for path, leaf in leaves:
        key = leaf.column, re.sub(r"\d+", "*", path), tuple(leaf.states.items())
        alike.setdefault(key, []).append(leaf)
    return [_run(part) for each in alike.values() for part in _even(each)]


def _even(leaves: Sequence[Leaf]) -> Iterator[list[Leaf]]:
    """Yield the leaves in groups, so that the leaves of each group lie at even distances."""
    part: list[Leaf] = []
    for leaf in leaves:
        far = len(part) > 1 and (leaf.place - part[-1].place, leaf.at - part[-1].at) != (
            part[1].place - part[0].place,
            part[1].at - part[0].at,
        )
        if far or (len(part) == 1 and leaf.place <= part[0].place):
            yield part
            part = []
        part.append(leaf)
    yield part


def _run(part: Sequence[Leaf]) -> EvenRun:
    first, last = part[0], part[-1]
    step, bytes_ = (part[1].place - first.place, part[1].at - first.at) if len(part) > 1 else (1, 1)
    return EvenRun(first.column, slice(first.place, last.place + 1, step), first.states, len(part), first.at, bytes_)


class MessageTree:
    """The descriptor of the message, its bytes with all numbers 0, and the place of each number in it."""

    def __init__(self, leaves: Sequence[tuple[str, Leaf]]) -> None:
        self._file = pb.FileDescriptorProto(name="machine.proto", package=PACKAGE, syntax="proto3")
        self._types: dict[str, str] = {}
        root = _Part()
        for path, leaf in leaves:
            _insert(root, path.split("."), leaf)
        self._declare(root, ROOT, is_root=True)
        self.template = self._fill(root, 0)
        self.runs = _runs(leaves)

    @property
    def descriptor(self) -> bytes:
        """The set of files that MCAP requires as a schema."""
        return bytes(pb.FileDescriptorSet(file=[self._file]).SerializeToString())

    def _declare(self, part: _Part, name: str, is_root: bool = False) -> str:
        """Declare the type of a part, and return its name. Parts with the same content share the type of the first of
        them."""
        message = pb.DescriptorProto()
        for number, (field_name, each) in enumerate(part.names.items(), 1):
            message.field.append(self._field(name, number, field_name, each))
        key = message.SerializeToString().hex()
        if key not in self._types:
            self._types[key] = ROOT if is_root else _free(name, [ROOT, *self._types.values()])
            message.name = self._types[key]
            self._file.message_type.append(message)
        return self._types[key]

    def _field(self, parent: str, number: int, name: str, each: Leaf | _Part) -> Any:
        made = pb.FieldDescriptorProto(name=name, number=number, label=1)
        if isinstance(each, _Part):
            made.type, made.type_name = 11, f".{PACKAGE}.{self._declare(each, _type_name(name, parent))}"
        elif each.states:
            made.type, made.type_name = 14, f".{PACKAGE}.{self._enum(name, each.states)}"
        else:
            made.type = 1
        return made

    def _enum(self, name: str, states: Mapping[int, str]) -> str:
        """Declare the enum of some states, and return its name. It lies within a separate message, so that the names of
        its states cannot collide with other names."""
        names: dict[int, str] = {}
        for number, text in states.items():
            names[number] = _free(_name(text), names.values())
        names.setdefault(0, _free("NONE", names.values()))
        names[UNKNOWN] = _free("UNKNOWN", names.values())
        values = [pb.EnumValueDescriptorProto(name=names[number], number=number) for number in sorted(names)]
        enum = pb.EnumDescriptorProto(name="State", value=values)
        key = "enum " + enum.SerializeToString().hex()
        if key not in self._types:
            self._types[key] = _free(_type_name(name, "") + "States", [ROOT, *self._types.values()])
            self._file.message_type.append(pb.DescriptorProto(name=self._types[key], enum_type=[enum]))
        return f"{self._types[key]}.State"

    def _fill(self, part: _Part, at: int) -> bytes:
        """Return the bytes of a part, which begin at this offset, and store the offset of each of its numbers."""
        data = bytearray()
        for number, each in enumerate(part.names.values(), 1):
            if isinstance(each, _Part):
                size = len(self._fill(each, 0))
                data += _varint(number << 3 | BYTES) + _varint(size)
                data += self._fill(each, at + len(data))
            else:
                data += _varint(number << 3 | (VARINT if each.states else FIXED64))
                each.at = at + len(data)
                data += bytes(1 if each.states else 8)
        return bytes(data)


def _insert(part: _Part, names: Sequence[str], leaf: Leaf) -> None:
    for name in map(_name, names[:-1]):
        child, number = part.names.setdefault(name, _Part()), 1
        while isinstance(child, Leaf):  # a number below a number
            more = f"{name}_parts" if number == 1 else f"{name}_parts_{number}"
            child, number = part.names.setdefault(more, _Part()), number + 1
        part = child
    part.names[_free(_name(names[-1]), part.names)] = leaf


def _name(text: str) -> str:
    """Return a text as a name that protobuf accepts."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII) or "_"
    return f"_{name}" if name[0].isdigit() else name


def _type_name(name: str, parent: str) -> str:
    """Return the name of the type of a field. If the field is an entry of a list with a number as its name, the type is
    named after the list."""
    text = name.title().replace("_", "")
    return text if text[:1].isalpha() and text.isascii() else f"{parent}Each"


def _free(name: str, taken: Any) -> str:
    known, number, free = set(taken), 1, name
    while free in known:
        number += 1
        free = f"{name}_{number}"
    return free


def _varint(number: int) -> bytes:
    data = bytearray()
    while number > 127:
        data.append(number & 127 | 128)
        number >>= 7
    return bytes(data) + struct.pack("B", number)
