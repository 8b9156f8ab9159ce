"""Powers of integers with a known exponent. They are computed as products, each of which is checked."""

from __future__ import annotations

import ast

from umo.generate.c_types import BOOL, INT
from umo.generate.form import ONE, CheckedArithmetic, Value
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Known, Term
from umo.generate.translation import ControllerLimit

MOST_POWER = 64


def is_whole_power(sign: ast.AST, base: Code, power: Term) -> bool:
    """True if this power is an int in Python."""
    known = isinstance(sign, ast.Pow) and isinstance(power, Known) and type(power.value) in (int, bool)
    return known and base.type in (INT, BOOL) and 0 <= power.value <= MOST_POWER  # type: ignore[union-attr,operator]


def whole_power(f: FunctionBuilder, base: Code, power: int, node: ast.AST) -> Code:
    """Return the power. Raises ControllerLimit if it exceeds 32 bits. No intermediate product exceeds the power."""
    if not power:
        return Code(INT, ONE)
    number = f.values.kept(Code(INT, f.values.as_type(base, INT, node)))
    result = number.value
    for bit in f"{power:b}"[1:]:
        result = _product(f, result, result, node)
        if bit == "1":
            result = _product(f, result, number.value, node)
    return Code(INT, result)


def _product(f: FunctionBuilder, one: Value, other: Value, node: ast.AST) -> Value:
    result = f.temporary(INT, "n")
    f.add(CheckedArithmetic("mul", result, one, other, f.fault(ControllerLimit, node)))
    return result
