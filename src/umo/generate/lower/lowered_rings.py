"""Deques of numbers with a `maxlen`. In C a deque is an object with a list of that length, and a count.

The deque itself is known when the code is generated, like a part of the machine, and it stays the same object under all
its names. Its elements are stored in order, beginning at the first place. If a new element does not fit, an element is
removed at the other end, and the remaining ones are moved. Unused places are 0."""

from __future__ import annotations

import ast
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from umo.generate.c_types import BOOL, INT, REAL, CType, MixedNumber, list_of
from umo.generate.form import (
    ONE,
    ZERO,
    Assign,
    Conditional,
    CountedLoop,
    Element,
    Field,
    If,
    Literal,
    Operator,
    Statement,
    Value,
    differs,
)
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Known, RingMethod, Selection, Term, Turns

MOST_ELEMENTS = 4096
METHODS = "append", "appendleft", "pop", "popleft", "clear", "extend", "rotate", "maxlen"
TAKES = {"append": 1, "appendleft": 1, "extend": 1, "rotate": 1}
"""The number of arguments of each method. Methods that are not listed have none."""


class DequeFields:
    """A deque as its fields in C."""

    __slots__ = ("held", "zero")

    def __init__(self, held: deque[Any]) -> None:
        self.held = held
        self.zero: float = 0
        """The value of unused places, of the class of the elements."""

    @property
    def at(self) -> list[Any]:
        """The elements, with `zero` in unused places."""
        return [*self.held, *[self.zero] * ((self.held.maxlen or 0) - len(self.held))]

    @property
    def count(self) -> int:
        return len(self.held)


ZEROS: Mapping[CType, float] = {REAL: 0.0, INT: 0, BOOL: False}


@dataclass(frozen=True)
class RingPlace:
    """The place of the elements of a deque, and their number."""

    ring: DequeFields
    at: Field
    count: Field
    of: CType
    length: int


