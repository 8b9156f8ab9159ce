"""Expressions of Python. They are computed in the same order as in Python."""

from __future__ import annotations

import ast
import inspect
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum
from types import FunctionType
from typing import Any

from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.check.form_effects import changes
from umo.generate.form import (
    LEAST_INT,
    ZERO,
    CheckedArithmetic,
    Conditional,
    Element,
    Literal,
    Member,
    Operator,
    Runtime,
    Unary,
    Value,
    has,
    inside,
    is_named,
    joined,
    negated,
    whole,
)
from umo.generate.function_source import ABSENT
from umo.generate.lower.bit_operators import inverted, inverted_known, is_of_bits, of_bits, of_known
from umo.generate.lower.known_tables import element_of, element_of_terms, is_dict, is_table, value_of
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.lowered_values import NO_ELEMENTS
from umo.generate.lower.state_members import StateMethod, as_number, has_own_value, value_of_state
from umo.generate.lower.terms import (
    NO_VALUE,
    TEXT,
    Code,
    Elementwise,
    Known,
    OneOf,
    RecordReplace,
    Selection,
    Term,
    TupleTerm,
)
from umo.generate.lower.whole_powers import MOST_POWER, is_whole_power, whole_power
from umo.generate.translation import ControllerLimit
from umo.generate.value_kinds import is_container, is_immutable, is_plain_dataclass, is_plain_record, is_ring

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


