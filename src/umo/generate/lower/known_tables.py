"""Known tables with a computed index or key: tuples and lists of numbers, states or tuples of these, and dicts whose
keys are members of one Enum or integers."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from enum import Enum
from typing import Any

from umo.generate.c_types import BOOL, INT, CType, OptionalType, StateType, TextType, TupleType, is_number, optional
from umo.generate.form import ZERO, Assign, Choose, Literal, Operator, TupleOf, Value, has, inside
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Known, Term
from umo.generate.value_kinds import is_container, is_plain_enum, own_methods

MOST_ENTRIES = 256
OF_OBJECTS = (
    "the object is chosen at run time",
    "for n, each in enumerate(...): if n == place: ...",
)
"""The reason why a choice of one of several objects cannot be translated."""


def is_table(value: Any) -> bool:
    return isinstance(value, tuple | list) and is_container(value) and 0 < len(value) <= MOST_ENTRIES


def is_dict(value: Any) -> bool:
    return type(value) is dict and 0 < len(value) <= MOST_ENTRIES


def element_of(f: FunctionBuilder, table: Sequence[Any], index: Term, node: ast.AST) -> Code:
    """Return the element at an index. Raises IndexError beyond the ends."""
    return value_of_each(f, table, element_place(f, table, index, node), node)


def element_place(f: FunctionBuilder, table: Sequence[Any], index: Term, node: ast.AST) -> Value:
    """Return an index as an index into the table. Raises IndexError beyond the ends."""
    f.world.memory.place_known(table)
    return _place(f, index, len(table), node)


def element_of_terms(f: FunctionBuilder, terms: Sequence[Term], index: Term, node: ast.AST) -> Code:
    """Return an element of a tuple of computed values that all have the same type."""
    codes = [f.values.code(each, node) for each in terms]
    of = codes[0].type
    if any(each.type != of for each in codes) or not (is_number(of) or isinstance(of, StateType)):
        raise f.refused(node, "the tuple has values of several classes", "one class for all elements")
    at = _place(f, index, len(codes), node)
    return _chosen(f, [each.value for each in codes], of, at)


def _place(f: FunctionBuilder, index: Term, length: int, node: ast.AST) -> Value:
    code = f.values.number(index, node)
    if code.type not in (INT, BOOL):
        raise f.refused(node, "an index into a table must be an integer")
    return f.expressions.place_in(Code(INT, f.values.as_type(code, INT, node)), length, node)


def value_of(f: FunctionBuilder, table: dict[Any, Any], key: Term, node: ast.AST) -> Code:
    """Return the value of a key. Raises KeyError if the table has no such key."""
    return value_of_each(f, list(table.values()), key_place(f, table, key, node), node)


def key_place(f: FunctionBuilder, table: dict[Any, Any], key: Term, node: ast.AST) -> Value:
    """Return the number of a key. Raises KeyError if the table has no such key."""
    place = _place_of_key(f, table, key, node)
    f.raises(KeyError, node, Operator("<", place, ZERO))
    return place


def member_of(f: FunctionBuilder, kind: type[Enum], value: Term, node: ast.AST) -> Term:
    """Return the member of an Enum with this value. Raises ValueError if there is none."""
    if "_missing_" in own_methods(kind, ("_missing_",)) or not is_plain_enum(kind):
        raise f.refused(node, f"{kind.__name__} defines the member for a value itself", "a dict of its members")
    if isinstance(value, Code) and isinstance(value.type, StateType) and value.type.kind is kind:
        return value
    table = {each.value: each for each in kind}
    place = _place_of_key(f, table, value, node)
    f.raises(ValueError, node, Operator("<", place, ZERO))
    return value_of_each(f, list(table.values()), place, node)


def of_dict(f: FunctionBuilder, method: Known, given: Sequence[Term], node: ast.AST) -> Term | None:
    """Return the result of `get`, `keys`, `values` or `items` of a known dict, or None for other methods."""
    table, name = method.owner, method.name
    if name == "get" and len(given) in (1, 2):
        key, default = (*given, Known(None))[:2]
        f.texts.check_decided(key, node)
        if isinstance(key, Known):
            f.world.memory.place_known(table)
            return Known(table[key.value]) if key.value in table else default
        return _value_or(f, table, key, default, node) if is_dict(table) else None
    if name in ("keys", "values", "items") and not given:
        f.world.memory.place_known(table)
        return Known(tuple(getattr(table, name)()))
    return None


def _value_or(f: FunctionBuilder, table: dict[Any, Any], key: Term, default: Term, node: ast.AST) -> Code:
    of = _type_of_all(f, list(table.values()), node)
    none = isinstance(default, Known) and default.value is None
    if not none and f.values.code(default, node).type != of:
        raise f.refused(node, "the default is not of the class of the dict's values", "0.0 instead of 0")
    wanted = optional(of) if none else of
    place = _place_of_key(f, table, key, node)
    found = f.temporary(wanted)
    f.assign(found, f.values.as_type(default, wanted, node))
    with f.gathered() as there:
        f.assign(found, f.values.as_type(value_of_each(f, list(table.values()), place, node), wanted, node))
    f.add_if(Operator(">=", place, ZERO), *there)
    return Code(wanted, found)


def _place_of_key(f: FunctionBuilder, table: dict[Any, Any], key: Term, node: ast.AST) -> Value:
    """Return the number of a key, or -1."""
    f.world.memory.place_known(table)
    given = f.values.kept(f.values.code(key, node))
    is_there = given.type if isinstance(given.type, OptionalType) else None
    code = _key(f, table, Code(is_there.of, inside(given.value)) if is_there else given, node)
    place = f.temporary(INT, "n")
    f.assign(place, Literal(-1, INT))
    for number, each in enumerate(table):
        is_key: Value = Operator("==", code.value, f.values.literal(each, code.type, node))
        is_key = Operator("&&", has(given.value), is_key) if is_there else is_key
        f.add_if(is_key, Assign(place, Literal(number, INT)))
    return place


def value_of_each(f: FunctionBuilder, values: Sequence[Any], place: Value, node: ast.AST) -> Code:
    """Return the value at an index that is within the table."""
    of = _type_of_all(f, values, node)
    return _chosen(f, [_initial(f, each, of, node) for each in values], of, place)


def _key(f: FunctionBuilder, table: dict[Any, Any], code: Code, node: ast.AST) -> Code:
    """Return a computed key, of the class of all keys."""
    kinds = {type(each) for each in table}
    (kind, *others) = kinds
    if not others and isinstance(code.type, StateType) and code.type.kind is kind:
        return code
    if not others and kind is str and isinstance(code.type, TextType):
        return Code(f.world.memory.text_type(*table), code.value)
    if not others and kind is int and code.type in (INT, BOOL):
        return Code(INT, f.values.as_type(code, INT, node))
    raise f.refused(node, "the key is not of the class of the dict's keys", "members of one Enum, int")


def _type_of_all(f: FunctionBuilder, values: Sequence[Any], node: ast.AST) -> CType:
    """Return the type of all values. They are of one class, so that nothing is converted."""
    types = {f.world.fields.type_of_value(each) for each in values}
    first = next(iter(types))
    kinds = {type(each) for each in values}
    good = first is not None and (is_number(first) or isinstance(first, StateType | TupleType))
    if len(types) != 1 or len(kinds) != 1 or not good or not all(map(_is_plain, values)):
        if any(hasattr(each, "__dict__") and not isinstance(each, Enum) for each in values):
            raise f.refused(node, *OF_OBJECTS)
        told = "a table whose values are not numbers, states or tuples of one class"
        raise f.refused(node, told, "0.0 instead of 0, one class for all elements")
    assert first is not None
    return first


def _is_plain(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_plain, value))
    return type(value) in (bool, int, float) or (isinstance(value, Enum) and is_plain_enum(type(value)))


def _initial(f: FunctionBuilder, value: Any, of: CType, node: ast.AST) -> Value:
    if isinstance(of, TupleType):
        parts = (_initial(f, each, kind, node) for each, (_, kind) in zip(value, of.members, strict=True))
        return TupleOf(of, tuple(parts))
    return f.values.literal(value, of, node)


def _chosen(f: FunctionBuilder, values: Sequence[Value], of: CType, place: Value) -> Code:
    """Return one of the values, stored under a separate name."""
    found = f.temporary(of)
    f.add(Choose(found, f.label("table"), of, tuple(values), place))
    return Code(of, found)
