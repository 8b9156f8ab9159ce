"""Moves a temporary that is read once to the place where it is read, if nothing in between changes its operands."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import Any

from umo.generate.check.form_effects import changes_machine, read_values, reads_machine, written
from umo.generate.form import (
    Address,
    Assign,
    CountedLoop,
    Element,
    Elements,
    EndlessLoop,
    Field,
    FormNode,
    FunctionForm,
    Literal,
    Local,
    Member,
    Operator,
    Statement,
    Statements,
    Temporary,
    Value,
    is_place,
    rebuilt,
    walk,
    with_bodies,
)

ARITHMETIC = "+-*/"


def forwarded(function: FunctionForm) -> FunctionForm:
    """Return the function with temporaries that are read once moved to where they are read."""
    count = Counter(each for each in walk(*function.body) if isinstance(each, Temporary))
    once = {each for each, number in count.items() if number == 2}  # assigned, and read
    return replace(function, body=_body(function.body, once))


def _body(body: Statements, once: set[Temporary]) -> Statements:
    found = [with_bodies(each, lambda inner: _body(inner, once)) for each in body]
    for place in range(len(found) - 1, -1, -1):
        one = found[place]
        if isinstance(one, Assign) and isinstance(one.place, Temporary) and one.place in once:
            reader = _reader(one.place, one.value, found[place + 1 :])
            if reader is not None:
                at = place + 1 + reader
                found[at] = rebuilt(found[at], partial(_put, one))
                del found[place]
    return tuple(found)


def _put(one: Assign, each: Any) -> Any:
    return one.value if each == one.place else each


def _reader(temporary: Temporary, value: Value, rest: list[Statement]) -> int | None:
    """Return the index of the statement that reads the temporary, or None if the value cannot be computed there."""
    made_of = {each for each in walk(value) if isinstance(each, Local | Temporary | Field)}
    for number, each in enumerate(rest):
        if any(temporary in one.mentioned for one in read_values(each)):
            may = not isinstance(each, EndlessLoop | CountedLoop) and _fits(temporary, value, each)
            return number if may else None
        if not written(each).isdisjoint(made_of) or (reads_machine(value) and changes_machine(each)):
            return None
    return None


def _fits(temporary: Temporary, value: Value, reader: FormNode) -> bool:
    """Return True if the value can replace the temporary where it is read. If a part of the temporary is read, the
    value must be a place. Some comparisons are excluded, because compilers warn if they can compute the result."""
    for each in walk(reader):
        if temporary in each.children:
            if isinstance(each, Address):
                return False
            if isinstance(each, Operator) and each.sign not in ARITHMETIC:
                other = each.right if each.left == temporary else each.left
                is_number = isinstance(value, Operator) and value.sign in ARITHMETIC
                return other != value and (is_number or (is_place(value) and not isinstance(other, Literal)))
            if isinstance(each, Member | Elements) or (isinstance(each, Element) and each.whole == temporary):
                return is_place(value)
    return True
