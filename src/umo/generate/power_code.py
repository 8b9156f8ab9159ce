"""Powers of whole numbers whose exponent is known: products, each of which is checked."""

from __future__ import annotations

import ast

from umo.generate.c_types import BOOL, INT
from umo.generate.function_scope import FunctionScope
from umo.generate.terms import Code, Known, Term
from umo.generate.translation import ControllerLimit

MOST_POWER = 64


def is_whole_power(sign: ast.AST, base: Code, power: Term) -> bool:
    """Whether this is a power that is a whole number of Python."""
    known = isinstance(sign, ast.Pow) and isinstance(power, Known) and type(power.value) in (int, bool)
    return known and base.type in (INT, BOOL) and 0 <= power.value <= MOST_POWER  # type: ignore[union-attr]


def whole_power(scope: FunctionScope, base: Code, power: int, node: ast.AST) -> Code:
    """ControllerLimit beyond 32 bits: no product on the way is larger than the power itself."""
    if not power:
        return Code(INT, "1", stable=True)
    number = scope.kept(Code(INT, scope.as_type(base, INT, node)))
    result = number.text
    for bit in f"{power:b}"[1:]:
        result = _product(scope, result, result, node)
        if bit == "1":
            result = _product(scope, result, number.text, node)
    return Code(INT, result, stable=True)


def _product(scope: FunctionScope, one: str, other: str, node: ast.AST) -> str:
    result = scope.temporary(INT, "n")
    scope.raises(ControllerLimit, node, f"__builtin_mul_overflow({one}, {other}, &{result})")
    return result
