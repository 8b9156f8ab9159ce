"""Removes code without effect: assignments that nothing reads, empty branches and loops, known conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from umo.generate.c_types import BOOL
from umo.generate.check.form_effects import may_fail, own_values, read_values
from umo.generate.check.forwarding import forwarded
from umo.generate.check.scopes import scoped
from umo.generate.form import (
    Assign,
    CallStatement,
    Choose,
    CountedLoop,
    ErrorHandler,
    Finally,
    FunctionForm,
    If,
    Labelled,
    Literal,
    Local,
    MachineForm,
    ObjectOf,
    Operator,
    SlotTable,
    Statement,
    Statements,
    Temporary,
    Unary,
    Value,
    negated,
    rebuilt,
    root,
    statements,
    walk,
    with_bodies,
)

OPPOSITES = {"==": "!=", "!=": "=="}
"""Comparisons whose opposite is also a comparison, even for NaN."""


def shaped(program: MachineForm, entry: Iterable[str]) -> MachineForm:
    """Return the program without code that has no effect, and without functions that none of the entry functions calls.
    Compilers would warn about both."""
    functions = _called([_shaped(each) for each in program.functions], entry)
    used = list(walk(*functions))
    tables = {each.table for each in used if isinstance(each, ObjectOf)}
    tables |= {each.name for each in used if isinstance(each, SlotTable)}
    caught = {each.kinds for each in used if isinstance(each, ErrorHandler)}
    return replace(
        program,
        functions=functions,
        tables={name: slots for name, slots in program.tables.items() if name in tables},
        handled={kinds: names for kinds, names in program.handled.items() if kinds in caught},
    )


def _called(functions: Sequence[FunctionForm], entry: Iterable[str]) -> list[FunctionForm]:
    """Return the entry functions and the functions that they call, in their order."""
    by_name = {each.name: each for each in functions}
    found, waiting = set[str](), list(entry)
    while waiting:
        name = waiting.pop()
        if name in by_name and name not in found:
            found.add(name)
            waiting += [each.function for each in statements(by_name[name]) if isinstance(each, CallStatement)]
    return [each for each in functions if each.name in found]


def _shaped(function: FunctionForm) -> FunctionForm:
    return scoped(_reduced(forwarded(_reduced(function))))


def _reduced(function: FunctionForm) -> FunctionForm:
    function = rebuilt(function, _simple)
    while (body := tuple(_kept(function.body, _read(function.body)))) != function.body:
        function = replace(function, body=body)
    return function


def _simple(node: Any) -> Any:
    """Return a simpler expression with the same value."""
    if isinstance(node, Operator) and node.sign in OPPOSITES and _never_equal(node.left, node.right):
        return Literal(node.sign == "!=", BOOL)
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


def _never_equal(one: Value, other: Value) -> bool:
    """Return True if one number always has bits that the other number never has. Compilers warn of such a
    comparison."""
    if isinstance(one, Literal):
        one, other = other, one
    if not (isinstance(one, Operator) and isinstance(other, Literal)):
        return False
    masks = [int(each.value) for each in (one.left, one.right) if isinstance(each, Literal)]
    return len(masks) == 1 and (
        (one.sign == "|" and int(other.value) & masks[0] != masks[0])
        or (one.sign == "&" and int(other.value) & ~masks[0] != 0)
    )


# What nothing reads -----------------------------------------------------------------------------------------


def _read(body: Statements) -> set[Value]:
    """Return the variables whose values have an effect: variables that are read by statements other than assignments,
    and variables from which these are computed."""
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
    return (each for each in statements(*body) if isinstance(each, Statement))


def _variables(*values: Value) -> set[Value]:
    return set[Value]().union(*(each.mentioned for each in values))


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
    """Return the statement with simplified bodies."""
    new = with_bodies(each, lambda body: tuple(_kept(body, read)))
    return replace(new, pending=None) if isinstance(new, Finally) and not may_fail(new.body) else new


def _does_nothing(each: Statement, read: set[Value]) -> bool:
    if isinstance(each, Assign | Choose):
        place = root(each.place)
        return isinstance(place, Local | Temporary) and place not in read
    if isinstance(each, If):
        return not each.body and not each.orelse
    return isinstance(each, CountedLoop | Labelled) and not each.body
