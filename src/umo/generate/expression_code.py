"""Expressions of Python as C: what they compute, in the order in which Python computes it."""

from __future__ import annotations

import ast
import inspect
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any

from umo.generate.bit_operators import inverted, inverted_known, is_of_bits, of_bits, of_known
from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    StateType,
    TupleType,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.function_scope import FunctionScope
from umo.generate.function_source import ABSENT
from umo.generate.known_tables import element_of, element_of_terms, is_dict, is_table, value_of
from umo.generate.power_code import MOST_POWER, is_whole_power, whole_power
from umo.generate.state_members import StateMethod, has_own_value, value_of_state
from umo.generate.terms import TEXT, Code, Elements, Known, Many, Term
from umo.generate.translation import ControllerLimit
from umo.generate.value_kinds import is_container

FOLDED: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.Pow: operator.pow,
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le,
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.UAdd: operator.pos, ast.USub: operator.neg,
}  # fmt: skip
SIGNS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip
CHECKED: dict[type[ast.AST], str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
NUMBERS = (bool, int, float)
CONSTANTS = (*NUMBERS, str, type(None))


class ExpressionCode(FunctionScope):
    """The part of a function that is expressions."""

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term:
        raise NotImplementedError

    def call(self, node: ast.Call) -> Term:
        raise NotImplementedError

    def check_told(self, nodes: Sequence[ast.AST]) -> None:
        raise NotImplementedError

    def is_array(self, term: Term) -> bool:
        raise NotImplementedError

    def of_arrays(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Code:
        raise NotImplementedError

    def check_length(self, of: ArrayType, node: ast.AST) -> None:
        raise NotImplementedError

    def of_array(self, sign: ast.unaryop, term: Term, node: ast.AST) -> Code:
        raise NotImplementedError

    def compared_arrays(self, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code:
        raise NotImplementedError

    def attribute_of_array(self, code: Code, name: str, node: ast.AST) -> Term:
        raise NotImplementedError

    def term(self, node: ast.AST) -> Term:
        """What an expression is; lines that it needs are written."""
        method = getattr(self, f"_{type(node).__name__}", None)
        if method is None:
            raise self.refused(
                node, "this does not translate", "numbers, states, comparisons, arithmetic, calls of functions"
            )
        found: Term = method(node)
        return found

    def ordered(self, nodes: Sequence[ast.AST]) -> list[Term]:
        """Several expressions, each computed after those before it."""
        terms: list[Term] = []
        for each in nodes:
            at, before = len(self.lines), self.impure
            new = self.term(each)
            if self.impure != before:  # what was computed before may change: it is kept under a name
                rest, self.lines = self.lines[at:], self.lines[:at]
                terms = [self.settled(old) for old in terms]
                self.lines += rest
            terms.append(new)
        return terms

    # Names and numbers ---------------------------------------------------------------------------------

    def _Constant(self, node: ast.Constant) -> Term:
        if type(node.value) not in CONSTANTS:
            raise self.refused(node, f"a {type(node.value).__name__} has no C", "numbers, states, bools, None")
        return Known(node.value)

    def _JoinedStr(self, node: ast.JoinedStr) -> Term:
        self.check_told([node])
        return Known(TEXT)

    def _Name(self, node: ast.Name) -> Term:
        found = self.names.get(node.id)
        if isinstance(found, Known):
            return found
        if found is not None:
            return Code(found, self.same.get(node.id) or self.c_local(node.id))
        if node.id in self.source.function.__code__.co_varnames:
            raise self.refused(node, "it is used before it has a value on every way", "give it a value first")
        value = self.source.meaning(node.id)
        if value is ABSENT:
            raise self.refused(node, "the name stands for nothing")
        self.takes_variable(node.id, node)
        return Known(value, name=node.id)

    def _Attribute(self, node: ast.Attribute) -> Term:
        return self.attribute_of(self.term(node.value), node)

    def attribute_of(self, base: Term, node: ast.Attribute) -> Term:
        if isinstance(base, Known):
            return self.attribute(base, node.attr, node)
        if self.is_array(base):
            return self.attribute_of_array(base, node.attr, node)  # type: ignore[arg-type]
        if isinstance(base, Many) and node.attr in base.names:
            return base.terms[base.names.index(node.attr)]
        if isinstance(base, Code) and isinstance(base.type, TupleType) and node.attr in dict(base.type.members):
            return Code(dict(base.type.members)[node.attr], f"{self.place(base).text}.{node.attr}")
        if isinstance(base, Code) and isinstance(base.type, StateType):
            return self._of_member(base, base.type.kind, node)
        raise self.refused(node, "an attribute of something that is not known when the code is generated")

    def _of_member(self, base: Code, kind: Any, node: ast.Attribute) -> Term:
        """The value of a state, a property or a method: functions of the member."""
        static = inspect.getattr_static(kind, node.attr, None)
        self.takes(kind, node.attr, node)
        if node.attr == "value" and not has_own_value(kind):
            return value_of_state(self, base, node)
        if type(static) is property and static.fget is not None:
            return self.function(static.fget, [base], {}, node)
        if isinstance(static, FunctionType):
            return Known(StateMethod(static, self.kept(base)))
        raise self.refused(node, f"the attribute {node.attr!r} of a state", "value, a method, a property")

    def function(
        self, target: Callable[..., Any], arguments: Sequence[Term], named: dict[str, Term], node: ast.AST
    ) -> Term:
        raise NotImplementedError

    def place(self, code: Code) -> Code:
        """The same as something that has members."""
        return code if code.text.replace("->", "").replace(".", "").replace("_", "").isalnum() else self.kept(code)

    def _Tuple(self, node: ast.Tuple) -> Term:
        return Many(tuple(self.ordered(node.elts)))

    def _List(self, node: ast.List) -> Term:
        return Many(tuple(self.ordered(node.elts)), kind=list)

    def _Subscript(self, node: ast.Subscript) -> Term:
        base, index = self.base_and_index(node)
        return self.element(base, index, node)

    def base_and_index(self, node: ast.Subscript) -> tuple[Term, Term]:
        """What has the element, as itself and not as a copy, and its place."""
        before = self.impure
        base = self.term(node.value)
        found = self.impure
        index = self.term(node.slice)
        if self.impure != found:
            text = base.text if isinstance(base, Code) else ""
            if isinstance(base, Many) or (isinstance(base, Code) and isinstance(plain(base.type), TupleType)):
                raise self.refused(node, "the place changes what has the element", "a name for the place first")
            if found != before or text in self.world.memory.rebound or text in self.sole:
                raise self.refused(node, "the place changes what has the element", "a name for the place first")
        return base, index

    def element(self, base: Term, index: Term, node: ast.AST) -> Term:
        """One element of a tuple, a list or an array, or of what is known."""
        if isinstance(index, Known) and type(index.value) in (int, bool):
            count = self._count_of(base)
            if count and not -count <= index.value < count:
                self.raises(IndexError, node)
                index = Known(0)
        if isinstance(base, Known) and isinstance(index, Known):
            if is_container(base.value):
                self.world.memory.place_known(base.value)
                return Known(base.value[index.value])
            raise self.refused(node, f"{type(base.value).__name__} decides what its elements are", "a list, a tuple")
        if isinstance(base, Known) and isinstance(index, Code):
            if is_table(base.value):
                return element_of(self, base.value, index, node)
            if is_dict(base.value):
                return value_of(self, base.value, index, node)
        if isinstance(base, Many) and isinstance(index, Known):
            found: Term = base.terms[index.value]
            return found
        if isinstance(base, Code) and isinstance(base.type, TupleType) and isinstance(index, Known):
            name, of = base.type.members[index.value]
            return Code(of, f"{self.place(base).text}.{name}")
        if isinstance(index, Code) and (terms := self._terms_of_tuple(base)):
            return element_of_terms(self, terms, index, node)
        if isinstance(base, Code) and isinstance(base.type, ArrayType):
            self.check_length(base.type, node)
            place = self.kept(base).text if isinstance(base, Elements) else base.text
            return Code(of_element(base.type), f"{place}.at[{self.index(base.type, index, node)}]")
        raise self.refused(node, "an element of something that is not a list of numbers")

    def _terms_of_tuple(self, base: Term) -> list[Term]:
        """The elements of a tuple of values, or of a list that is written down; none of anything else."""
        if isinstance(base, Many):
            return list(base.terms)
        if isinstance(base, Code) and isinstance(base.type, TupleType):
            place = self.place(base).text
            return [Code(of, f"{place}.{name}") for name, of in base.type.members]
        return []

    def _count_of(self, base: Term) -> int:
        """The number of elements of a tuple, or of a list that is known or written down; 0 of anything else."""
        if isinstance(base, Known):
            return len(base.value) if is_table(base.value) else 0
        return len(self._terms_of_tuple(base))

    def index(self, of: ArrayType, index: Term, node: ast.AST) -> str:
        """A place in an array; IndexError beyond it."""
        if isinstance(index, Known) and type(index.value) is int and -of.length <= index.value < of.length:
            return str(index.value % of.length)
        code = self.kept(self.number(index, node))
        if code.type != INT:
            raise self.refused(node, "a place in a list is a whole number")
        self.raises(IndexError, node, f"{code.text} < -{of.length} || {code.text} >= {of.length}")
        return f"{code.text} < 0 ? {code.text} + {of.length} : {code.text}"

    # Arithmetic ----------------------------------------------------------------------------------------

    def _UnaryOp(self, node: ast.UnaryOp) -> Term:
        term = self.term(node.operand)
        if isinstance(node.op, ast.Not):
            truth = self.truth(term, node.operand)
            return Known(not truth) if isinstance(truth, bool) else Code(BOOL, f"!({truth})")
        if isinstance(term, Known) and type(term.value) in NUMBERS and type(node.op) in FOLDED:
            return Known(FOLDED[type(node.op)](term.value))
        if isinstance(term, Known) and type(term.value) in NUMBERS:
            return inverted_known(self, term.value, node)
        self.check_sure([term], node)
        if self.is_array(term):
            return self.of_array(node.op, term, node)
        code = self.number(term, node.operand)
        if isinstance(node.op, ast.Invert):
            return inverted(self, term, code, node)
        if isinstance(node.op, ast.UAdd):
            return code if code.type != BOOL else Code(INT, code.text)
        of = term.type if isinstance(term, Code) and is_of_numpy(term) else code.type
        if code.type == REAL:
            return Code(of, f"-({code.text})")
        if of != code.type:
            raise self.refused(node, "- of a whole number of numpy", "int(...), or 0 - x")
        return self.arithmetic(ast.Sub(), Code(INT, "0", True), code, node)

    def _BinOp(self, node: ast.BinOp) -> Term:
        left, right = self.ordered([node.left, node.right])
        numbers = [each.value for each in (left, right) if isinstance(each, Known) and type(each.value) in NUMBERS]
        if len(numbers) == 2 and type(node.op) in FOLDED:
            if isinstance(node.op, ast.Pow) and abs(numbers[1]) > MOST_POWER:
                raise self.refused(node, f"a power of {numbers[1]}", "the number itself")
            try:
                return Known(FOLDED[type(node.op)](*numbers))
            except ArithmeticError as error:
                self.raises(type(error), node)
                return Known(0.0)
        if len(numbers) == 2 and is_of_bits(node.op):
            return of_known(self, node.op, numbers, node)
        if self.is_array(left) or self.is_array(right):
            return self.of_arrays(node.op, left, right, node)
        return self.of_numbers(node.op, left, right, (node.left, node.right), node)

    def of_numbers(
        self, sign: ast.operator, left: Term, right: Term, nodes: tuple[ast.AST, ast.AST], node: ast.AST
    ) -> Code:
        """An operator between numbers; between those of numpy nothing is raised."""
        a, b = self.number(left, nodes[0]), self.number(right, nodes[1])
        if not isinstance(sign, ast.Div):
            self.check_sure([left, right], node)
        if not (is_of_numpy(left) or is_of_numpy(right)):
            if is_of_bits(sign):
                return of_bits(self, sign, (left, right), (a, b), node)
            if is_whole_power(sign, a, right):
                return whole_power(self, a, right.value, node)  # type: ignore[union-attr]
            return self.arithmetic(sign, a, b, node)
        if {a.type, b.type} == {BOOL}:
            raise self.refused(node, "arithmetic of bools, of which one is of numpy", "int(...), and, or")
        sure = any(isinstance(each, Code) and getattr(each.type, "sure", False) for each in (left, right))
        if isinstance(sign, ast.Div) and sure:
            return Code(numpy_number(REAL), f"({self.as_type(a, REAL, node)} / {self.as_type(b, REAL, node)})")
        if type(sign) not in CHECKED:
            raise self.refused(node, "numbers of numpy and of Python differ here where the divisor is 0", "float(...)")
        found = self.arithmetic(sign, a, b, node)
        return replace(found, type=numpy_number(found.type, sure))

    def check_sure(self, terms: Sequence[Term], node: ast.AST) -> None:
        """That the result of arithmetic is a float whenever it is a real in C, and exact."""
        if any(map(_is_mixed, terms)) and not any(map(_is_float, terms)):
            told = "it may be a whole number at one time and a float at another"
            raise self.refused(node, told, "0.0 in the place of 0, float(...)")

    def arithmetic(self, sign: ast.operator, left: Code, right: Code, node: ast.AST) -> Code:
        if isinstance(sign, ast.Div) or REAL in (left.type, right.type):
            a, b = (self.as_type(each, REAL, node) for each in (left, right))
            return self._of_reals(sign, a, b, right.stable, node)
        a, b = (self.as_type(each, INT, node) for each in (left, right))
        if type(sign) in CHECKED:
            result = self.temporary(INT, "n")
            self.raises(ControllerLimit, node, f"__builtin_{CHECKED[type(sign)]}_overflow({a}, {b}, &{result})")
            return Code(INT, result, stable=True)
        if isinstance(sign, ast.FloorDiv | ast.Mod):
            b = self._divisor(b, right.stable, INT, node)
            if isinstance(sign, ast.FloorDiv):
                self.raises(ControllerLimit, node, f"{b} == -1 && {a} == INT32_MIN")
            return Code(INT, f"umo_{'mod' if isinstance(sign, ast.Mod) else 'floor_div'}_int({a}, {b})")
        if isinstance(sign, ast.Pow) and right.text.startswith("-") and right.text[1:].isdigit():
            return self._power(self.as_type(left, REAL, node), self.as_type(right, REAL, node), node)
        raise self.refused(
            node, "this arithmetic of whole numbers does not translate", "+, -, *, //, %, /, ** with a known exponent"
        )

    def _of_reals(self, sign: ast.operator, a: str, b: str, stable: bool, node: ast.AST) -> Code:
        if type(sign) in CHECKED:
            return Code(REAL, f"({a} {SIGNS[type(sign)]} {b})")
        if isinstance(sign, ast.Pow):
            return self._power(a, b, node)
        if not isinstance(sign, ast.Div | ast.FloorDiv | ast.Mod):
            raise self.refused(node, "this arithmetic does not translate", "+, -, *, /, //, %, **")
        b = self._divisor(b, stable, REAL, node)
        if isinstance(sign, ast.Div):
            return Code(REAL, f"({a} / {b})")
        return Code(REAL, f"umo_{'mod' if isinstance(sign, ast.Mod) else 'floor_div'}({a}, {b})")

    def _power(self, a: str, b: str, node: ast.AST) -> Code:
        self.world.note_inexact("**")
        base, power = self.kept(Code(REAL, a)).text, self.kept(Code(REAL, b)).text
        self.raises(ZeroDivisionError, node, f"{base} == 0 && {power} < 0 && umo_is_finite({power})")
        whole = f"umo_floor({power}) != {power} && umo_is_finite({power})"
        self.raises(ControllerLimit, node, f"{base} < 0 && {whole}", "a complex number")
        result = self.kept(Code(REAL, f"umo_pow({base}, {power})")).text
        finite = f"umo_is_finite({base}) && umo_is_finite({power})"
        self.raises(OverflowError, node, f"!umo_is_finite({result}) && {finite}")
        return Code(REAL, result, stable=True)

    def _divisor(self, text: str, stable: bool, of: CType, node: ast.AST) -> str:
        if text[0].isdigit():
            if float(text.rstrip("f")):
                return text
            self.raises(ZeroDivisionError, node)
            return text
        named = (
            text
            if text.replace("->", "").replace(".", "").replace("_", "").isalnum()
            else self.kept(Code(of, text)).text
        )
        self.raises(ZeroDivisionError, node, f"{named} == 0")
        return named


def of_element(of: ArrayType) -> CType:
    return of.of if of.listed else numpy_number(of.of)


def is_of_numpy(term: Term) -> bool:
    return isinstance(term, Code) and isinstance(plain(term.type), NumpyNumber)


def _is_mixed(term: Term) -> bool:
    return isinstance(term, Code) and isinstance(of := plain(term.type), MixedNumber) and of.of == REAL


def _is_float(term: Term) -> bool:
    """Whether it is a float in Python, too."""
    if isinstance(term, Code):
        return plain_number(plain(term.type)) == REAL and not _is_mixed(term)
    return isinstance(term, Known) and isinstance(term.value, float)
