"""Bit operators and shifts of whole numbers and bools, as Python's: of two bools `& | ^` give a bool; whole numbers are
in two's complement, of which a controller has 32 bits."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from umo.generate.c_types import BOOL, INT, CType, MixedNumber, may_be_bool, plain
from umo.generate.function_scope import FunctionScope
from umo.generate.terms import Code, Known, Term
from umo.generate.translation import ControllerLimit

OF_BITS: dict[type[ast.AST], str] = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
OF_BOOLS: dict[type[ast.AST], str] = {ast.BitAnd: "&&", ast.BitOr: "||", ast.BitXor: "!="}
SHIFTS = ast.LShift, ast.RShift
KNOWN: dict[type[ast.AST], Callable[..., Any]] = {
    ast.BitAnd: operator.and_, ast.BitOr: operator.or_, ast.BitXor: operator.xor,
    ast.LShift: operator.lshift, ast.RShift: operator.rshift,
}  # fmt: skip
MOST_SHIFT = 64
"""A shift of known numbers at most."""


def is_of_bits(sign: ast.AST) -> bool:
    return type(sign) in KNOWN


def of_known(scope: FunctionScope, sign: ast.operator, numbers: Sequence[Any], node: ast.AST) -> Known:
    """The operator of two known numbers."""
    one, other = numbers
    _check_whole(scope, [Known(one), Known(other)], node)
    if isinstance(sign, SHIFTS):
        if other < 0:
            scope.raises(ValueError, node)
            return Known(0)
        if other > MOST_SHIFT:
            raise scope.refused(node, f"a shift by {other}", f"at most {MOST_SHIFT}")
    return Known(KNOWN[type(sign)](one, other))


def of_bits(
    scope: FunctionScope, sign: ast.operator, terms: tuple[Term, Term], codes: tuple[Code, Code], node: ast.AST
) -> Code:
    """The operator of two numbers of Python."""
    _check_whole(scope, [*terms, *codes], node)
    a, b = codes
    if isinstance(sign, SHIFTS):
        return _shifted(scope, sign, scope.as_type(a, INT, node), scope.as_type(b, INT, node), node)
    if a.type == b.type == BOOL:
        if a.text == b.text:  # compilers warn of a comparison with itself
            a = scope.kept(replace(a, stable=False))
        text = f"(({a.text}) {OF_BOOLS[type(sign)]} ({b.text}))"
        return Code(BOOL, text)
    text = f"(({scope.as_type(a, INT, node)}) {OF_BITS[type(sign)]} ({scope.as_type(b, INT, node)}))"
    return Code(_type_of_two(*terms), text)


def inverted(scope: FunctionScope, term: Term, code: Code, node: ast.AST) -> Code:
    """`~` of a number of Python. It is not C's, which compilers do not take of what is true or false."""
    _check_whole(scope, [term, code], node)
    return Code(INT, f"(-1 - ({scope.as_type(code, INT, node)}))")


def inverted_known(scope: FunctionScope, value: Any, node: ast.AST) -> Known:
    _check_whole(scope, [Known(value)], node)
    return Known(~int(value))


def _shifted(scope: FunctionScope, sign: ast.operator, number: str, places: str, node: ast.AST) -> Code:
    by = scope.kept(Code(INT, places)).text
    scope.raises(ValueError, node, f"{by} < 0")
    if isinstance(sign, ast.RShift):
        return Code(INT, f"umo_shift_right({number}, {by})")
    result = scope.temporary(INT, "n")
    scope.raises(ControllerLimit, node, f"!umo_shift_left({number}, {by}, &{result})")
    return Code(INT, result, stable=True)


def _type_of_two(one: Term, other: Term) -> CType:
    """Whole numbers; a bool, perhaps, where both may be one."""
    is_mixed = any(isinstance(each, Code) and isinstance(plain(each.type), MixedNumber) for each in (one, other))
    if is_mixed and _may_be_bool(one) and _may_be_bool(other):
        return MixedNumber(INT.name, INT, True)
    return INT


def _may_be_bool(term: Term) -> bool:
    if isinstance(term, Known):
        return isinstance(term.value, bool)
    return isinstance(term, Code) and may_be_bool(term.type)


def _check_whole(scope: FunctionScope, terms: list[Term], node: ast.AST) -> None:
    for each in terms:
        if isinstance(each, Known) and not isinstance(each.value, int):
            raise scope.refused(node, "an operator of bits with something else than whole numbers", "int(...)")
        if isinstance(each, Code) and getattr(plain(each.type), "of", plain(each.type)) not in (INT, BOOL):
            raise scope.refused(node, "an operator of bits with something else than whole numbers", "int(...)")
