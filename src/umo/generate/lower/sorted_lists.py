"""`sorted` of a known number of numbers. The order is stable as in Python. A NaN is refused."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from umo.generate.c_types import INT, REAL, ArrayType
from umo.generate.form import (
    ONE,
    ZERO,
    CountedLoop,
    Element,
    EndlessLoop,
    Leave,
    Literal,
    Operator,
    Runtime,
    Value,
    joined,
    negated,
)
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Term
from umo.generate.translation import ControllerLimit

MOST_SORTED = 64


def sorted_list(f: FunctionBuilder, terms: Sequence[Term], node: ast.AST) -> Code:
    """Return a new sorted list. Raises ControllerLimit for a NaN, whose place in Python depends on the version."""
    found = f.values.new_list(terms, node) if len(terms) <= MOST_SORTED else None
    if found is None:
        raise f.refused(
            node,
            f"`sorted` is applied to something other than 1 to {MOST_SORTED} numbers of one class",
            "float(...), a loop",
        )
    assert isinstance(found.type, ArrayType)
    result, of = found.value, found.type.of
    turn, at, moved = f.temporary(INT, "i"), f.temporary(INT, "at"), f.temporary(of, "moved")
    with f.body_of() as body:
        f.assign(moved, Element(result, turn))
        if of == REAL:
            f.raises(ControllerLimit, node, Runtime("umo_is_nan", (moved,)), "the order of a NaN may differ in C")
        f.assign(at, turn)
        _move_down(f, result, at, moved)
        f.assign(Element(result, at), moved)
    f.add(CountedLoop(f.label("turn"), turn, ZERO, Literal(len(terms), INT), 1, tuple(body)))
    return found


def _move_down(f: FunctionBuilder, result: Value, at: Value, moved: Value) -> None:
    """Move greater elements up to make room for this one."""
    before, out = Element(result, Operator("-", at, ONE)), f.label("placed")
    with f.body_of() as body:
        f.add_if(negated(joined("&&", [Operator(">", at, ZERO), Operator("<", moved, before)])), Leave(out))
        f.assign(Element(result, at), before)
        f.assign(at, Operator("-", at, ONE))
    f.add(EndlessLoop(out, tuple(body)))
