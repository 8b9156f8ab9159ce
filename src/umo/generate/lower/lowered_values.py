"""Converts terms to values of a type: numbers, states, tuples, optional values, conditions."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from enum import Enum
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    MASK,
    REAL,
    ArrayType,
    CType,
    MixedNumber,
    NumpyNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    is_number,
    list_of,
    numpy_number,
    plain,
    plain_number,
    state,
)
from umo.generate.form import (
    ONE,
    Conditional,
    Conversion,
    Element,
    Field,
    Literal,
    Member,
    NoneValue,
    Operator,
    OptionalValue,
    TupleOf,
    Unary,
    Value,
    differs,
    has,
    inside,
    is_place,
    is_settled,
    negated,
)
from umo.generate.lower.known_tables import OF_OBJECTS
from umo.generate.lower.live_fields import literal
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code, Elementwise, Known, NullTest, OneOf, Selection, Term, TruthTest, TupleTerm
from umo.generate.lower.text_states import truth_of_text
from umo.generate.value_kinds import NUMPY_NUMBERS, TRUTH, is_bare_enum, is_ring, own_methods, parts_of, refused_truth
from umo.objects import Quality

PLAIN_NAMES: dict[CType, str] = {REAL: "float", INT: "int", BOOL: "bool"}
OF_UNKNOWN_LENGTH = (
    "the length of the list is not known",
    "any, all, sum, min, max, len or next of it, whether it is empty, a loop",
)
NO_ELEMENTS = (
    "this is an element of something that is not a list or an array in C",
    "a list of floats or of ints, np.zeros(n)",
)
"""The reason why an element cannot be translated."""


class LoweredValues(LoweredSubject):
    """Lowers the values of a function."""

    def type_of(self, term: Term) -> CType | None:
        """Return the type of a term, or None if the term is not a value that a controller can have."""
        if isinstance(term, Code):
            return term.type
        if isinstance(term, TupleTerm):
            types = [self.type_of(each) for each in term.terms]
            return self.f.world.fields.tuple_type(types, term.names, term.kind or tuple)
        if isinstance(term, NullTest | TruthTest | OneOf | Selection):
            return None
        found = self.f.world.fields.type_of_value(term.value)
        return None if isinstance(found, ArrayType) and not isinstance(term.value, np.ndarray) else found

    def kept(self, code: Code, what: str = "t") -> Code:
        """Return the value under a new name, if it has none."""
        if not isinstance(code, Elementwise) and is_settled(code.value):
            return code
        name = self.f.temporary(code.type, what)
        if isinstance(code, Elementwise):
            self.f.arrays.fill(name, code)
        else:
            self.f.assign(name, code.value)
        return Code(code.type, name)

    def copied(self, code: Code) -> Code:
        """Return the value copied to a new name."""
        name = self.f.temporary(code.type)
        self.f.assign(name, code.value)
        return Code(code.type, name)

    def is_list_itself(self, term: Term) -> bool:
        """True if the term is the list of an attribute itself, so that changes of the list are seen here."""
        if not (isinstance(term, Code) and isinstance(term.type, ArrayType)):
            return False
        return term.type.listed and isinstance(term.value, Field) and term.value not in self.f.world.memory.rebound

    def settled(self, term: Term) -> Term:
        """Return the term with its values stored such that later statements cannot change them."""
        if isinstance(term, Code):
            if isinstance(plain(term.type), ArrayType):
                self.f.aliases.share(term)
            return self.kept(term)
        if isinstance(term, TupleTerm):
            return TupleTerm(tuple(map(self.settled, term.terms)), term.names, term.kind)
        if isinstance(term, NullTest | TruthTest):
            return type(term)(self.kept(Code(BOOL, term.test)).value)
        return term

    def code(self, term: Term, node: ast.AST) -> Code:
        """Return a term as a value in C."""
        if isinstance(term, Code):
            return term
        if isinstance(term, Known):
            self.f.texts.check_decided(term, node)
            value = term.value
            if isinstance(value, np.generic) and not isinstance(value, NUMPY_NUMBERS):
                raise self.f.refused(node, f"a {type(value).__name__} of numpy", "np.float64, np.int64, float(...)")
            of = self.f.world.fields.type_of_value(value)
            if of is not None and is_number(of) and isinstance(value, np.generic):
                return Code(numpy_number(of), self.literal(value.item(), of, node))
            if of is not None and (is_number(of) or isinstance(of, StateType)):
                return Code(of, self.literal(value, of, node))
            if isinstance(of, ArrayType):
                self.f.world.memory.place_known(value)
                name = self.f.temporary(of)
                for number, each in enumerate(value):
                    self.f.assign(Element(name, Literal(number, INT)), self.literal(each, of.of, node))
                return Code(of, name)
            of = of or self.f.world.fields.record_type(value)
            if isinstance(of, TupleType):
                names = tuple(name for name, _ in of.members)
                return self.made(TupleTerm(tuple(map(Known, parts_of(value))), names, of.kind), of, node)
            raise self.f.refused(node, f"{_told(value)} is not a number or a state on the controller", "an Enum")
        if isinstance(term, TupleTerm):
            types = [self.code(each, node).type for each in term.terms]
            of = self.f.world.fields.tuple_type(list(types), term.names, term.kind or tuple)
            if of is None:
                raise self.f.refused(node, "a tuple with elements other than Python numbers", "float(...), int(...)")
            return self.made(term, of, node)
        raise self.f.refused(node, *only_asked(term))

    def new_list(self, terms: Sequence[Term], node: ast.AST) -> Code | None:
        """Return a new list with these numbers, or None if the numbers have different classes, or if there are none."""
        codes = [self.code(each, node) for each in terms]
        if len({each.type for each in codes}) != 1 or not is_number(codes[0].type):
            return None
        of = list_of(codes[0].type, len(codes))
        result = self.f.temporary(of)
        for number, each in enumerate(codes):
            self.f.assign(Element(result, Literal(number, INT)), each.value)
        self.f.aliases.sole.add(result)
        return Code(of, result)

    def literal(self, value: Any, of: CType, node: ast.AST) -> Value:
        try:
            return literal(value, of)
        except (ValueError, OverflowError):
            raise self.f.refused(node, f"{value} does not fit 32 bits", "a smaller number, or a float") from None

    def made(self, term: TupleTerm, of: TupleType, node: ast.AST) -> Code:
        for each, (_, kind) in zip(term.terms, of.members, strict=True):
            given = self.code(each, node).type if isinstance(each, Known | Code) else kind
            self.check_there(given, "in a tuple", node)
            if isinstance(given, NumpyNumber):
                raise self.f.refused(
                    node, "a tuple cannot contain a number of numpy", "float(...), int(...), bool(...)"
                )
            if (kind == REAL and plain_number(given) != REAL) or isinstance(given, MixedNumber):
                raise self.f.refused(node, "an int takes the place of a float in the tuple", "0.0, float(...)")
            if kind == INT and given == BOOL:
                raise self.f.refused(node, "a bool takes the place of an int in the tuple", "int(...)")
        parts = [self.as_type(each, kind, node) for each, (_, kind) in zip(term.terms, of.members, strict=True)]
        return Code(of, TupleOf(of, tuple(parts)))

    def as_type(self, term: Term, of: CType, node: ast.AST) -> Value:
        """Return a term as a value of this type."""
        if isinstance(of, ArrayType):
            return self.f.arrays.as_array(term, of, node)
        of = plain_number(of)
        if isinstance(term, Known):
            if isinstance(of, OptionalType) and term.value is None:
                return NoneValue(of)
            if of == MASK:
                return literal(term.value, MASK)
            if of == REAL and type(term.value) in (int, float, bool):
                return self.literal(term.value, REAL, node)
        if isinstance(term, TupleTerm) and isinstance(of, TupleType):
            return self.made(term, of, node).value
        code = self.code(term, node).as_plain
        if code.type == of or (isinstance(of, OptionalType) and code.type.name == of.name):
            return code.value
        if isinstance(of, OptionalType):
            return OptionalValue(of, self.as_type(code, of.of, node))
        if isinstance(code.type, OptionalType):
            return self.as_type(self.present(code, node), of, node)
        if is_number(of) and is_number(code.type):
            if not _widens(code.type, of):
                kinds = {REAL: "a real number", INT: "a whole number", BOOL: "a bool"}
                nearest = f"{PLAIN_NAMES[of]}(...), or {kinds[code.type]} from the start"
                raise self.f.refused(node, f"{kinds[code.type]} where {kinds[of]} was before", nearest)
            if of == INT and isinstance(code.value, Operator | Unary):
                # of a bool: gcc warns if a converted comparison is compared with a number
                return Conditional(code.value, literal(1, INT), literal(0, INT))
            return Conversion(of, code.value)
        if of == MASK and code.type == state(Quality):
            return Operator("<<", Conversion(MASK, ONE), code.value)
        if isinstance(of, TupleType) and isinstance(code.type, TupleType):
            kept = self.kept(code).value
            terms = tuple(Code(kind, Member(kept, name)) for name, kind in code.type.members)
            return self.made(TupleTerm(terms), of, node).value
        raise self.f.refused(node, f"a {code.type.name} where a {of.name} was before", "one type for each name")

    def present(self, code: Code, node: ast.AST) -> Code:
        """Return the value of an optional term. Raises TypeError if it is None."""
        if not isinstance(code.type, OptionalType):
            return code
        code = code if is_place(code.value) else self.kept(code)
        self.f.raises(TypeError, node, negated(has(code.value)))
        return Code(plain(code.type), inside(code.value))

    def check_there(self, of: CType | None, where: str, node: ast.AST) -> None:
        """Refuse a type whose values may be None."""
        if isinstance(of, OptionalType):
            raise self.f.refused(node, f"a value that may be None stands {where}", "`if x is not None`")

    def number(self, term: Term, node: ast.AST) -> Code:
        code = self.present(self.code(term, node), node).as_plain
        if not is_number(code.type):
            raise self.f.refused(node, "the value is not a number")
        return code

    def truth(self, term: Term, node: ast.AST) -> Value | bool:
        """Return the truth of a term as a condition; as a bool if it is already known."""
        if isinstance(term, Known):
            self.f.texts.check_decided(term, node)
            if is_ring(term.value):
                return differs(self.f.rings.count(term, node).value)
            if refused_truth(term.value):
                raise self.f.refused(node, f"{type(term.value).__name__} defines its own truth value", "a comparison")
            return bool(term.value)
        if isinstance(term, NullTest | TruthTest):
            return term.test
        if isinstance(term, TupleTerm):
            return bool(term.terms)
        if isinstance(term, Selection):
            return differs(term.count)
        if isinstance(term, OneOf):
            if all(self.truth(each, node) is True for each in term.options):
                return True
            raise self.f.refused(node, *only_asked(term))
        term = term.as_plain
        if isinstance(term.type, OptionalType):
            place = term.value if is_place(term.value) else self.kept(term).value
            inner = self.truth(Code(term.type.of, inside(place)), node)
            return has(place) if isinstance(inner, bool) else Operator("&&", has(place), inner)
        if term.type == BOOL:
            return term.value
        if term.type in (REAL, INT, MASK):
            return differs(term.value)
        if isinstance(term.type, TextType):
            return truth_of_text(self.f, term)
        if isinstance(term.type, TupleType) or (isinstance(term.type, ArrayType) and term.type.listed):
            return True  # none is empty
        if isinstance(term.type, StateType):
            if own_methods(term.type.kind, TRUTH):
                raise self.f.refused(
                    node, f"{term.type.kind.__name__} defines its own truth value", "`is`, with a state"
                )
            if is_bare_enum(term.type.kind):
                return True
            zeros = [n for n, each in enumerate(term.type.kind) if not each]
            return Operator("!=", term.value, Literal(zeros[0], INT)) if zeros else True
        raise self.f.refused(node, "its truth value is not known on the controller", "any(), all()")


def _widens(one: CType, other: CType) -> bool:
    """True if each value of one type is also a value of the other."""
    return one == other or other == REAL or (one == BOOL and other == INT)


def only_asked(term: NullTest | TruthTest | OneOf | Selection) -> tuple[str, str]:
    """Return the reason why this is not a value, and the nearest alternative."""
    if isinstance(term, Selection):
        return OF_UNKNOWN_LENGTH
    if isinstance(term, OneOf):
        return OF_OBJECTS
    if isinstance(term, NullTest):
        return "only whether it is None is known on the controller", "is None, is not None"
    return "the two values have different types", "bool(...), one type for both"


def _told(value: object) -> str:
    if value is None:
        return "None"
    if isinstance(value, str | Enum):
        return repr(value)
    return f"a {type(value).__name__}"
