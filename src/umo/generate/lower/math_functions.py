"""Functions of `math` that check their arguments, and `round` to a number of digits."""

from __future__ import annotations

import ast
import math
from collections.abc import Sequence
from typing import Any

from umo.generate.c_types import BOOL, INT, REAL
from umo.generate.form import ZERO, Literal, Operator, Reals, Runtime, Value, joined, negated
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.lowered_expressions import is_of_numpy
from umo.generate.lower.terms import Code, Known, Term

DIGITS = range(23)
"""The numbers of digits n for which `round` is exact, because 10**n is exact as a float."""
IN_DEGREES = {math.degrees: 180.0 / math.pi, math.radians: math.pi / 180.0}
OF_MATH = (math.hypot, math.fmod, *IN_DEGREES)


def of_math(f: FunctionBuilder, target: Any, arguments: Sequence[Term], node: ast.Call) -> Code | None:
    """Return the result of one of these functions, or None for another number of arguments."""
    values = [f.values.as_type(f.values.number(each, node), REAL, node) for each in arguments]
    if target is math.hypot:
        return _hypot(f, values, node)
    if target is math.fmod and len(values) == 2:
        a, b = (f.values.kept(Code(REAL, each)).value for each in values)
        number, other = (negated(Runtime("umo_is_nan", (each,))) for each in (a, b))
        infinite = joined("&&", [negated(Runtime("umo_is_finite", (a,))), number, other])
        f.raises(ValueError, node, Operator("||", infinite, Operator("&&", Operator("==", b, ZERO), number)))
        return Code(REAL, Runtime("umo_fmod", (a, b)))
    if target in IN_DEGREES and len(values) == 1:
        return Code(REAL, Operator("*", values[0], Literal(IN_DEGREES[target], REAL)))
    return None


def _hypot(f: FunctionBuilder, values: Sequence[Value], node: ast.AST) -> Code | None:
    if not values:
        return None
    return f.values.kept(Code(REAL, Runtime("umo_hypot", (Reals(tuple(values)), Literal(len(values), INT)))))


def rounded(f: FunctionBuilder, one: Term, digits: Term, node: ast.Call) -> Term:
    """Return `round(x, digits)`: the float nearest to the decimal number that is nearest to x."""
    if not (isinstance(digits, Known) and type(digits.value) is int and digits.value in DIGITS):
        raise f.refused(node, "`round` has an unknown number of digits, or a number outside 0 to 22", "round(x, 2)")
    if isinstance(one, Known) and type(one.value) in (bool, int, float):
        return Known(round(one.value, digits.value))
    if is_of_numpy(one):
        raise f.refused(node, "numpy rounds to a number of digits differently", "round(float(x), 2)")
    f.expressions.check_sure([one], node)
    code = f.values.number(one, node)
    if code.type in (INT, BOOL):
        return Code(INT, f.values.as_type(code, INT, node))
    return Code(REAL, Runtime("umo_round_to", (code.value, Literal(10.0**digits.value, REAL))))
