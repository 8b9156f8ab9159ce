"""Functions of `math` that check what they are given, and `round` to a number of digits."""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Sequence
from typing import Any

from umo.generate.c_types import BOOL, INT, REAL
from umo.generate.expression_code import is_of_numpy
from umo.generate.function_scope import FunctionScope
from umo.generate.terms import Code, Known, Term

HYPOT_OF = ((3, 11), (3, 12), (3, 13))
"""Versions of Python whose `math.hypot` is that of the runtime, to the bit."""
DIGITS = range(23)
"""Digits to which `round` is exact: 10 to their power is a float."""
IN_DEGREES = {math.degrees: repr(180.0 / math.pi), math.radians: repr(math.pi / 180.0)}
OF_MATH = (math.hypot, math.fmod, *IN_DEGREES)


def of_math(scope: FunctionScope, target: Any, arguments: Sequence[Term], node: ast.Call) -> Code | None:
    """One of these functions; None: it is called with another number of arguments."""
    texts = [scope.as_type(scope.number(each, node), REAL, node) for each in arguments]
    if target is math.hypot:
        return _hypot(scope, texts, node)
    if target is math.fmod and len(texts) == 2:
        a, b = (scope.kept(Code(REAL, each)).text for each in texts)
        wrong = f"(!umo_is_finite({a}) && !umo_is_nan({a}) && !umo_is_nan({b})) || ({b} == 0 && !umo_is_nan({a}))"
        scope.raises(ValueError, node, wrong)
        return Code(REAL, f"umo_fmod({a}, {b})")
    if target in IN_DEGREES and len(texts) == 1:
        return Code(REAL, f"({texts[0]} * (umo_real){IN_DEGREES[target]})")
    return None


def _hypot(scope: FunctionScope, texts: Sequence[str], node: ast.AST) -> Code | None:
    if sys.version_info[:2] not in HYPOT_OF:
        tried = ", ".join(f"{one}.{two}" for one, two in HYPOT_OF)
        raise scope.refused(node, f"hypot is known of Python {tried} only", "math.sqrt(x * x + y * y)")
    if not texts:
        return None
    return scope.kept(Code(REAL, f"umo_hypot((const umo_real[]){{{', '.join(texts)}}}, {len(texts)})"))


def rounded(scope: FunctionScope, one: Term, digits: Term, node: ast.Call) -> Term:
    """`round(x, digits)`: the float that is nearest to the decimal number that is nearest to x."""
    if not (isinstance(digits, Known) and type(digits.value) is int and digits.value in DIGITS):
        raise scope.refused(node, "`round` to a number of digits that is not known, or not 0 to 22", "round(x, 2)")
    if isinstance(one, Known) and type(one.value) in (bool, int, float):
        return Known(round(one.value, digits.value))
    if is_of_numpy(one):
        raise scope.refused(node, "numpy rounds to a number of digits in another way", "round(float(x), 2)")
    scope.check_sure([one], node)  # type: ignore[attr-defined]
    code = scope.number(one, node)
    if code.type in (INT, BOOL):
        return Code(INT, scope.as_type(code, INT, node))
    return Code(REAL, f"umo_round_to({code.text}, (umo_real)1e{digits.value})")
