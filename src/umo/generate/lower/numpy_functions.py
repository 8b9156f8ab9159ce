"""Functions of numpy that are not simple loops: functions of numbers, and joined arrays."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any

import numpy as np

from umo.generate.c_types import BOOL, INT, REAL, array, is_number, numpy_number, plain, plain_number
from umo.generate.form import (
    ONE,
    ZERO,
    Assign,
    Conditional,
    Element,
    Literal,
    Operator,
    Runtime,
    Value,
    joined,
    negated,
    placed,
)
from umo.generate.lower.array_functions import BINARY, OF_ELEMENTS
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import Code, Elementwise, Known, Term, TupleTerm


def of_numbers(f: FunctionBuilder, target: Any, arguments: Sequence[Term], node: ast.Call) -> Code | None:
    """Return the result of an element-wise function of Python numbers, computed as for an array of one element. Return
    None for other functions."""
    if not (target in OF_ELEMENTS or target in BINARY or target is np.clip) or not all(map(_is_number, arguments)):
        return None
    f.expressions.check_sure(arguments, node)
    first = f.values.kept(f.arrays.array(arguments[0], node))
    one = Elementwise(array(first.type, 1), first.value)
    found = f.arrays.of_numpy(target, [one, *arguments[1:]], {}, node)
    if not isinstance(found, Code):
        return None
    value = found.value if isinstance(found, Elementwise) else Element(found.value, ZERO)
    return f.values.kept(Code(numpy_number(f.arrays.of(found)), placed(value, ZERO)))


def _is_number(term: Term) -> bool:
    if isinstance(term, Known):
        return type(term.value) in (bool, int, float)
    return isinstance(term, Code) and is_number(plain_number(plain(term.type)))


def sign_of(value: Value) -> Value:
    """Return `np.sign`: NaN for NaN, 0 for both zeros."""
    below, above = Operator("<", value, ZERO), Operator(">", value, ZERO)
    zero = Conditional(Operator("==", value, ZERO), ZERO, value)
    return Conditional(above, ONE, Conditional(below, Literal(-1, INT), zero))


def one_after_the_other(f: FunctionBuilder, parts: Sequence[Term], node: ast.AST) -> Code:
    """Return a new array with the elements of these arrays in order."""
    codes = [
        f.arrays.array(f.arrays.listed(each, node) if isinstance(each, TupleTerm) else each, node) for each in parts
    ]
    kinds = {f.arrays.of(each) for each in codes}
    if not all(map(f.arrays.is_array, codes)) or len(kinds) > 1:
        raise f.refused(node, "arrays with different types of numbers are joined", "arrays of one class")
    (of,) = kinds
    lengths = [f.arrays.length_of(each, node) for each in codes]
    result, at = f.temporary(array(of, sum(lengths))), 0
    for each, length in zip(codes, lengths, strict=True):
        with f.arrays.each_place(length) as turn:
            place = Operator("+", turn, Literal(at, INT)) if at else turn
            f.assign(Element(result, place), placed(f.arrays.at(each, of, length), turn))
        at += length
    f.aliases.sole.add(result)
    return Code(array(of, sum(lengths)), result)


def rolled(f: FunctionBuilder, term: Term, by: Term, node: ast.AST) -> Code:
    """Return `np.roll` by a known number of places."""
    if not (isinstance(by, Known) and type(by.value) is int):
        raise f.refused(node, "`np.roll` moves by an unknown number", "np.roll(x, 1)")
    code = f.arrays.array(term, node)
    first = by.value % f.arrays.length_of(code, node)
    parts = [slice(-first, None), slice(None, -first)] if first else [slice(None)]
    return one_after_the_other(f, [f.arrays.sliced(code, each, node) for each in parts], node)


def place_of(f: FunctionBuilder, target: Any, term: Term, node: ast.AST) -> Code:
    """Return `np.argmin` or `np.argmax`: the first index of the extreme, or of a NaN."""
    code = f.arrays.array(term, node)
    of, length = f.arrays.of(code), f.arrays.length_of(code, node)
    if of == BOOL:
        raise f.refused(node, "the index of a minimum or maximum of bools cannot be translated", "a loop")
    code = Code(code.type, f.arrays.kept_place(code))
    found = f.temporary(INT, "place")
    f.assign(found, ZERO)
    with f.arrays.each_place(length) as turn:
        each, best = Element(code.value, turn), Element(code.value, found)
        test: Value = Operator("<" if target is np.argmin else ">", each, best)
        if of == REAL:
            is_nan, was_nan = (Runtime("umo_is_nan", (one,)) for one in (each, best))
            test = joined("&&", [negated(was_nan), Operator("||", is_nan, test)])
        f.add_if(test, Assign(found, turn))
    return Code(numpy_number(INT), found)
