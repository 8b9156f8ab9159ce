"""Attributes of a member of an Enum that is chosen at run time: its value, its order, its methods."""

from __future__ import annotations

import ast
import inspect
from dataclasses import dataclass
from enum import Enum, IntEnum
from types import FunctionType
from typing import Any

import numpy as np

from umo.generate.c_types import StateType, is_number, plain, plain_number
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.known_tables import value_of_each
from umo.generate.lower.terms import Code, Known, Term
from umo.generate.value_kinds import own_methods

ORDER = "__lt__", "__le__", "__gt__", "__ge__"
OPERATORS = "add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "and", "or", "xor", "lshift", "rshift"
ARITHMETIC = (
    *(f"__{name}__" for name in ("neg", "pos", "invert", "abs", "int", "index", "float", "round", "trunc", *OPERATORS)),
    *(f"__r{name}__" for name in OPERATORS),
)


@dataclass(frozen=True)
class StateMethod:
    """A method of a member."""

    function: FunctionType
    member: Term


def value_of_state(f: FunctionBuilder, code: Code, node: ast.AST) -> Code:
    """Return `.value` of a state, if the values of all members are numbers of the same class."""
    assert isinstance(code.type, StateType)
    return value_of_each(f, [each.value for each in code.type.kind], code.value, node)


def has_own_value(kind: type[Enum]) -> bool:
    """True if a class defines its own `value`."""
    return inspect.getattr_static(kind, "value") is not inspect.getattr_static(Enum, "value")


def number_of(f: FunctionBuilder, term: Term, node: ast.AST) -> Term | None:
    """Return a number, or a member of an IntEnum as its number; None for other terms."""
    if isinstance(term, Known):
        if isinstance(term.value, IntEnum) and _is_ordered(type(term.value)):
            return Known(int(term.value))
        return term if type(term.value) in (bool, int, float) else None
    if not isinstance(term, Code):
        return None
    if isinstance(term.type, StateType) and _is_ordered(term.type.kind):
        return value_of_state(f, term, node)
    return term if is_number(plain_number(term.type)) else None


def as_number(f: FunctionBuilder, term: Term, node: ast.AST) -> Term:
    """Return a term for arithmetic or an index. A member of an IntEnum becomes its number, a known numpy number becomes
    a value of its type. Other terms are returned unchanged."""
    if isinstance(term, Known) and _is_number(type(term.value)):
        return Known(int(term.value))
    if isinstance(term, Known) and isinstance(term.value, np.generic):
        return f.values.code(term, node)
    if isinstance(term, Code) and isinstance(of := plain(term.type), StateType) and _is_number(of.kind):
        return value_of_state(f, f.values.present(term, node), node)
    return term


def _is_number(kind: Any) -> bool:
    """True if arithmetic of the members is arithmetic of their numbers."""
    if not (isinstance(kind, type) and issubclass(kind, IntEnum)):
        return False
    return not own_methods(kind, ARITHMETIC) and not has_own_value(kind)


def _is_ordered(kind: Any) -> bool:
    """True if the members are ordered by their numbers."""
    return issubclass(kind, IntEnum) and not own_methods(kind, ORDER) and not has_own_value(kind)