class LoweredExpressions(LoweredSubject):
    """Lowers the expressions of a function."""

    # Names and numbers ---------------------------------------------------------------------------------

    def lower_constant(self, node: ast.Constant) -> Term:
        if type(node.value) not in CONSTANTS:
            raise self.f.refused(
                node, f"a {type(node.value).__name__} cannot be translated", "numbers, states, bools, None"
            )
        return Known(node.value)

    def lower_joined_str(self, node: ast.JoinedStr) -> Term:
        return self.f.texts.text(node)

    def lower_name(self, node: ast.Name) -> Term:
        found = self.f.flow.names.get(node.id)
        if isinstance(found, CType):
            return Code(found, self.f.local(node.id))
        if found is not None:
            return found
        if self.f.source.is_local(node.id):
            raise self.f.refused(node, *NO_VALUE)
        value = self.f.source.meaning(node.id)
        if value is ABSENT:
            raise self.f.refused(node, "the name is not defined")
        self.f.takes_variable(node.id, node)
        return Known(value, name=node.id)

    def lower_attribute(self, node: ast.Attribute) -> Term:
        if self.f.calls.is_super(node.value):
            return self.f.calls.of_super(node)
        return self.attribute_of(self.f.term(node.value), node)

    def attribute_of(self, base: Term, node: ast.Attribute) -> Term:
        if isinstance(base, OneOf):
            return self.f.choices.each(base, lambda each: self.attribute_of(each, node), node)
        if isinstance(base, Known):
            return self.f.attributes.attribute(base, node.attr, node)
        if isinstance(base, Code) and isinstance(base.type, OptionalType) and _has_attributes(base):
            return self.attribute_of(self._there(base, node), node)
        if self.f.arrays.is_array(base):
            return self.f.arrays.attribute_of_array(base, node.attr, node)  # type: ignore[arg-type]
        if isinstance(base, TupleTerm) and node.attr in base.names:
            return base.terms[base.names.index(node.attr)]
        if isinstance(base, Code) and isinstance(base.type, TupleType) and node.attr in dict(base.type.members):
            return Code(dict(base.type.members)[node.attr], Member(self.place(base).value, node.attr))
        kind = record_kind(base)
        if kind is not None:
            return self._of_record(base, kind, node)
        if isinstance(base, Code) and isinstance(base.type, StateType) and not isinstance(base.type, TextType):
            return self._of_member(base, base.type.kind, node)
        raise self.f.refused(node, "the object of this attribute is not known when the code is generated")

    def _there(self, base: Code, node: ast.Attribute) -> Code:
        """Return the value of an optional term whose attribute is read. Raises AttributeError if it is None and has no
        such attribute."""
        base = self.place(base)
        self.f.raises(AttributeError, node, negated(has(base.value)))
        return Code(plain(base.type), inside(base.value))

    def _of_record(self, base: Term, kind: Any, node: ast.Attribute) -> Term:
        """Return a property, a method or a class attribute of a NamedTuple or a dataclass."""
        static = inspect.getattr_static(kind, node.attr, None)
        self.f.takes(kind, node.attr, node)
        if type(static) is property and static.fget is not None:
            return self.f.calls.function(static.fget, [base], {}, node)
        if node.attr == "_replace" and is_plain_record(kind):
            return Known(RecordReplace(self.f.values.settled(base)))
        if isinstance(static, FunctionType) and not node.attr.startswith("_"):
            return Known(StateMethod(static, self.f.values.settled(base)))
        if static is None or isinstance(static, FunctionType) or hasattr(type(static), "__get__"):
            raise self.f.refused(
                node,
                f"the attribute {node.attr!r} of a {kind.__name__} cannot be translated",
                "a field, a property, a method",
            )
        return Known(static)

    def _of_member(self, base: Code, kind: Any, node: ast.Attribute) -> Term:
        """Return the value of a state, or a property or a method of the member."""
        static = inspect.getattr_static(kind, node.attr, None)
        self.f.takes(kind, node.attr, node)
        if node.attr == "name" and static is inspect.getattr_static(Enum, "name"):
            return Known(TEXT)
        if node.attr == "value" and not has_own_value(kind):
            return value_of_state(self.f, base, node)
        if type(static) is property and static.fget is not None:
            return self.f.calls.function(static.fget, [base], {}, node)
        if isinstance(static, FunctionType):
            return Known(StateMethod(static, self.f.values.kept(base)))
        raise self.f.refused(
            node, f"the attribute {node.attr!r} of a state cannot be translated", "value, a method, a property"
        )

    def place(self, code: Code) -> Code:
        """Return the value in a form whose members can be read."""
        return code if is_named(code.value) else self.f.values.kept(code)

    def lower_tuple(self, node: ast.Tuple) -> Term:
        return TupleTerm(tuple(self.f.sequences.spread(node.elts)))

    def lower_list(self, node: ast.List) -> Term:
        return TupleTerm(tuple(self.f.sequences.spread(node.elts)), kind=list)

    def lower_dict(self, node: ast.Dict) -> Term:
        """Return the table for a dict that is written out."""
        keys = [each for each in node.keys if each is not None]
        terms = [self.f.term(each) for pair in zip(keys, node.values, strict=False) for each in pair]
        known = [each.value for each in terms if isinstance(each, Known) and is_immutable(each.value)]
        if len(keys) < len(node.values) or len(known) < len(terms):
            raise self.f.refused(
                node, "the values of the dict are not known when the code is generated", "an `if` for each key"
            )
        return Known(dict(zip(known[::2], known[1::2], strict=True)))

    def lower_subscript(self, node: ast.Subscript) -> Term:
        if isinstance(node.slice, ast.Slice):
            return self.f.sequences.sliced(node, node.slice)
        base, index = self.base_and_index(node)
        if isinstance(base, Code) and isinstance(base.type, OptionalType):
            base = self.f.values.present(base, node.value)
        return self.element(base, index, node)

    def base_and_slice(self, node: ast.Subscript, ends: ast.Slice) -> tuple[Term, slice]:
        """Return the term that has the elements, and the slice."""
        given = [each or ast.copy_location(ast.Constant(None), node) for each in (ends.lower, ends.upper, ends.step)]
        with self.f.gathered() as needed:
            base, *terms = [self.f.term(each) for each in (node.value, *given)]
        if any(map(changes, needed)):
            raise self.f.refused(
                node, "finding the target runs code that changes something", "assign it to a name first"
            )
        self.f.statements += needed
        return base, self.f.sequences.part_of(terms, node)

    def base_and_index(self, node: ast.Subscript) -> tuple[Term, Term]:
        """Return the term that has the element, without copying it, and the index. A tuple is computed before its
        index."""
        with self.f.gathered() as of_base:
            base = self.f.term(node.value)
        with self.f.gathered() as of_index:
            index = self.f.term(node.slice)
        self.f.statements += of_base
        if any(map(changes, of_index)):
            place = whole(base.value) if isinstance(base, Code) else None
            if isinstance(base, TupleTerm) or (isinstance(base, Code) and isinstance(plain(base.type), TupleType)):
                base = self.f.values.settled(base)
            elif any(map(changes, of_base)) or place in self.f.world.memory.rebound or place in self.f.aliases.sole:
                raise self.f.refused(
                    node, "computing the index changes the container", "assign the index to a name first"
                )
        self.f.statements += of_index
        return base, index

    def element(self, base: Term, index: Term, node: ast.AST) -> Term:
        """Return one element of a tuple, a list, an array or a known value."""
        self.check_elements(base, node)
        self.f.texts.check_decided(index, node)
        if not (isinstance(base, Known) and is_dict(base.value)):
            index = as_number(self.f, index, node)
        if isinstance(base, Known) and is_ring(base.value):
            return self.f.rings.element(base, index, node)
        if isinstance(base, Selection):
            return self.f.rings.element_among(base, index, node)
        if isinstance(index, Known) and type(index.value) in (int, bool):
            count = self._count_of(base)
            if count and not -count <= index.value < count:
                self.f.raises(IndexError, node)
                index = Known(0)
        if isinstance(base, Known) and isinstance(index, Known):
            if is_container(base.value):
                self.f.world.memory.place_known(base.value)
                return Known(base.value[index.value])
            raise self.f.refused(node, f"{type(base.value).__name__} defines its elements itself", "a list, a tuple")
        if isinstance(base, Known) and isinstance(index, Code):
            if (found := self.f.choices.of_table(base.value, index, node)) is not None:
                return found
            if is_table(base.value):
                return element_of(self.f, base.value, index, node)
            if is_dict(base.value):
                return value_of(self.f, base.value, index, node)
        if isinstance(base, TupleTerm) and isinstance(index, Known):
            one: Term = base.terms[index.value]
            return one
        if isinstance(base, Code) and isinstance(base.type, TupleType) and isinstance(index, Known):
            name, of = base.type.members[index.value]
            return Code(of, Member(self.place(base).value, name))
        if isinstance(index, Code) and (terms := self._terms_of_tuple(base)):
            return element_of_terms(self.f, terms, index, node)
        if isinstance(base, Code) and isinstance(base.type, ArrayType):
            self.f.arrays.check_length(base.type, node)
            place = self.f.values.kept(base).value if isinstance(base, Elementwise) else base.value
            return Code(of_element(base.type), Element(place, self.index(base.type, index, node)))
        raise self.f.refused(node, *NO_ELEMENTS)

    def check_elements(self, term: Term, node: ast.AST) -> None:
        """Refuse a term without elements."""
        if is_plain_dataclass(kind := record_kind(term)):
            raise self.f.refused(node, f"a {kind.__name__} has no elements", "its fields")

    def _terms_of_tuple(self, base: Term) -> list[Term]:
        """Return the elements of a tuple of values, or of a list that is written out; empty for anything else."""
        if isinstance(base, TupleTerm):
            return list(base.terms)
        if isinstance(base, Code) and isinstance(base.type, TupleType):
            place = self.place(base).value
            return [Code(of, Member(place, name)) for name, of in base.type.members]
        return []

    def _count_of(self, base: Term) -> int:
        """Return the number of elements of a tuple, or of a list that is known or written out; 0 for anything else."""
        if isinstance(base, Known):
            return len(base.value) if is_table(base.value) else 0
        return len(self._terms_of_tuple(base))

    def index(self, of: ArrayType, index: Term, node: ast.AST) -> Value:
        """Return an index into an array. Raises IndexError beyond its ends."""
        if isinstance(index, Known) and type(index.value) is int and -of.length <= index.value < of.length:
            return Literal(index.value % of.length, INT)
        code = self.f.values.number(as_number(self.f, index, node), node)
        if code.type != INT:
            raise self.f.refused(node, "an index into a list must be an integer")
        return self.place_in(code, of.length, node)

    def place_in(self, code: Code, length: int, node: ast.AST) -> Value:
        """Return an index into `length` elements, counted from the end if negative. Raises IndexError beyond the
        ends."""
        place, number = self.f.values.kept(code).value, Literal(length, INT)
        below, above = Operator("<", place, Literal(-length, INT)), Operator(">=", place, number)
        self.f.raises(IndexError, node, Operator("||", below, above))
        return Conditional(Operator("<", place, ZERO), Operator("+", place, number), place)

    # Arithmetic ----------------------------------------------------------------------------------------

    def lower_unary_op(self, node: ast.UnaryOp) -> Term:
        term = self.f.term(node.operand)
        if isinstance(node.op, ast.Not):
            truth = self.f.values.truth(term, node.operand)
            return Known(not truth) if isinstance(truth, bool) else Code(BOOL, negated(truth))
        term = as_number(self.f, term, node.operand)
        if isinstance(term, Known) and type(term.value) in NUMBERS and type(node.op) in FOLDED:
            return Known(FOLDED[type(node.op)](term.value))
        if isinstance(term, Known) and type(term.value) in NUMBERS:
            return inverted_known(self.f, term.value, node)
        self.check_sure([term], node)
        if self.f.arrays.is_array(term):
            return self.f.arrays.of_array(node.op, term, node)
        code = self.f.values.number(term, node.operand)
        if isinstance(node.op, ast.Invert):
            return inverted(self.f, term, code, node)
        if isinstance(node.op, ast.UAdd):
            return code if code.type != BOOL else Code(INT, code.value)
        of = term.type if isinstance(term, Code) and is_of_numpy(term) else code.type
        if code.type == REAL:
            return Code(of, Unary("-", code.value))
        if of != code.type:
            raise self.f.refused(node, "- of a numpy integer cannot be translated", "int(...), or 0 - x")
        return self.arithmetic(ast.Sub(), Code(INT, ZERO), code, node)

    def lower_bin_op(self, node: ast.BinOp) -> Term:
        if self.f.texts.is_text(node):
            return self.f.texts.text(node)
        left, right = self.f.ordered([node.left, node.right])
        left, right = as_number(self.f, left, node.left), as_number(self.f, right, node.right)
        numbers = [each.value for each in (left, right) if isinstance(each, Known) and type(each.value) in NUMBERS]
        if len(numbers) == 2 and type(node.op) in FOLDED:
            if isinstance(node.op, ast.Pow) and float not in map(type, numbers) and numbers[1] > MOST_POWER:
                raise self.f.refused(node, f"a power of {numbers[1]} cannot be translated", "the number itself")
            try:
                found = FOLDED[type(node.op)](*numbers)
            except ArithmeticError as error:
                self.f.raises(type(error), node)
                is_real = float in map(type, numbers) or isinstance(node.op, ast.Div | ast.Pow)
                return Known(0.0 if is_real else 0)
            if not isinstance(found, complex):
                return Known(found)
            self.f.raises(ControllerLimit, node, text="the result is a complex number")
            return Known(0.0)
        if len(numbers) == 2 and is_of_bits(node.op):
            return of_known(self.f, node.op, numbers, node)
        if self.f.arrays.is_array(left) or self.f.arrays.is_array(right):
            return self.f.arrays.of_arrays(node.op, left, right, node)
        if (joined_ones := self.f.sequences.of_sequences(node.op, left, right, node)) is not None:
            return joined_ones
        return self.of_numbers(node.op, left, right, (node.left, node.right), node)

    def of_numbers(
        self, sign: ast.operator, left: Term, right: Term, nodes: tuple[ast.AST, ast.AST], node: ast.AST
    ) -> Code:
        """Return the result of an operator on numbers. Operators on numpy numbers raise nothing."""
        a, b = self.f.values.number(left, nodes[0]), self.f.values.number(right, nodes[1])
        if not isinstance(sign, ast.Div):
            self.check_sure([left, right], node)
        if not (is_of_numpy(left) or is_of_numpy(right)):
            if is_of_bits(sign):
                return of_bits(self.f, sign, (left, right), (a, b), node)
            if is_whole_power(sign, a, right):
                return whole_power(self.f, a, right.value, node)  # type: ignore[union-attr,arg-type]
            return self.arithmetic(sign, a, b, node)
        if {a.type, b.type} == {BOOL}:
            raise self.f.refused(node, "a numpy bool and another bool are combined by arithmetic", "int(...), and, or")
        sure = any(isinstance(each, Code) and getattr(each.type, "sure", False) for each in (left, right))
        if isinstance(sign, ast.Div) and (sure or (isinstance(right, Known) and right.value)):
            return Code(
                numpy_number(REAL, sure),
                Operator("/", self.f.values.as_type(a, REAL, node), self.f.values.as_type(b, REAL, node)),
            )
        if type(sign) not in CHECKED and not _is_like_python(sign, {a.type, b.type}, right):
            raise self.f.refused(node, "numpy and Python differ here if the divisor is 0", "float(...)")
        found = self.arithmetic(sign, a, b, node)
        return replace(found, type=numpy_number(found.type, sure))

    def check_sure(self, terms: Sequence[Term], node: ast.AST) -> None:
        """Refuse arithmetic whose result is a real in C but, in Python, might not be a float or might not be exact."""
        if any(map(_is_mixed, terms)) and not any(map(is_float, terms)):
            told = "the number may be an int or a float"
            raise self.f.refused(node, told, "0.0 instead of 0, float(...)")

    def arithmetic(self, sign: ast.operator, left: Code, right: Code, node: ast.AST) -> Code:
        if isinstance(sign, ast.Div) or REAL in (left.type, right.type):
            a, b = (self.f.values.as_type(each, REAL, node) for each in (left, right))
            return self._of_reals(sign, a, b, node)
        a, b = (self.f.values.as_type(each, INT, node) for each in (left, right))
        if type(sign) in CHECKED:
            result = self.f.temporary(INT, "n")
            self.f.add(CheckedArithmetic(CHECKED[type(sign)], result, a, b, self.f.fault(ControllerLimit, node)))
            return Code(INT, result)
        if isinstance(sign, ast.FloorDiv | ast.Mod):
            b = self._divisor(b, INT, node)
            if isinstance(sign, ast.FloorDiv) and (not isinstance(b, Literal) or b.value == -1):
                a = a if is_named(a) else self.f.values.kept(Code(INT, a)).value
                beyond = Operator("&&", Operator("==", b, Literal(-1, INT)), Operator("==", a, LEAST_INT))
                self.f.raises(ControllerLimit, node, beyond)
            return Code(INT, Runtime(f"umo_{'mod' if isinstance(sign, ast.Mod) else 'floor_div'}_int", (a, b)))
        if isinstance(sign, ast.Pow) and isinstance(b, Literal) and b.value < 0:
            base, power = (self.f.values.as_type(each, REAL, node) for each in (left, right))
            return self._power(base, power, node)
        raise self.f.refused(
            node, "this arithmetic of whole numbers cannot be translated", "+, -, *, //, %, /, ** with a known exponent"
        )

    def _of_reals(self, sign: ast.operator, a: Value, b: Value, node: ast.AST) -> Code:
        if type(sign) in CHECKED:
            return Code(REAL, Operator(SIGNS[type(sign)], a, b))
        if isinstance(sign, ast.Pow):
            return self._power(a, b, node)
        if not isinstance(sign, ast.Div | ast.FloorDiv | ast.Mod):
            raise self.f.refused(node, "this arithmetic cannot be translated", "+, -, *, /, //, %, **")
        b = self._divisor(b, REAL, node)
        if isinstance(sign, ast.Div):
            return Code(REAL, Operator("/", a, b))
        return Code(REAL, Runtime(f"umo_{'mod' if isinstance(sign, ast.Mod) else 'floor_div'}", (a, b)))

    def _power(self, a: Value, b: Value, node: ast.AST) -> Code:
        self.f.world.note_inexact("**")
        base, power = self.f.values.kept(Code(REAL, a)).value, self.f.values.kept(Code(REAL, b)).value
        finite = [Runtime("umo_is_finite", (each,)) for each in (base, power)]
        zero, negative = Operator("==", base, ZERO), Operator("<", power, ZERO)
        self.f.raises(ZeroDivisionError, node, joined("&&", [zero, negative, finite[1]]))
        broken = Operator("!=", Runtime("umo_floor", (power,)), power)
        self.f.raises(
            ControllerLimit,
            node,
            joined("&&", [Operator("<", base, ZERO), broken, finite[1]]),
            "the result is a complex number",
        )
        result = self.f.values.kept(Code(REAL, Runtime("umo_pow", (base, power)))).value
        self.f.raises(OverflowError, node, joined("&&", [negated(Runtime("umo_is_finite", (result,))), *finite]))
        return Code(REAL, result)

    def _divisor(self, divisor: Value, of: CType, node: ast.AST) -> Value:
        if isinstance(divisor, Literal):
            if not divisor.value:
                self.f.raises(ZeroDivisionError, node)
            return divisor
        named = divisor if is_named(divisor) else self.f.values.kept(Code(of, divisor)).value
        self.f.raises(ZeroDivisionError, node, Operator("==", named, ZERO))
        return named


