"""Conditions: comparisons, and, or, conditional expressions, and the facts that they prove."""

from __future__ import annotations

import ast
from collections import deque
from dataclasses import is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    NOTHING,
    REAL,
    ArrayType,
    CType,
    OptionalType,
    StateType,
    TupleType,
    is_number,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.c_types import joined as joined_type
from umo.generate.form import (
    FALSE,
    TRUE,
    Assign,
    Conditional,
    If,
    Literal,
    Operator,
    Statement,
    Temporary,
    Value,
    has,
    inside,
    joined,
    negated,
)
from umo.generate.lower.flow import Names, common, disproved_by, proved_by
from umo.generate.lower.lowered_expressions import FOLDED, NUMBERS, SIGNS, is_of_numpy, record_kind
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.lowered_values import only_asked
from umo.generate.lower.state_members import number_of
from umo.generate.lower.terms import Code, Known, NullTest, Term, TruthTest, TupleTerm
from umo.generate.lower.text_states import as_text, compared_texts, is_text_state
from umo.generate.value_kinds import (
    compares_by_identity,
    is_bare_enum,
    is_fixed_ring,
    is_immutable,
    is_ring,
    refuse_comparison,
)

NUMBERS_AND_TEXTS = (*NUMBERS, str, bytes, tuple, np.generic)
ELEMENTS = (tuple, list, set, frozenset, dict, range, deque)
"""Containers whose elements Python itself finds. A deque is among them only if it has no `maxlen`."""


def _elements_of(sign: ast.cmpop, node: ast.expr) -> ast.expr:
    """Return the set in `x in {1, 2}` as a tuple. For numbers, texts and names of states, a comparison with each
    element has the same result."""
    simple = isinstance(node, ast.Set) and all(
        isinstance(getattr(each, "operand", each), ast.Constant | ast.Attribute) for each in node.elts
    )
    if not (simple and isinstance(sign, ast.In | ast.NotIn)):
        return node
    return ast.copy_location(ast.Tuple(node.elts, ast.Load()), node)  # type: ignore[attr-defined]


