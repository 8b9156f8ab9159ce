"""Conditions: comparisons, and, or, one of two values; and what they prove."""

from __future__ import annotations

import ast
from collections import deque
from enum import Enum
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    NOTHING,
    REAL,
    CType,
    OptionalType,
    StateType,
    TupleType,
    is_number,
    joined,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.expression_code import FOLDED, NUMBERS, SIGNS, ExpressionCode, is_of_numpy
from umo.generate.function_scope import TELLS, NoTranslation
from umo.generate.state_members import number_of
from umo.generate.terms import TEXT, Code, Known, Many, Present, Term, UnknownText
from umo.generate.value_kinds import compares_by_identity, is_bare_enum, is_immutable, refuse_comparison

NUMBERS_AND_TEXTS = (*NUMBERS, str, bytes, tuple, np.generic)
ELEMENTS = (tuple, list, set, frozenset, dict, range, deque)
"""Containers whose elements are found by Python itself."""


class ConditionCode(ExpressionCode):
    """The part of a function that is conditions."""

    def _Compare(self, node: ast.Compare) -> Term:
        if len(node.ops) == 1:
            left, right = self.ordered([node.left, node.comparators[0]])
            return self.compared(node.ops[0], left, right, node.left, node.comparators[0])
        result = self.temporary(BOOL, "c")
        self.line(f"{result} = false;", pure=True)
        of_numpy = self._chained(node, 0, self.term(node.left), node.left, result)
        return Code(numpy_number(BOOL, sure=False) if of_numpy else BOOL, result, stable=True)

    def _chained(self, node: ast.Compare, place: int, left: Term, left_node: ast.AST, result: str) -> bool:
        """Whether what it gives may be a bool of numpy."""
        left = self.kept(left) if isinstance(left, Code) else left
        right_node = node.comparators[place]
        right = self.term(right_node)
        right = self.kept(right) if isinstance(right, Code) else right
        found = self.compared(node.ops[place], left, right, left_node, right_node)
        truth, of_numpy = self.truth(found, node), is_of_numpy(found)
        if truth is False:
            return of_numpy
        last = place == len(node.ops) - 1
        if truth is True:
            if last:
                self.line(f"{result} = true;", pure=True)
                return of_numpy
            return self._chained(node, place + 1, right, right_node, result) or of_numpy
        if last:
            self.line(f"{result} = {truth};", pure=True)
            return of_numpy
        names = dict(self.names)
        with self.block(f"if ({truth})"):
            of_numpy |= self._chained(node, place + 1, right, right_node, result)
        self.names = {name: of for name, of in names.items() if self.names.get(name) == of}
        return of_numpy

    def compared(self, sign: ast.cmpop, left: Term, right: Term, left_node: ast.AST, right_node: ast.AST) -> Term:
        if isinstance(sign, ast.In | ast.NotIn):
            return self._contained(isinstance(sign, ast.In), left, right, left_node, right_node)
        if any(isinstance(each, Known) and isinstance(each.value, UnknownText) for each in (left, right)):
            raise self.refused(left_node, TELLS, "a state of an Enum")
        identity = isinstance(sign, ast.Is | ast.IsNot)
        equal = isinstance(sign, ast.Is | ast.Eq)
        none = [each for each in (left, right) if isinstance(each, Known) and each.value is None]
        other = right if none and none[0] is left else left
        own = isinstance(other, Known) and not (is_immutable(other.value) or compares_by_identity(other.value))
        if none and not identity and own:
            raise self.refused(left_node, "an object is compared whose class decides what is equal", "is None")
        if none and not identity and self.is_array(other):
            raise self.refused(left_node, "an array is compared with None", "is None")
        if none and (identity or isinstance(sign, ast.Eq | ast.NotEq)):
            return self._is_none(right if none[0] is left else left, equal)
        if self.is_array(left) or self.is_array(right):
            return self.compared_arrays(sign, left, right, left_node)
        if not identity and refuse_comparison(_class_of(left), _class_of(right)):
            raise self.refused(left_node, "a comparison with another type, which Python refuses", "its states")
        if isinstance(left, Known) and isinstance(right, Known):
            if identity:
                return self._same(left, right, equal, left_node)
            if not all(is_immutable(each.value) or compares_by_identity(each.value) for each in (left, right)):
                raise self.refused(left_node, "objects are compared whose class decides what is equal", "`is`")
            return Known(bool(FOLDED[type(sign)](left.value, right.value)))
        states = [self.code(each, at) for each, at in ((left, left_node), (right, right_node)) if _is_state(each)]
        if states:
            if len(states) == 1 or not (identity or isinstance(sign, ast.Eq | ast.NotEq)):
                return self._odd_state(sign, left, right, equal, left_node)
            a, b = states
            if plain_kind(a) is not plain_kind(b):
                if not identity and not (is_bare_enum(plain_kind(a)) and is_bare_enum(plain_kind(b))):
                    raise self.refused(left_node, "states of different Enums that are numbers or texts", "`is`, .value")
                if isinstance(a.type, OptionalType) and isinstance(b.type, OptionalType):
                    raise self.refused(
                        left_node, "states of different Enums, of which both may be None", "`is`, .value"
                    )
                return Known(not equal)
            return self._equal(a, b, equal)
        if identity:
            return self._same_bools(left, right, equal, left_node)
        if isinstance(sign, ast.Eq | ast.NotEq) and any(map(_is_optional_number, (left, right))):
            a, b = (self.code(each, at) for each, at in ((left, left_node), (right, right_node)))
            if not all(is_number(plain_number(plain(each.type))) for each in (a, b)):
                raise self.refused(left_node, "values of different classes are compared", "`is None`")
            return self._equal(a, b, equal)
        if isinstance(sign, ast.Eq | ast.NotEq) and (_is_tuple(left) or _is_tuple(right)):
            return self._of_tuples(equal, left, right, left_node, right_node)
        a, b = self.number(left, left_node), self.number(right, right_node)
        of = REAL if REAL in (a.type, b.type) else INT
        if a.text == b.text:  # compilers warn of a comparison with itself
            copied = self.temporary(a.type)
            self.line(f"{copied} = {a.text};", pure=True)
            a = Code(a.type, copied, stable=True)
        is_numpy = any(map(is_of_numpy, (left, right)))
        kind = numpy_number(BOOL, sure=False) if is_numpy else BOOL
        return Code(kind, f"{self.as_type(a, of, left_node)} {SIGNS[type(sign)]} {self.as_type(b, of, right_node)}")

    def _of_tuples(self, equal: bool, left: Term, right: Term, left_node: ast.AST, right_node: ast.AST) -> Term:
        """Whether two tuples are equal; None is equal to no tuple."""
        there = []
        sides = []
        if not (_is_tuple(left) and _is_tuple(right)) or _is_list(left) != _is_list(right):
            raise self.refused(left_node, "a tuple is compared with something else", "number by number")
        if sum(isinstance(each, Code) and isinstance(each.type, OptionalType) for each in (left, right)) > 1:
            raise self.refused(left_node, "two tuples are compared that may be None", "number by number")
        for term, node in ((left, left_node), (right, right_node)):
            term = self.kept(term) if isinstance(term, Code) else term
            if isinstance(term, Code) and isinstance(term.type, OptionalType):
                there.append(f"{term.text}.has")
                term = Code(term.type.of, f"{term.text}.value", stable=True)
            sides.append(
                [each if isinstance(each, Known) else self.code(each, node) for each in self.parts(term, node)]
            )
        if len(sides[0]) != len(sides[1]):
            return Known(not equal)
        if any(isinstance(each, Code) and each.type == REAL for side in sides for each in side):
            raise self.refused(left_node, "tuples of real numbers are compared", "number by number")
        pairs = zip(*sides, strict=True)
        truths = [self.truth(self.compared(ast.Eq(), a, b, left_node, right_node), left_node) for a, b in pairs]
        if False in truths:
            return Known(not equal)
        text = " && ".join([*there, *(f"({each})" for each in truths if each is not True)])
        return Code(BOOL, f"({text})" if equal else f"!({text})") if text else Known(equal)

    def does_nothing(self, node: ast.AST) -> bool:
        raise NotImplementedError

    def parts(self, term: Term, node: ast.AST) -> list[Term]:
        raise NotImplementedError

    def _equal(self, a: Code, b: Code, equal: bool) -> Code:
        """Whether two values are equal, of which None is equal to None only."""
        a, b = (self.kept(each) if isinstance(each.type, OptionalType) else each for each in (a, b))
        one, other = (
            f"{each.text}.value" if isinstance(each.type, OptionalType) else f"({each.text})" for each in (a, b)
        )
        there = [f"{each.text}.has" for each in (a, b) if isinstance(each.type, OptionalType)]
        text = f"{one} == {other}"
        if len(there) == 1:
            text = f"{there[0]} && {text}"
        elif there:
            text = f"{there[0]} == {there[1]} && (!{there[0]} || {text})"
        return Code(BOOL, f"({text})" if equal else f"(!({text}))")

    def _same(self, left: Known, right: Known, equal: bool, node: ast.AST) -> Known:
        """`is` of what is known: of numbers and texts Python's answer depends on how they were made."""
        one, other = left.value, right.value
        alike = (
            isinstance(one, NUMBERS_AND_TEXTS) and isinstance(other, NUMBERS_AND_TEXTS) and not isinstance(one, Enum)
        )
        if alike and not (type(one) is bool and type(other) is bool):
            raise self.refused(node, "`is` of numbers or texts", "==")
        return Known((one is other) is equal)

    def _same_bools(self, left: Term, right: Term, equal: bool, node: ast.AST) -> Term:
        """`is` of bools of Python, of which there are two, or of one that may be None."""
        a, b = (self.code(each, node) for each in (left, right))
        if not all(plain(each.type) == BOOL for each in (a, b)):
            raise self.refused(node, "`is` of numbers", "==")
        if a.text == b.text:  # compilers warn of a comparison with itself
            a = self.kept(Code(a.type, a.text))
        return self._equal(a, b, equal)

    def _odd_state(self, sign: ast.cmpop, left: Term, right: Term, equal: bool, node: ast.AST) -> Term:
        """A state beside something else, or in an order: those with numbers are compared by these."""
        if isinstance(sign, ast.Is | ast.IsNot):
            if any(isinstance(each, Present | Many) for each in (left, right)):
                raise self.refused(node, "a state is compared with something else", "a state of the same Enum")
            return Known(not equal)
        numbers = [number_of(self, each, node) for each in (left, right)]
        if numbers[0] is not None and numbers[1] is not None:
            return self.compared(sign, numbers[0], numbers[1], node, node)
        raise self.refused(
            node, "a state is compared with something else, or by order", "`is`, with a state of the same Enum"
        )

    def _is_none(self, term: Term, equal: bool) -> Term:
        if isinstance(term, Present):
            return Code(BOOL, f"!{term.text}" if equal else term.text)
        if isinstance(term, Code) and isinstance(term.type, OptionalType):
            return Code(BOOL, f"{'!' if equal else ''}{self.place(term).text}.has")
        return Known((isinstance(term, Known) and term.value is None) is equal)

    def _contained(self, yes: bool, one: Term, among: Term, one_node: ast.AST, node: ast.AST) -> Term:
        options: list[Term] | None = None
        if isinstance(among, Known) and type(among.value) in ELEMENTS:
            self.world.memory.place_known(among.value)
            options = list(map(Known, among.value))
        elif isinstance(among, Many) and among.kind in (None, list):
            options = list(among.terms)
        if options is None:
            raise self.refused(node, "`in` of something that is not known when the code is generated", "a tuple")
        if any(isinstance(each, Many) for each in (one, *options)):
            raise self.refused(node, "`in` of tuples", "number by number")
        one = self.kept(one) if isinstance(one, Code) else one
        if any(map(_may_be_nan, options)) and _may_be_nan(one):
            raise self.refused(node, "`in` of real numbers: Python also finds a NaN that is the same object", "==, or")
        truths = [self.truth(self.compared(ast.Eq(), one, each, one_node, node), node) for each in options]
        if True in truths:
            return Known(yes)
        text = " || ".join(f"({each})" for each in truths if each is not False)
        return Code(BOOL, f"({text})" if yes else f"!({text})") if text else Known(not yes)

    def _BoolOp(self, node: ast.BoolOp) -> Term:
        both, impure = isinstance(node.op, ast.And), self.impure
        first, rest = self.term(node.values[0]), node.values[1:]
        for place, each in enumerate(rest, 1):
            truth = self.truth(first, node.values[place - 1])
            if isinstance(truth, bool):
                if truth is not both:
                    return first
                first = self.term(each)
                continue
            names = dict(self.names)
            proved = self.proved(node.values[place - 1]) if both and self.impure == impure else set()
            first = self._joined(both, first, truth, node.values[place - 1], each, node, proved)
            self.names = {name: of for name, of in names.items() if self.names.get(name) == of}
        return first

    def _joined(
        self,
        both: bool,
        first: Term,
        truth: str,
        first_node: ast.AST,
        node: ast.AST,
        whole: ast.AST,
        proved: set[str],
    ) -> Term:
        """`first and second`; `first or second` with `both` False. `proved`: what is not None in the second."""
        known = set(self.known)
        self.known |= proved
        at, depth, before = len(self.lines), self.depth, self.impure
        self.depth += 1
        second = self.term(node)
        other = self.truth(second, node)
        second = self._as_value(second, node)
        rest, self.lines, self.depth, self.known = self.lines[at:], self.lines[:at], depth, known & self.known
        is_bool = _is_bool(first) and _is_bool(second)
        only_truth = not is_bool and not (isinstance(first, Code) and (isinstance(second, Code) or _is_none(second)))
        if is_bool and not rest and isinstance(other, bool):
            return Known(other) if other is not both else Code(BOOL, truth)
        second_truth = str(other).lower() if isinstance(other, bool) else other
        if (is_bool or only_truth) and not rest:
            text = f"({truth} {'&&' if both else '||'} {second_truth})"
            return Code(_bool_of(first, second), text) if is_bool else Present(text)
        of = _bool_of(first, second) if is_bool else BOOL if only_truth else self._one_type(first, second, whole)
        is_bool |= only_truth
        result = self.temporary(of, "c")
        value = truth if is_bool else self.as_type(first, of, first_node)
        self.line(f"{result} = {value};", pure=True)
        condition = result if is_bool else truth
        with self.block(f"if ({condition})" if both else f"if (!({condition}))"):
            self.lines += rest
            second_text = second_truth if is_bool else self.as_type(second, of, node)
            self.line(f"{result} = {second_text};", pure=self.impure == before)
        return Present(result) if only_truth else Code(of, result, stable=True)

    def _as_value(self, term: Term, node: ast.AST) -> Term:
        """A number or a state that is known, as a value in C."""
        if isinstance(term, Known) and self.world.fields.type_of_value(term.value) not in (None, NOTHING):
            return self.code(term, node)
        return term

    def _one_type(self, first: Term, second: Term, node: ast.AST) -> CType:
        try:
            return joined(self.code(first, node).type, NOTHING if _is_none(second) else self.code(second, node).type)
        except TypeError:
            raise self.refused(node, "one of two values of different types", "one type for both") from None

    def _IfExp(self, node: ast.IfExp) -> Term:
        start = self.impure
        try:
            truth = self.truth(self.term(node.test), node.test)
        except NoTranslation as refused:
            if refused.reason == TELLS and all(map(_is_text, (node.body, node.orelse))) and self.does_nothing(node):
                return Known(TEXT)
            raise
        if isinstance(truth, bool):
            return self.term(node.body if truth else node.orelse)
        before, impure = set(self.known), self.impure
        parts, names = [], dict(self.names)
        after = set(before)
        shown = self.impure == start
        facts = (self.proved(node.test), self.disproved(node.test)) if shown else (set(), set())
        for each, proved in zip((node.body, node.orelse), facts, strict=True):
            at, self.known = len(self.lines), before | proved
            self.names = dict(names)
            self.depth += 1
            term = self.term(each)
            if isinstance(term, Known | Many) and not (isinstance(term, Known) and term.value is None):
                term = self.code(term, each)
            self.depth -= 1
            parts.append((term, self.lines[at:]))
            self.lines = self.lines[:at]
            names = {name: of for name, of in names.items() if self.names.get(name) == of}
            after &= self.known
        self.known, self.names = after, names
        (one, one_lines), (other, other_lines) = parts
        if isinstance(one, Known) and isinstance(other, Known):
            raise self.refused(node, "it stands for None either way")
        of = self._type_of_two(one, other, node)
        a, one_lines = self._finished(one, one_lines, of, node.body)
        b, other_lines = self._finished(other, other_lines, of, node.orelse)
        if not one_lines and not other_lines:
            return Code(of, f"({truth} ? {a} : {b})")
        result = self.temporary(of, "v")
        with self.block(f"if ({truth})", "} else {"):
            self.lines += one_lines
            self.line(f"{result} = {a};", pure=True)
        self.depth += 1
        self.lines += other_lines
        self.line(f"{result} = {b};", pure=self.impure == impure)
        self.depth -= 1
        self.line("}", pure=True)
        return Code(of, result, stable=True)

    def _finished(self, term: Term, lines: list[str], of: CType, node: ast.AST) -> tuple[str, list[str]]:
        """The text of one of two values, with the lines that it needs."""
        at, self.lines = len(self.lines), [*self.lines, *lines]
        self.depth += 1
        text = self.as_type(term, of, node)
        self.depth -= 1
        found, self.lines = self.lines[at:], self.lines[:at]
        return text, found

    def _type_of_two(self, one: Term, other: Term, node: ast.AST) -> CType:
        types = [NOTHING if isinstance(each, Known) else self.code(each, node).type for each in (one, other)]
        try:
            return joined(*types)
        except TypeError:
            raise self.refused(node, "two values of different types", "one type for both") from None

    def _NamedExpr(self, node: ast.NamedExpr) -> Term:
        term = self.term(node.value)
        self.store(node.target, term, node)
        return self._Name(node.target)

    def store(self, target: ast.AST, term: Term, node: ast.AST) -> None:
        raise NotImplementedError

    def _Call(self, node: ast.Call) -> Term:
        return self.call(node)

    # What a condition proves ---------------------------------------------------------------------------

    def proved(self, test: ast.AST) -> set[str]:
        """What is not None where the condition holds."""
        if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And):
            return set().union(*map(self.proved, test.values))
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            return self.disproved(test.operand)
        if _compares_none(test, ast.IsNot):
            return {ast.dump(test.left)}  # type: ignore[attr-defined]
        return {ast.dump(test)} if isinstance(test, ast.Name | ast.Attribute) else set()

    def disproved(self, test: ast.AST) -> set[str]:
        """What is not None where it does not hold."""
        if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):
            return set().union(*map(self.disproved, test.values))
        if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
            return self.proved(test.operand)
        return {ast.dump(test.left)} if _compares_none(test, ast.Is) else set()  # type: ignore[attr-defined]