def _is_like_python(sign: ast.operator, kinds: set[CType], right: Term) -> bool:
    """True if numpy divides these numbers as Python does: the divisor is known and not 0."""
    by_known = isinstance(right, Known) and bool(right.value)
    return by_known and (isinstance(sign, ast.Mod) or (isinstance(sign, ast.FloorDiv) and REAL not in kinds))


def _has_attributes(code: Code) -> bool:
    """True if an optional value is an array or a record when not None."""
    return isinstance(plain(code.type), ArrayType) or record_kind(code) is not None


def record_kind(term: Term) -> Any:
    """Return the NamedTuple or dataclass class of a value, or None."""
    kind = term.kind if isinstance(term, TupleTerm) else None
    if isinstance(term, Code) and isinstance(plain(term.type), TupleType):
        kind = plain(term.type).kind  # type: ignore[attr-defined]
    return None if kind in (tuple, list) else kind


def of_element(of: ArrayType) -> CType:
    return of.of if of.listed else numpy_number(of.of)


def is_of_numpy(term: Term) -> bool:
    return isinstance(term, Code) and isinstance(plain(term.type), NumpyNumber)


def _is_mixed(term: Term) -> bool:
    return isinstance(term, Code) and isinstance(of := plain(term.type), MixedNumber) and of.of == REAL


def is_float(term: Term) -> bool:
    """True if the value is also a float in Python."""
    if isinstance(term, Code):
        return plain_number(plain(term.type)) == REAL and not _is_mixed(term)
    return isinstance(term, Known) and isinstance(term.value, float)