class LoweredConditions(LoweredSubject):
    """Lowers the conditions of a function."""

    def lower_compare(self, node: ast.Compare) -> Term:
        elements = [*map(_elements_of, node.ops, node.comparators)]
        node = ast.copy_location(ast.Compare(node.left, node.ops, elements), node)
        if len(node.ops) == 1:
            left, right = self.f.ordered([node.left, node.comparators[0]])
            return self.compared(node.ops[0], left, right, node.left, node.comparators[0])
        result = self.f.temporary(BOOL, "c")
        self.f.assign(result, FALSE)
        of_numpy = self._chained(node, 0, self.f.term(node.left), node.left, result)
        return Code(numpy_number(BOOL, sure=False) if of_numpy else BOOL, result)

    def _chained(self, node: ast.Compare, place: int, left: Term, left_node: ast.AST, result: Temporary) -> bool:
        """True if the result of a chained comparison may be a numpy bool."""
        left = self.f.values.kept(left) if isinstance(left, Code) else left
        right_node = node.comparators[place]
        right = self.f.term(right_node)
        right = self.f.values.kept(right) if isinstance(right, Code) else right
        found = self.compared(node.ops[place], left, right, left_node, right_node)
        truth, of_numpy = self.f.values.truth(found, node), is_of_numpy(found)
        if truth is False:
            return of_numpy
        last = place == len(node.ops) - 1
        if last:
            self.f.assign(result, TRUE if truth is True else truth)
            return of_numpy
        if truth is True:
            return self._chained(node, place + 1, right, right_node, result) or of_numpy
        names = dict(self.f.flow.names)
        with self.f.body_of() as body:
            of_numpy |= self._chained(node, place + 1, right, right_node, result)
        self.f.add(If(truth, tuple(body)))
        self.f.flow.only(names)
        return of_numpy

    def compared(self, sign: ast.cmpop, left: Term, right: Term, left_node: ast.AST, right_node: ast.AST) -> Term:
        if isinstance(sign, ast.In | ast.NotIn):
            return self._contained(isinstance(sign, ast.In), left, right, left_node, right_node)
        for each in (left, right):
            self.f.texts.check_decided(each, left_node)
        identity = isinstance(sign, ast.Is | ast.IsNot)
        equal = isinstance(sign, ast.Is | ast.Eq)
        none = [each for each in (left, right) if isinstance(each, Known) and each.value is None]
        other = right if none and none[0] is left else left
        own = isinstance(other, Known) and not (is_immutable(other.value) or compares_by_identity(other.value))
        if none and not identity and own:
            raise self.f.refused(left_node, "the class of this object defines what is equal to it", "is None")
        if none and not identity and self.f.arrays.is_array(other):
            raise self.f.refused(left_node, "an array is compared with None", "is None")
        if none and (identity or isinstance(sign, ast.Eq | ast.NotEq)):
            return self._is_none(right if none[0] is left else left, equal, left_node)
        if self.f.arrays.is_array(left) or self.f.arrays.is_array(right):
            return self.f.arrays.compared_arrays(sign, left, right, left_node)
        if not identity and refuse_comparison(_class_of(left), _class_of(right)):
            raise self.f.refused(
                left_node, "the value is compared with another type, for which Python raises TypeError", "its states"
            )
        if is_text_state(left) or is_text_state(right):
            return compared_texts(self.f, sign, left, right, left_node)
        if not identity and any(isinstance(each, Known) and is_ring(each.value) for each in (left, right)):
            raise self.f.refused(left_node, "a deque is compared", "its elements, one by one")
        if isinstance(left, Known) and isinstance(right, Known):
            if identity:
                return self._same(left, right, equal, left_node)
            if not all(is_immutable(each.value) or compares_by_identity(each.value) for each in (left, right)):
                raise self.f.refused(left_node, "the class of these objects defines which are equal", "`is`")
            return Known(bool(FOLDED[type(sign)](left.value, right.value)))
        states = [
            self.f.values.code(each, at) for each, at in ((left, left_node), (right, right_node)) if _is_state(each)
        ]
        if states:
            if len(states) == 1 or not (identity or isinstance(sign, ast.Eq | ast.NotEq)):
                return self._odd_state(sign, left, right, equal, left_node)
            a, b = states
            if plain_kind(a) is not plain_kind(b):
                if not identity and not (is_bare_enum(plain_kind(a)) and is_bare_enum(plain_kind(b))):
                    raise self.f.refused(
                        left_node, "the states belong to different Enums that are numbers or texts", "`is`, .value"
                    )
                if isinstance(a.type, OptionalType) and isinstance(b.type, OptionalType):
                    raise self.f.refused(
                        left_node, "the states belong to different Enums, and both may be None", "`is`, .value"
                    )
                return Known(not equal)
            return self._equal(a, b, equal)
        if identity:
            return self._same_bools(left, right, equal, left_node)
        if isinstance(sign, ast.Eq | ast.NotEq) and any(map(_is_optional_number, (left, right))):
            a, b = (self.f.values.code(each, at) for each, at in ((left, left_node), (right, right_node)))
            if not all(is_number(plain_number(plain(each.type))) for each in (a, b)):
                raise self.f.refused(left_node, "values of different classes are compared", "`is None`")
            return self._equal(a, b, equal)
        if isinstance(sign, ast.Eq | ast.NotEq) and (_is_tuple(left) or _is_tuple(right)):
            return self._of_tuples(equal, left, right, left_node, right_node)
        a, b = self.f.values.number(left, left_node), self.f.values.number(right, right_node)
        if (decided := _of_bool(sign, left, right)) is not None:
            return decided
        of = REAL if REAL in (a.type, b.type) else INT
        if a.value == b.value:  # compilers warn of a comparison with itself
            a = self.f.values.copied(a)
        is_numpy = any(map(is_of_numpy, (left, right)))
        kind = numpy_number(BOOL, sure=False) if is_numpy else BOOL
        operands = self.f.values.as_type(a, of, left_node), self.f.values.as_type(b, of, right_node)
        return Code(kind, Operator(SIGNS[type(sign)], *operands))

    def _of_tuples(self, equal: bool, left: Term, right: Term, left_node: ast.AST, right_node: ast.AST) -> Term:
        """Return whether two tuples are equal. None is not equal to a tuple."""
        there: list[Value] = []
        sides = []
        kinds = record_kind(left), record_kind(right)
        if _is_tuple(left) and _is_tuple(right) and any(map(is_dataclass, kinds)) and kinds[0] is not kinds[1]:
            return Known(not equal)
        if not (_is_tuple(left) and _is_tuple(right)) or _is_list(left) != _is_list(right):
            raise self.f.refused(
                left_node, "a tuple is compared with something other than a tuple", "compare their elements"
            )
        if sum(isinstance(each, Code) and isinstance(each.type, OptionalType) for each in (left, right)) > 1:
            raise self.f.refused(left_node, "the compared tuples may be None", "compare their elements")
        for term, node in ((left, left_node), (right, right_node)):
            term = self.f.values.kept(term) if isinstance(term, Code) else term
            if isinstance(term, Code) and isinstance(term.type, OptionalType):
                there.append(has(term.value))
                term = Code(term.type.of, inside(term.value))
            sides.append(
                [
                    each if isinstance(each, Known) else self.f.values.code(each, node)
                    for each in self.f.calls.members(term, node)
                ]
            )
        if len(sides[0]) != len(sides[1]):
            return Known(not equal)
        if any(isinstance(each, Code) and each.type == REAL for side in sides for each in side):
            raise self.f.refused(left_node, "tuples of floats are compared", "compare their elements")
        pairs = zip(*sides, strict=True)
        truths = [
            self.f.values.truth(self.compared(ast.Eq(), a, b, left_node, right_node), left_node) for a, b in pairs
        ]
        if False in truths:
            return Known(not equal)
        return _all_or_none([*there, *(each for each in truths if not isinstance(each, bool))], "&&", equal)

    def _equal(self, a: Code, b: Code, equal: bool) -> Code:
        """Return whether two values are equal. None is equal to None only."""
        a, b = (self.f.values.kept(each) if isinstance(each.type, OptionalType) else each for each in (a, b))
        one, other = (inside(each.value) if isinstance(each.type, OptionalType) else each.value for each in (a, b))
        there = [has(each.value) for each in (a, b) if isinstance(each.type, OptionalType)]
        test: Value = Operator("==", one, other)
        if len(there) == 1:
            test = Operator("&&", there[0], test)
        elif there:
            test = Operator("&&", Operator("==", *there), Operator("||", negated(there[0]), test))
        return Code(BOOL, test if equal else negated(test))

    def _same(self, left: Known, right: Known, equal: bool, node: ast.AST) -> Known:
        """Return `is` for known values. For numbers and texts the result in Python depends on how they were made."""
        one, other = left.value, right.value
        alike = (
            isinstance(one, NUMBERS_AND_TEXTS) and isinstance(other, NUMBERS_AND_TEXTS) and not isinstance(one, Enum)
        )
        if alike and not (type(one) is bool and type(other) is bool):
            raise self.f.refused(node, "numbers or texts are compared by `is`", "==")
        return Known((one is other) is equal)

    def _same_bools(self, left: Term, right: Term, equal: bool, node: ast.AST) -> Term:
        """Return `is` for Python bools, of which there are two, or for an optional bool."""
        a, b = (self.f.values.code(each, node) for each in (left, right))
        if not all(plain(each.type) == BOOL for each in (a, b)):
            raise self.f.refused(node, "numbers are compared by `is`", "==")
        return self._equal(self.f.values.copied(a) if a.value == b.value else a, b, equal)

    def _odd_state(self, sign: ast.cmpop, left: Term, right: Term, equal: bool, node: ast.AST) -> Term:
        """Compare a state with something else, or by order. States with numbers are compared by them."""
        if isinstance(sign, ast.Is | ast.IsNot):
            if any(isinstance(each, NullTest | TupleTerm | TruthTest) for each in (left, right)):
                raise self.f.refused(
                    node, "a state is compared with something other than a state", "a state of the same Enum"
                )
            return Known(not equal)
        numbers = [number_of(self.f, each, node) for each in (left, right)]
        if numbers[0] is not None and numbers[1] is not None:
            return self.compared(sign, numbers[0], numbers[1], node, node)
        raise self.f.refused(
            node,
            "a state is compared with something other than a state, or by order",
            "`is`, with a state of the same Enum",
        )

    def _is_none(self, term: Term, equal: bool, node: ast.AST) -> Term:
        if isinstance(term, TruthTest):
            raise self.f.refused(node, *only_asked(term))
        if isinstance(term, NullTest):
            return Code(BOOL, negated(term.test) if equal else term.test)
        if isinstance(term, Code) and isinstance(term.type, OptionalType):
            there = has(self.f.expressions.place(term).value)
            return Code(BOOL, negated(there) if equal else there)
        return Known((isinstance(term, Known) and term.value is None) is equal)

    def _contained(self, yes: bool, one: Term, among: Term, one_node: ast.AST, node: ast.AST) -> Term:
        options: list[Term] | None = None
        if isinstance(among, Known) and type(among.value) in ELEMENTS and not is_fixed_ring(among.value):
            self.f.world.memory.place_known(among.value)
            options = list(map(Known, among.value))
        elif isinstance(among, TupleTerm) and among.kind in (None, list):
            options = list(among.terms)
        elif isinstance(among, Code) and _has_elements(among.type):
            options = self.f.calls.parts(among, node)
        if options is None:
            raise self.f.refused(
                node, "`in` searches something that is not known when the code is generated", "a tuple"
            )
        if any(isinstance(each, TupleTerm) for each in (one, *options)):
            raise self.f.refused(node, "`in` searches for a tuple", "compare their elements")
        one = self.f.values.kept(one) if isinstance(one, Code) else one
        if any(map(_may_be_nan, options)) and _may_be_nan(one):
            raise self.f.refused(
                node, "`in` searches real numbers, where Python also finds a NaN that is the same object", "==, or"
            )
        truths = [self.f.values.truth(self.compared(ast.Eq(), one, each, one_node, node), node) for each in options]
        if True in truths:
            return Known(yes)
        found = [each for each in truths if not isinstance(each, bool)]
        return _all_or_none(found, "||", yes) if found else Known(not yes)

    def lower_bool_op(self, node: ast.BoolOp) -> Term:
        both, at = isinstance(node.op, ast.And), len(self.f.statements)
        last, decided = node.values[0], list[Names]()
        first = self.f.term(last)
        for each in node.values[1:]:
            truth = self.f.values.truth(first, last)
            when_true, when_false = self.f.flow.names_if(last)
            if truth is not both and isinstance(truth, bool):
                break
            self.f.flow.names = when_true if both else when_false
            if isinstance(truth, bool):
                first = self.f.term(each)
            else:
                proof = proved_by if both else disproved_by
                proved = proof(last) if not self.f.changed_since(at) else set()
                decided.append(when_false if both else when_true)
                first = self._joined(both, first, truth, last, each, proved)
            last = each
        self.f.flow.decide(node, both, decided, self.f.flow.names_if(last))
        return first

    def _joined(
        self, both: bool, first: Term, truth: Value, first_node: ast.AST, node: ast.AST, proved: set[str]
    ) -> Term:
        """Return `first and second`, or `first or second` if `both` is False. `proved`: expressions that are not None
        in the second."""
        known = set(self.f.flow.known)
        self.f.flow.known |= proved
        with self.f.one_of_two() as rest:
            second = self.f.term(node)
            other = self.f.values.truth(second, node)
            second = self._as_value(second, node)
        self.f.flow.known = known & self.f.flow.known
        is_bool = _is_bool(first) and _is_bool(second)
        if is_bool and not rest and isinstance(other, bool):
            return Known(other) if other is not both else Code(BOOL, truth)
        of = _bool_of(first, second) if is_bool else self._one_type(both, first, second, first_node)
        second_truth = Literal(other, BOOL) if isinstance(other, bool) else other
        if (is_bool or of is None) and not rest:
            either = Operator("&&" if both else "||", truth, second_truth)
            return TruthTest(either) if of is None else Code(of, either)
        result = self.f.temporary(of or BOOL, "c")
        of_truth = is_bool or of is None
        self.f.assign(result, truth if of is None or is_bool else self._decided(both, first, of, first_node))
        test = result if of_truth else truth
        with self.f.body_of() as body:
            self.f.statements += rest
            self.f.assign(result, second_truth if of is None or is_bool else self.f.values.as_type(second, of, node))
        self.f.add(If(test if both else negated(test), tuple(body)))
        return TruthTest(result) if of is None else Code(of, result)

    def _decided(self, both: bool, first: Term, of: CType, node: ast.AST) -> Value:
        """Return the first value, for the case that it decides: for `or` it is not None, for `and` an optional state is
        None."""
        if isinstance(first, Code) and isinstance(first.type, OptionalType):
            if not both:
                first = Code(first.type.of, inside(self.f.expressions.place(first).value))
            elif self._is_true(first, node):
                first = Known(None)
        return self.f.values.as_type(first, of, node)

    def _is_true(self, first: Code, node: ast.AST) -> bool:
        """True if an optional value is true whenever it is not None."""
        return self.f.values.truth(Code(plain(first.type), inside(first.value)), node) is True

    def _as_value(self, term: Term, node: ast.AST) -> Term:
        """Return a known number or state as a value in C."""
        if isinstance(term, Known) and self.f.world.fields.type_of_value(term.value) not in (None, NOTHING):
            return self.f.values.code(term, node)
        return term

    def _one_type(self, both: bool, first: Term, second: Term, node: ast.AST) -> CType | None:
        """Return the type of `first and second` or `first or second`; None if only its truth can be used."""
        one, other = self.f.values.type_of(first), self.f.values.type_of(second)
        if isinstance(first, Code) and isinstance(one, OptionalType):
            one = one.of if not both else NOTHING if self._is_true(first, node) else one
        if one is None or other is None:
            return None
        try:
            return joined_type(one, other)
        except TypeError:
            return None

    def lower_if_exp(self, node: ast.IfExp) -> Term:
        if self.f.texts.is_text(node):
            return self.f.texts.text(node)
        start = len(self.f.statements)
        truth = self.f.values.truth(self.f.term(node.test), node.test)
        of_both = self.f.flow.names_if(node.test)
        if isinstance(truth, bool):
            self.f.flow.names = of_both[not truth]
            return self.f.term(node.body if truth else node.orelse)
        before = set(self.f.flow.known)
        parts, ends = [], list[Names]()
        after = set(before)
        shown = not self.f.changed_since(start)
        facts = (proved_by(node.test), disproved_by(node.test)) if shown else (set(), set())
        for each, proved, names in zip((node.body, node.orelse), facts, of_both, strict=True):
            self.f.flow.known, self.f.flow.names = before | proved, names
            with self.f.one_of_two() as rest:
                term = self.f.term(each)
                if isinstance(term, Known | TupleTerm) and not (isinstance(term, Known) and term.value is None):
                    term = as_text(self.f, term, each) or self.f.values.code(term, each)
            self.f.aliases.share(term)
            parts.append((term, rest))
            ends.append(self.f.flow.names)
            after &= self.f.flow.known
        self.f.flow.known, self.f.flow.names = after, common(ends)
        (one, of_one), (other, of_other) = parts
        if isinstance(one, Known) and isinstance(other, Known):
            raise self.f.refused(node, "it is None in both cases")
        of = self._type_of_two(one, other, node)
        a = self._finished(one, of_one, of, node.body)
        b = self._finished(other, of_other, of, node.orelse)
        if not of_one and not of_other:
            return Code(of, Conditional(truth, a, b))
        result = self.f.temporary(of, "v")
        line = self.f.line
        of_one.append(Assign(result, a, line=line))
        of_other.append(Assign(result, b, line=line))
        self.f.add(If(truth, tuple(of_one), tuple(of_other)))
        return Code(of, result)

    def _finished(self, term: Term, statements: list[Statement], of: CType, node: ast.AST) -> Value:
        """Return one of two values as this type. Statements that the conversion needs are added to `statements`."""
        with self.f.one_of_two() as more:
            value = self.f.values.as_type(term, of, node)
        statements += more
        return value

    def _type_of_two(self, one: Term, other: Term, node: ast.AST) -> CType:
        types = [NOTHING if isinstance(each, Known) else self.f.values.code(each, node).type for each in (one, other)]
        try:
            return joined_type(*types)
        except TypeError:
            raise self.f.refused(node, "the two values have different types", "one type for both") from None


