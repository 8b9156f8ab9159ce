"""Keeps the elements of deques equal in Python and in the memory of compiled laws.

A deque must stay the same object, and its memory cannot be replaced. So its elements are copied: into the library
before laws and conditions run, if the deque was changed; into the deque after each law, if the law changed them."""

from __future__ import annotations

from operator import is_
from typing import Any

from umo.generate.lower.lowered_rings import DequeFields
from umo.generate.struct_memory import WRONG, StructMemory, ValueDoesNotFit, require


class BoundDeque:
    """One deque, and its fields in the memory of a compiled library."""

    def __init__(self, memory: StructMemory, fields: DequeFields) -> None:
        self._memory, self._fields, self._held = memory, fields, fields.held
        self._elements: list[Any] = []
        """The elements of the deque when deque and library were last equal."""
        self._content = b""
        """The content of the library's memory at the same time."""

    def bind(self) -> None:
        """Copy the elements of the deque to the library. Raise ValueDoesNotFit if a field cannot hold them."""
        try:
            require(self._memory.fields["at"], self._fields.at)  # a number of numpy is none of Python
            self._memory.push()
        except WRONG:
            raise ValueDoesNotFit(f"the deque {self._memory.label} has an element of another class") from None
        self._note()

    def push(self) -> None:
        """Copy the elements to the library if the deque has changed since the last copy."""
        held, before = self._held, self._elements
        if len(held) != len(before) or not all(map(is_, held, before)):
            self.bind()

    def pull(self) -> None:
        """Copy the elements from the library to the deque."""
        if self._memory.content() == self._content:
            return
        elements = self._memory.read("at")[: self._memory.read("count")]
        self._held.clear()
        self._held.extend(elements)
        self._note()

    def _note(self) -> None:
        self._elements, self._content = list(self._held), self._memory.content()
