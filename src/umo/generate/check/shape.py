"""What has no effect is left out: assignments that nothing reads, empty branches and loops, known conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from umo.generate.check.form_effects import may_fail, own_values, read_values
from umo.generate.check.forwarding import forwarded
from umo.generate.check.scopes import scoped
from umo.generate.form import (
    Assign,
    Choose,
    CountedLoop,
    Finally,
    FunctionForm,
    If,
    Labelled,
    Literal,
    Local,
    MachineForm,
    Operator,
    Statement,
    Statements,
    Temporary,
    Unary,
    Value,
    negated,
    rebuilt,
    root,
    walk,
    with_bodies,
)

OPPOSITES = {"==": "!=", "!=": "=="}
"""Comparisons whose opposite is one too, also of NaN."""


def shaped(program: MachineForm) -> MachineForm:
    """The same program without what has no effect."""
    return replace(program, functions=[_shaped(each) for each in program.functions])


def _shaped(function: FunctionForm) -> FunctionForm:
    function = rebuilt(function, _simple)
    while (body := tuple(_kept(function.body, _read(function.body)))) != function.body:
        function = replace(function, body=body)
    return scoped(forwarded(function))


def _simple(node: Any) -> Any:
    """The same value in fewer words."""
    if not (isinstance(node, Unary) and node.sign == "!"):
        return node
    inner = node.operand
    if isinstance(inner, Unary) and inner.sign == "!":
        return inner.operand
    if isinstance(inner, Literal):
        return Literal(not inner.value, inner.of)
    if isinstance(inner, Operator) and inner.sign in OPPOSITES:
        return Operator(OPPOSITES[inner.sign], inner.left, inner.right)
    return node


# What nothing reads -----------------------------------------------------------------------------------------


def _read(body: Statements) -> set[Value]:
    """The variables whose values matter: those that something else than an assignment reads, and those that they are
    computed from."""
    found: set[Value] = set()
    sources: dict[Value, set[Value]] = {}
    for each in _statements(body):
        if isinstance(each, Assign | Choose) and isinstance(root(each.place), Local | Temporary):
            sources.setdefault(root(each.place), set()).update(_variables(*read_values(each)))
        else:
            found.update(_variables(*own_values(each)))
    new = found
    while new:
        new = {source for each in new for source in sources.get(each, ())} - found
        found |= new
    return found


def _statements(body: Iterable[Statement]) -> Iterator[Statement]:
    return (each for each in walk(*body) if isinstance(each, Statement))


def _variables(*values: Value) -> set[Value]:
    return {each for each in walk(*values) if isinstance(each, Local | Temporary)}


def _kept(body: Statements, read: set[Value]) -> Iterator[Statement]:
    for each in body:
        new = _smaller(each, read)
        if isinstance(new, If) and isinstance(new.test, Literal):
            yield from new.body if new.test.value else new.orelse
        elif isinstance(new, If) and not new.body and new.orelse:
            yield replace(new, test=_simple(negated(new.test)), body=new.orelse, orelse=())
        elif isinstance(new, Finally) and new.pending is None and new.returning is None:
            yield from (*new.body, *new.last)
        elif not _does_nothing(new, read):
            yield new


def _smaller(each: Statement, read: set[Value]) -> Statement:
    """The same, with smaller bodies."""
    new = with_bodies(each, lambda body: tuple(_kept(body, read)))
    return replace(new, pending=None) if isinstance(new, Finally) and not may_fail(new.body) else new


def _does_nothing(each: Statement, read: set[Value]) -> bool:
    if isinstance(each, Assign | Choose):
        place = root(each.place)
        return isinstance(place, Local | Temporary) and place not in read
    if isinstance(each, If):
        return not each.body and not each.orelse
    return isinstance(each, CountedLoop | Labelled) and not each.body
