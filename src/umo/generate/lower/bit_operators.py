"""Bit operators and shifts of integers and bools, with the same results as in Python. `& | ^` of two bools give a bool.
Integers are in two's complement, with 32 bits on a controller."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Sequence
from typing import Any

from umo.generate.c_types import BOOL, INT, CType, MixedNumber, NumpyNumber, may_be_bool, plain
from umo.generate.form import ZERO, CheckedArithmetic, Literal, Operator, Runtime, Value, negated
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Known, Term
from umo.generate.translation import ControllerLimit

OF_BITS: dict[type[ast.AST], str] = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
OF_BOOLS: dict[type[ast.AST], str] = {ast.BitAnd: "&&", ast.BitOr: "||", ast.BitXor: "!="}
SHIFTS = ast.LShift, ast.RShift
KNOWN: dict[type[ast.AST], Callable[..., Any]] = {
    ast.BitAnd: operator.and_, ast.BitOr: operator.or_, ast.BitXor: operator.xor,
    ast.LShift: operator.lshift, ast.RShift: operator.rshift,
}  # fmt: skip
MOST_SHIFT = 64
"""The largest shift of known numbers."""


def is_of_bits(sign: ast.AST) -> bool:
    return type(sign) in KNOWN


def of_known(f: FunctionBuilder, sign: ast.operator, numbers: Sequence[Any], node: ast.AST) -> Known:
    """Return the result of an operator on two known numbers."""
    one, other = numbers
    _check_whole(f, [Known(one), Known(other)], node)
    if isinstance(sign, SHIFTS):
        if other < 0:
            f.raises(ValueError, node)
            return Known(0)
        if other > MOST_SHIFT:
            raise f.refused(node, f"a shift by {other} cannot be translated", f"at most {MOST_SHIFT}")
    return Known(KNOWN[type(sign)](one, other))


def of_bits(
    f: FunctionBuilder, sign: ast.operator, terms: tuple[Term, Term], codes: tuple[Code, Code], node: ast.AST
) -> Code:
    """Return the result of an operator on two Python numbers."""
    _check_whole(f, [*terms, *codes], node)
    a, b = codes
    if isinstance(sign, SHIFTS):
        return _shifted(f, sign, f.values.as_type(a, INT, node), f.values.as_type(b, INT, node), node)
    if a.type == b.type == BOOL:
        if a.value == b.value:  # compilers warn of a comparison with itself
            a = f.values.copied(a)
        return Code(BOOL, Operator(OF_BOOLS[type(sign)], a.value, b.value))
    operands = f.values.as_type(a, INT, node), f.values.as_type(b, INT, node)
    return Code(_type_of_two(*terms), Operator(OF_BITS[type(sign)], *operands))


def inverted(f: FunctionBuilder, term: Term, code: Code, node: ast.AST) -> Code:
    """Return `~` of a number. C's `~` is not used, because compilers warn of it on truth values. For a numpy bool the
    result is `not`, for a Python bool it is a number."""
    _check_whole(f, [term, code], node)
    of = plain(term.type) if isinstance(term, Code) else None
    if isinstance(of, NumpyNumber) and code.type == BOOL:
        if not of.sure:
            raise f.refused(node, "~ of a bool that may be a numpy bool is not the same in C", "not")
        return Code(of, negated(code.value))
    return Code(INT, Operator("-", Literal(-1, INT), f.values.as_type(code, INT, node)))


def inverted_known(f: FunctionBuilder, value: Any, node: ast.AST) -> Known:
    _check_whole(f, [Known(value)], node)
    return Known(~int(value))


def _shifted(f: FunctionBuilder, sign: ast.operator, number: Value, places: Value, node: ast.AST) -> Code:
    by = f.values.kept(Code(INT, places)).value
    f.raises(ValueError, node, Operator("<", by, ZERO))
    if isinstance(sign, ast.RShift):
        return Code(INT, Runtime("umo_shift_right", (number, by)))
    result = f.temporary(INT, "n")
    f.add(CheckedArithmetic("shift_left", result, number, by, f.fault(ControllerLimit, node)))
    return Code(INT, result)


def _type_of_two(one: Term, other: Term) -> CType:
    """Return the type of the result: integer, or maybe bool if both operands may be bools."""
    is_mixed = any(isinstance(each, Code) and isinstance(plain(each.type), MixedNumber) for each in (one, other))
    if is_mixed and _may_be_bool(one) and _may_be_bool(other):
        return MixedNumber(INT.name, INT, True)
    return INT


def _may_be_bool(term: Term) -> bool:
    if isinstance(term, Known):
        return isinstance(term.value, bool)
    return isinstance(term, Code) and may_be_bool(term.type)


def _check_whole(f: FunctionBuilder, terms: list[Term], node: ast.AST) -> None:
    for each in terms:
        if isinstance(each, Known) and not isinstance(each.value, int):
            raise f.refused(node, "a bit operator is applied to something other than integers", "int(...)")
        if isinstance(each, Code) and getattr(plain(each.type), "of", plain(each.type)) not in (INT, BOOL):
            raise f.refused(node, "a bit operator is applied to something other than integers", "int(...)")
