"""Tables that are known, with a place or a key that is computed: tuples and lists of numbers, states or tuples of
these, and dicts by members of one Enum or by whole numbers."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from enum import Enum
from typing import Any

from umo.generate.c_types import BOOL, INT, CType, StateType, TupleType, is_number
from umo.generate.function_scope import FunctionScope
from umo.generate.terms import Code, Term
from umo.generate.value_kinds import is_container, is_plain_enum

MOST_ENTRIES = 256


def is_table(value: Any) -> bool:
    return isinstance(value, tuple | list) and is_container(value) and 0 < len(value) <= MOST_ENTRIES


def is_dict(value: Any) -> bool:
    return type(value) is dict and 0 < len(value) <= MOST_ENTRIES


def element_of(scope: FunctionScope, table: Sequence[Any], index: Term, node: ast.AST) -> Code:
    """IndexError beyond its ends."""
    scope.world.memory.place_known(table)
    of = _type_of_all(scope, table, node)
    return _chosen(
        scope, [_initial(scope, each, of, node) for each in table], of, _place(scope, index, len(table), node)
    )


def element_of_terms(scope: FunctionScope, terms: Sequence[Term], index: Term, node: ast.AST) -> Code:
    """An element of a tuple whose values are computed; they have one type."""
    codes = [scope.code(each, node) for each in terms]
    of = codes[0].type
    if any(each.type != of for each in codes) or not (is_number(of) or isinstance(of, StateType)):
        raise scope.refused(node, "an element of a tuple whose values are not of one class", "one class for all")
    at = _place(scope, index, len(codes), node)
    return _chosen(scope, [each.text for each in codes], of, at, "")


def _place(scope: FunctionScope, index: Term, length: int, node: ast.AST) -> str:
    code = scope.number(index, node)
    if code.type not in (INT, BOOL):
        raise scope.refused(node, "a place in a table is a whole number")
    place = scope.kept(Code(INT, scope.as_type(code, INT, node)))
    scope.raises(IndexError, node, f"{place.text} < -{length} || {place.text} >= {length}")
    return f"{place.text} < 0 ? {place.text} + {length} : {place.text}"


def value_of(scope: FunctionScope, table: dict[Any, Any], key: Term, node: ast.AST) -> Code:
    """KeyError where it has no such key."""
    scope.world.memory.place_known(table)
    of = _type_of_all(scope, list(table.values()), node)
    code = _key(scope, table, key, node)
    place = scope.temporary(INT, "n")
    scope.line(f"{place} = -1;", pure=True)
    for number, each in enumerate(table):
        scope.line(f"if ({code.text} == {scope.literal(each, code.type, node)})", pure=True)
        scope.line(f"    {place} = {number};", pure=True)
    scope.raises(KeyError, node, f"{place} < 0")
    return _chosen(scope, [_initial(scope, each, of, node) for each in table.values()], of, place)


def value_of_each(scope: FunctionScope, values: Sequence[Any], place: str, node: ast.AST) -> Code:
    """The value at a place that there is."""
    of = _type_of_all(scope, values, node)
    return _chosen(scope, [_initial(scope, each, of, node) for each in values], of, place)


def _key(scope: FunctionScope, table: dict[Any, Any], key: Term, node: ast.AST) -> Code:
    """A key that is computed, of the class that all keys have."""
    code, kinds = scope.present(scope.code(key, node), node), {type(each) for each in table}
    (kind, *others) = kinds
    if not others and isinstance(code.type, StateType) and code.type.kind is kind:
        return scope.kept(code)
    if not others and kind is int and code.type in (INT, BOOL):
        return scope.kept(Code(INT, scope.as_type(code, INT, node)))
    raise scope.refused(node, "the key of a dict that is not of the class of all its keys", "members of one Enum, int")


def _type_of_all(scope: FunctionScope, values: Sequence[Any], node: ast.AST) -> CType:
    """The type of all values: they are of one class, so that nothing is converted."""
    types = {scope.world.fields.type_of_value(each) for each in values}
    first = next(iter(types))
    kinds = {type(each) for each in values}
    good = first is not None and (is_number(first) or isinstance(first, StateType | TupleType))
    if len(types) != 1 or len(kinds) != 1 or not good or not all(map(_is_plain, values)):
        told = "a table whose values are not numbers, states or tuples of one class"
        raise scope.refused(node, told, "0.0 in the place of 0, one class for all")
    assert first is not None
    return first


def _is_plain(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_plain, value))
    return type(value) in (bool, int, float) or (isinstance(value, Enum) and is_plain_enum(type(value)))


def _initial(scope: FunctionScope, value: Any, of: CType, node: ast.AST) -> str:
    if isinstance(of, TupleType):
        parts = (_initial(scope, each, kind, node) for each, (_, kind) in zip(value, of.members, strict=True))
        return f"{{{', '.join(parts)}}}"
    return scope.literal(value, of, node)


def _chosen(scope: FunctionScope, values: Sequence[str], of: CType, place: str, kind: str = "static const ") -> Code:
    """One of the values, under a name of its own."""
    table = scope.label("table")
    scope.line(f"{kind}{of.name} {table}[{len(values)}] = {{{', '.join(values)}}};", pure=True)
    found = scope.temporary(of)
    scope.line(f"{found} = {table}[{place}];", pure=True)
    return Code(of, found, stable=True)