def _of_bool(sign: ast.cmpop, left: Term, right: Term) -> Term | None:
    """Return the comparison of a Python bool with a known number, as its result for True and False; None if neither
    operand is a bool. Compilers warn of comparing a bool with such a constant."""
    bools = [isinstance(each, Code) and each.type == BOOL for each in (left, right)]
    numbers = [each.value if isinstance(each, Known) else None for each in (left, right)]
    if True not in bools or not any(type(each) in NUMBERS for each in numbers):
        return None
    of_false, of_true = (
        bool(FOLDED[type(sign)](*(number if number is not None else each for number in numbers)))
        for each in (False, True)
    )
    if of_false is of_true:
        return Known(of_true)
    value = next(each.value for each in (left, right) if isinstance(each, Code))
    return Code(BOOL, value if of_true else negated(value))


def _all_or_none(tests: list[Value], sign: str, yes: bool) -> Term:
    """Return whether all of these (`&&`) or one of them (`||`) hold; the opposite if `yes` is False."""
    if not tests:
        return Known(yes)
    found = joined(sign, tests)
    return Code(BOOL, found if yes else negated(found))


def _is_state(term: Term) -> bool:
    if isinstance(term, Known):
        return isinstance(term.value, Enum)
    return isinstance(term, Code) and isinstance(plain_type(term.type), StateType)


