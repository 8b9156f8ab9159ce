"""Deques of live objects whose elements compiled laws have, too: both have the same whenever one of them is asked.

A deque stays the object that it is, and cannot be told where its elements are. So they are copied: into the library
before the laws and conditions, where somebody has changed the deque; into the deque after each law, where it has
changed them.
"""

from __future__ import annotations

from operator import is_
from typing import Any

from umo.generate.lower.lowered_rings import DequeFields
from umo.generate.struct_memory import WRONG, StructMemory, Unfitting, require


class BoundDeque:
    """One deque, and its fields in the memory of a compiled library."""

    def __init__(self, memory: StructMemory, fields: DequeFields) -> None:
        self._memory, self._fields, self._held = memory, fields, fields.held
        self._elements: list[Any] = []
        """Those that both have."""
        self._content = b""
        """The memory with these."""

    def bind(self) -> None:
        """The library has the elements of the deque. Unfitting if it cannot have them."""
        try:
            require(self._memory.fields["at"], self._fields.at)  # a number of numpy is none of Python
            self._memory.push()
        except WRONG:
            raise Unfitting(f"the deque {self._memory.label} has an element of another class") from None
        self._note()

    def push(self) -> None:
        """The same, where the deque has other elements than before."""
        held, before = self._held, self._elements
        if len(held) != len(before) or not all(map(is_, held, before)):
            self.bind()

    def pull(self) -> None:
        """The deque has the elements of the library."""
        if self._memory.content() == self._content:
            return
        elements = self._memory.read("at")[: self._memory.read("count")]
        self._held.clear()
        self._held.extend(elements)
        self._note()

    def _note(self) -> None:
        self._elements, self._content = list(self._held), self._memory.content()