class LoweredRings(LoweredSubject):
    """The deques of a function."""

    def of(self, term: Term, node: ast.AST) -> RingPlace:
        """Return a deque as its fields."""
        assert isinstance(term, Known)
        memory, length = self.f.world.memory, term.value.maxlen
        if length is None or not 0 < length <= MOST_ELEMENTS:
            raise self.f.refused(node, "the deque has no `maxlen`", f"deque(maxlen=n), at most {MOST_ELEMENTS} numbers")
        ring = memory.rings.setdefault(id(term.value), DequeFields(term.value))
        for each in term.value:
            self._learn(ring, self.f.world.fields.type_of_value(each), node)
        of = memory.fields.get((id(ring), "of")) or INT
        ring.zero = ZEROS[of]
        for name in ("at", "count"):
            memory.assign(ring, name)
        fields = self.f.world.fields
        path = fields.known(ring, term.name or "deque").path
        at, count = fields.field(ring, "at", list_of(of, length), path), fields.field(ring, "count", INT, path)
        return RingPlace(ring, at, count, of, length)

    def _learn(self, ring: DequeFields, of: CType | None, node: ast.AST) -> CType:
        """Return the type of the elements after one of this type."""
        if of not in (REAL, INT, BOOL):
            raise self.f.refused(node, "the deque has elements other than Python numbers", "float(...), int(...)")
        memory = self.f.world.memory
        found = memory.learn(memory.fields, (id(ring), "of"), of, lambda: None)
        if isinstance(found, MixedNumber):
            raise self.f.refused(
                node, "the deque has elements of several classes", "one class for all elements, float(...)"
            )
        return found

    def count(self, term: Term, node: ast.AST) -> Code:
        """Return `len` of a deque."""
        return Code(INT, self.of(term, node).count)

    def turns(self, term: Term, node: ast.AST) -> Turns:
        """Return the turns of a loop over a deque."""
        ring = self.of(term, node)

        def find_at(at: Value) -> Term:
            return Code(ring.of, Element(ring.at, at))

        until = self.f.values.copied(Code(INT, ring.count)).value
        return Turns(ring.length, lambda n: find_at(Literal(n, INT)), find_at, (ring.at,), until)

    @contextmanager
    def held(self, turns: Turns, node: ast.AST) -> Iterator[None]:
        """Return a context for a loop over a deque. In the loop the deque must not be changed, because Python raises an
        error there."""
        before, self.f.aliases.changes = self.f.aliases.changes, set()
        yield
        changed = self.f.aliases.changes
        self.f.aliases.changes = before | changed
        if turns.until is not None and any(each in changed for each in turns.arrays):
            raise self.f.refused(node, "the loop changes the deque that it iterates over", "range(len(...))")

    def element(self, term: Term, index: Term, node: ast.AST) -> Code:
        """Return an element. Raises IndexError beyond the ends."""
        ring = self.of(term, node)
        count = self.f.values.copied(Code(INT, ring.count)).value
        return Code(ring.of, Element(ring.at, self._place(index, count, node)))

    def element_among(self, chosen: Selection, index: Term, node: ast.AST) -> Code:
        """Return an element of a list that conditions have selected. Raises IndexError beyond the ends."""
        return Code(chosen.of.of, Element(chosen.at, self._place(index, chosen.count, node)))

    def _place(self, index: Term, count: Value, node: ast.AST) -> Value:
        code = self.f.values.number(index, node)
        if code.type != INT:
            raise self.f.refused(node, "an index into a deque must be an integer")
        place = self.f.values.kept(code).value
        from_end, is_below = Operator("+", place, count), Operator("<", place, ZERO)
        below = Operator("&&", is_below, Operator("<", from_end, ZERO))
        self.f.raises(IndexError, node, Operator("||", Operator(">=", place, count), below))
        return Conditional(is_below, from_end, place)

    def set_element(self, term: Term, index: Term, value: Term, node: ast.AST) -> None:
        place = self.element(term, index, node)
        self.f.assign(place.value, self._taken(self.of(term, node), value, node))

    def _taken(self, ring: RingPlace, value: Term, node: ast.AST) -> Value:
        """Return a value as an element."""
        found = self._learn(ring.ring, self.f.values.type_of(value), node)
        if found != ring.of:
            return ZERO  # in the next pass it is known
        return self.f.values.kept(Code(found, self.f.values.as_type(value, found, node))).value

    # Methods -------------------------------------------------------------------------------------------

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term:
        if name == "maxlen":
            return Known(base.value.maxlen)
        if name not in METHODS:
            raise self.f.refused(node, f"`{name}` of a deque cannot be translated", ", ".join(METHODS))
        return Known(RingMethod(base, name))

    def call(self, method: RingMethod, given: Sequence[Term], node: ast.AST) -> Term:
        name, ring = method.name, self.of(method.base, node)
        if len(given) != TAKES.get(name, 0):
            raise self.f.refused(
                node, f"`{name}` of a deque cannot be called with {len(given)} arguments", f"{TAKES.get(name, 0)}"
            )
        self.f.aliases.changes.add(ring.at)
        if name == "append":
            self._append(ring, self._taken(ring, given[0], node))
        elif name == "appendleft":
            self._append_left(ring, self._taken(ring, given[0], node))
        elif name == "extend":
            for each in [self._taken(ring, one, node) for one in self.f.calls.parts(given[0], node)]:
                self._append(ring, each)
        elif name == "rotate":
            self._rotate(ring, given[0], node)
        elif name == "clear":
            self._clear(ring)
        else:
            return self._pop(ring, name == "popleft", node)
        return Known(None)

    def _append(self, ring: RingPlace, value: Value) -> None:
        last = Literal(ring.length - 1, INT)
        full = self._moved(ring, ZERO, last, 1), Assign(Element(ring.at, last), value)
        grown = Assign(Element(ring.at, ring.count), value), Assign(ring.count, Operator("+", ring.count, ONE))
        self.f.add(If(Operator("<", ring.count, Literal(ring.length, INT)), grown, full))

    def _append_left(self, ring: RingPlace, value: Value) -> None:
        grown = Assign(ring.count, Operator("+", ring.count, ONE))
        self.f.add(If(Operator("<", ring.count, Literal(ring.length, INT)), (grown,)))
        self.f.add(self._moved(ring, Operator("-", ring.count, ONE), ZERO, -1))
        self.f.assign(Element(ring.at, ZERO), value)

    def _moved(self, ring: RingPlace, first: Value, end: Value, step: int) -> Statement:
        """Move elements: from the first place to the last one, each gets the value of the next place."""
        turn = self.f.temporary(INT, "k")
        beside = Operator("+" if step > 0 else "-", turn, ONE)
        body = (Assign(Element(ring.at, turn), Element(ring.at, beside), line=self.f.line),)
        return CountedLoop(self.f.label("turn"), turn, first, end, step, body)

    def _pop(self, ring: RingPlace, is_left: bool, node: ast.AST) -> Code:
        self.f.raises(IndexError, node, Operator("==", ring.count, ZERO))
        last = Operator("-", ring.count, ONE)
        found = self.f.values.copied(Code(ring.of, Element(ring.at, ZERO if is_left else last)))
        if is_left:
            self.f.add(self._moved(ring, ZERO, last, 1))
        self.f.assign(ring.count, last)
        self.f.assign(Element(ring.at, ring.count), Literal(0, ring.of))
        return found

    def _clear(self, ring: RingPlace) -> None:
        turn = self.f.temporary(INT, "k")
        body = (Assign(Element(ring.at, turn), Literal(0, ring.of), line=self.f.line),)
        self.f.add(CountedLoop(self.f.label("turn"), turn, ZERO, Literal(ring.length, INT), 1, body))
        self.f.assign(ring.count, ZERO)

    def _rotate(self, ring: RingPlace, steps: Term, node: ast.AST) -> None:
        if not (isinstance(steps, Known) and steps.value in (1, -1)):
            raise self.f.refused(node, "`rotate` is called with a number other than 1 or -1", "a loop with rotate(1)")
        last, kept = Operator("-", ring.count, ONE), self.f.temporary(ring.of)
        first, end = (last, ZERO) if steps.value == 1 else (ZERO, last)
        taken, given = Assign(kept, Element(ring.at, first)), Assign(Element(ring.at, end), kept)
        self.f.add(If(differs(ring.count), (taken, self._moved(ring, first, end, -steps.value), given)))