def _compares_none(test: ast.AST, sign: type[ast.cmpop]) -> bool:
    if not (isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], sign)):
        return False
    other = test.comparators[0]
    return isinstance(other, ast.Constant) and other.value is None


def _is_state(term: Term) -> bool:
    if isinstance(term, Known):
        return isinstance(term.value, Enum)
    return isinstance(term, Code) and isinstance(plain_type(term.type), StateType)


def _class_of(term: Term) -> type:
    """The class of its values; object where it is not known."""
    if isinstance(term, Known):
        return type(term.value)
    if not isinstance(term, Code):
        return object
    return plain_kind(term) or (float if is_number(plain_number(plain_type(term.type))) else object)


def plain_type(of: CType) -> CType:
    return of.of if isinstance(of, OptionalType) else of


def plain_kind(code: Code) -> Any:
    of = plain_type(code.type)
    return of.kind if isinstance(of, StateType) else None


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _is_tuple(term: Term) -> bool:
    return isinstance(term, Many) or (isinstance(term, Code) and isinstance(plain_type(term.type), TupleType))


def _is_none(term: Term) -> bool:
    return isinstance(term, Known) and term.value is None


def calls_in(node: ast.AST) -> bool:
    """Whether evaluating an expression runs code of its own, or assigns."""
    return any(isinstance(each, ast.Call | ast.NamedExpr | ast.Await) for each in ast.walk(node))


def _is_list(term: Term) -> bool:
    of = plain_type(term.type) if isinstance(term, Code) else term
    return isinstance(of, Many | TupleType) and of.kind is list


def _is_optional_number(term: Term) -> bool:
    return isinstance(term, Code) and isinstance(term.type, OptionalType) and is_number(plain_number(term.type.of))


def _may_be_nan(term: Term) -> bool:
    if isinstance(term, Code):
        return plain_number(plain(term.type)) == REAL
    return isinstance(term, Known) and isinstance(term.value, float) and term.value != term.value


def _is_bool(term: Term) -> bool:
    if isinstance(term, Code):
        return plain_number(term.type) == BOOL
    return isinstance(term, Known) and isinstance(term.value, bool)


def _bool_of(*terms: Term) -> CType:
    """The type of a bool that is one of these."""
    return numpy_number(BOOL, sure=False) if any(map(is_of_numpy, terms)) else BOOL