def _class_of(term: Term) -> type:
    """Return the class of its values; object if it is not known."""
    if isinstance(term, Known):
        return type(term.value)
    if is_text_state(term):
        return str
    if not isinstance(term, Code):
        return object
    return plain_kind(term) or (float if is_number(plain_number(plain_type(term.type))) else object)


def plain_type(of: CType) -> CType:
    return of.of if isinstance(of, OptionalType) else of


def plain_kind(code: Code) -> Any:
    of = plain_type(code.type)
    return of.kind if isinstance(of, StateType) else None


def _has_elements(of: CType) -> bool:
    return isinstance(of, TupleType) or (isinstance(of, ArrayType) and of.listed)


def _is_tuple(term: Term) -> bool:
    return isinstance(term, TupleTerm) or (isinstance(term, Code) and isinstance(plain_type(term.type), TupleType))


def _is_none(term: Term) -> bool:
    return isinstance(term, Known) and term.value is None


def calls_in(node: ast.AST) -> bool:
    """True if evaluating an expression calls other code or assigns a name."""
    return any(isinstance(each, ast.Call | ast.NamedExpr | ast.Await) for each in ast.walk(node))


def _is_list(term: Term) -> bool:
    of = plain_type(term.type) if isinstance(term, Code) else term
    return isinstance(of, TupleTerm | TupleType) and of.kind is list


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
    """Return the type of a bool: one that may be numpy's if one of these terms is of numpy."""
    return numpy_number(BOOL, sure=False) if any(map(is_of_numpy, terms)) else BOOL
