"""Functions of Python and of math on numbers and lists."""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Iterable, Sequence
from enum import Enum
from functools import reduce
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    NumpyNumber,
    OptionalType,
    StateType,
    TextType,
    TupleType,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.c_types import joined as joined_type
from umo.generate.form import (
    LEAST_INT,
    ONE,
    ZERO,
    Address,
    Assign,
    Conditional,
    Conversion,
    Literal,
    Operator,
    Runtime,
    RuntimeCall,
    Unary,
    Value,
    as_value,
    joined,
    negated,
)
from umo.generate.lower.known_tables import element_of_terms
from umo.generate.lower.lowered_expressions import NUMBERS, is_of_numpy
from umo.generate.lower.lowered_sequences import ITERATORS
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.math_functions import OF_MATH, of_math, rounded
from umo.generate.lower.sorted_lists import sorted_list
from umo.generate.lower.state_members import as_number, number_of
from umo.generate.lower.terms import Code, Known, OneOf, Selection, Term, TruePlaces, TupleTerm
from umo.generate.translation import ControllerLimit
from umo.generate.value_kinds import is_container, is_ring

EXACT: dict[Any, str] = {math.fabs: "umo_fabs"}
INEXACT: dict[Any, str] = {
    getattr(math, name): f"umo_{name}" for name in ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "log10")
}
TO_WHOLE: dict[Any, str] = {
    math.floor: "umo_floor",
    math.ceil: "umo_ceil",
    math.trunc: "umo_trunc",
    int: "umo_trunc",
    round: "umo_round_even",
}


KNOWN_ZERO = Known(0)
SUM_COMPENSATES = sys.version_info >= (3, 12)
"""True if `sum` of this Python compensates rounding."""


class LoweredBuiltins(LoweredSubject):
    """Lowers the calls of min, max, abs, round, len, any, math and others."""

    def of_python(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """Return the result of a built-in function or of a function of math, or None for other functions."""
        if target in (min, max) and len(arguments) == 1 and named.keys() == {"default"}:
            return self._extreme(target, arguments, node, named["default"])
        if target is sum and named.keys() == {"start"}:
            arguments, named = [*arguments, named["start"]], {}
        if named:
            return None
        if target in ITERATORS:
            told = f"the result of `{target.__name__}` is stored: it can be iterated only once"
            raise self.f.refused(node, told, "the head of a loop, list(...)")
        if target in (isinstance, hasattr, getattr, len, callable, type, range, tuple, list):
            return self._static(target, arguments, node)
        if target in (min, max):
            return self._extreme(target, arguments, node)
        if target is sum and len(arguments) == 2:
            return self.added(self.f.calls.parts(arguments[0], node), node, arguments[1])
        if target is sorted and len(arguments) == 1:
            return sorted_list(self.f, self.f.calls.parts(arguments[0], node), node)
        if target is divmod and len(arguments) == 2:
            return self._divided(arguments, node)
        one = arguments[0] if len(arguments) == 1 else None
        if one is not None and target in (sum, any, all) and not isinstance(one, Known):
            terms = self.f.calls.parts(one, node.args[0])
            if (
                target is sum
                and self.f.arrays.is_array(one)
                and plain_number(self.f.arrays.of(self.f.arrays.array(one, node))) == BOOL
            ):
                raise self.f.refused(
                    node, "the sum of an array of bools cannot be translated", "np.sum, np.count_nonzero"
                )
            return self.added(terms, node) if target is sum else self._any_or_all(target, terms, node)
        if target in OF_MATH:
            return of_math(self.f, target, arguments, node)
        if one is None:
            return self._of_two(target, arguments, node)
        one = as_number(self.f, one, node) if target in (int, float, abs, round) else one
        if (
            isinstance(one, Known)
            and type(one.value) in NUMBERS
            and (target in TO_WHOLE or target in (abs, float, bool, math.sqrt))
        ):
            try:
                return Known(target(one.value))
            except (ArithmeticError, ValueError) as error:
                self.f.raises(type(error), node)
                return Known(0.0)
        return self._of_one(target, one, node)

    def _of_one(self, target: Any, one: Term, node: ast.Call) -> Term | None:
        if target is abs and self.f.arrays.is_array(one):
            return self.f.arrays.of_numpy(np.abs, [one], {}, node)
        if target is bool:
            truth = self.f.values.truth(one, node)
            return Known(truth) if isinstance(truth, bool) else Code(BOOL, truth)
        known = target in TO_WHOLE or target in (abs, float, math.isfinite, math.isnan, math.isinf, math.sqrt)
        if not (known or target in EXACT or target in INEXACT):
            return None
        code = self.f.values.number(one, node)
        if target is abs and code.type in (INT, BOOL):
            code = Code(INT, self.f.values.as_type(code, INT, node))
            kept = self.f.values.kept(code).value
            self.f.raises(ControllerLimit, node, Operator("==", kept, LEAST_INT))
            return Code(INT, Conditional(Operator("<", kept, ZERO), Unary("-", kept), kept))
        if target in TO_WHOLE:
            return self._whole(target, code, node)
        value = self.f.values.as_type(code, REAL, node)
        if target is float:
            return Code(REAL, value)
        if target in (abs, math.fabs):
            of = (
                one.type if target is abs and isinstance(one, Code) and not isinstance(one.type, OptionalType) else REAL
            )
            return Code(of, Runtime("umo_fabs", (value,)))
        if target is math.isinf:
            kept = self.f.values.kept(Code(REAL, value)).value
            return Code(BOOL, Operator("&&", negated(_is_finite(kept)), negated(_is_nan(kept))))
        if target in (math.isfinite, math.isnan):
            return Code(BOOL, (_is_finite if target is math.isfinite else _is_nan)(value))
        kept = self.f.values.kept(Code(REAL, value)).value
        if target is math.sqrt:
            self.f.raises(ValueError, node, Operator("<", kept, ZERO))
            return Code(REAL, Runtime("umo_sqrt", (kept,)))
        return self._inexact(target, kept, node)

    def _inexact(self, target: Any, kept: Value, node: ast.Call) -> Code:
        self.f.world.note_inexact(target.__name__)
        if target in (math.sin, math.cos, math.tan):
            self.f.raises(ValueError, node, Operator("&&", negated(_is_nan(kept)), negated(_is_finite(kept))))
        if target in (math.log, math.log10):
            self.f.raises(ValueError, node, Operator("<=", kept, ZERO))
        if target in (math.asin, math.acos):
            self.f.raises(ValueError, node, Operator(">", Runtime("umo_fabs", (kept,)), ONE))
        result = self.f.values.kept(Code(REAL, Runtime(INEXACT[target], (kept,)))).value
        if target is math.exp:
            self.f.raises(OverflowError, node, Operator("&&", negated(_is_finite(result)), _is_finite(kept)))
        return Code(REAL, result)

    def _whole(self, target: Any, code: Code, node: ast.Call) -> Code:
        if code.type != REAL:
            return Code(INT, self.f.values.as_type(code, INT, node))
        kept = self.f.values.kept(code).value
        self.f.raises(ValueError, node, _is_nan(kept))
        cut = self.f.values.kept(Code(REAL, Runtime(TO_WHOLE[target], (kept,)))).value
        self.f.raises(OverflowError, node, negated(_is_finite(kept)))
        self.f.raises(ControllerLimit, node, negated(Runtime("umo_fits_int", (cut,))))
        return Code(INT, Conversion(INT, cut))

    def _of_two(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        if len(arguments) != 2:
            return None
        if target is round:
            return rounded(self.f, arguments[0], arguments[1], node)
        if target is math.copysign:
            a, b = (self.f.values.as_type(self.f.values.number(each, node), REAL, node) for each in arguments)
            if not isinstance(b, Literal):
                b = self.f.values.kept(Code(REAL, b)).value
                self.f.raises(ControllerLimit, node, _is_nan(b), "the sign of a NaN may differ in C")
            return Code(REAL, Runtime("umo_copysign", (a, b)))
        if target is math.atan2:
            self.f.world.note_inexact("atan2")
            a, b = (self.f.values.as_type(self.f.values.number(each, node), REAL, node) for each in arguments)
            return Code(REAL, Runtime("umo_atan2", (a, b)))
        return None

    def _divided(self, arguments: list[Term], node: ast.Call) -> TupleTerm:
        """Return the quotient, rounded down, and the remainder."""
        left, right = map(self.f.values.settled, arguments)
        nodes = node.args[0], node.args[1]
        signs: tuple[ast.operator, ...] = ast.FloorDiv(), ast.Mod()
        return TupleTerm(tuple(self.f.expressions.of_numbers(sign, left, right, nodes, node) for sign in signs))

    def _extreme(self, target: Any, arguments: list[Term], node: ast.Call, default: Term | None = None) -> Term:
        terms = self.f.calls.parts(arguments[0], node) if len(arguments) == 1 else arguments
        if not terms or (len(terms) == 1 and len(arguments) == 1):
            return self._of_few(terms, default, node)
        if all(isinstance(each, Known) and type(each.value) in NUMBERS for each in terms):
            return Known(target(each.value for each in terms))  # type: ignore[union-attr]
        if all(map(_is_state, terms)):
            return self.first_of(target, terms, terms, node)
        kinds = [plain(self.f.values.code(each, node).type) for each in terms]
        codes = [self.f.values.number(each, node) for each in terms]
        of = REAL if any(each.type == REAL for each in codes) else INT
        found, *rest = [self.f.values.as_type(each, of, node) for each in codes]
        for each in rest:
            found = Runtime(f"umo_{target.__name__}{'' if of == REAL else '_int'}", (found, each))
        if any(isinstance(each, NumpyNumber) for each in kinds):
            if BOOL in map(plain_number, kinds):
                raise self.f.refused(
                    node, "a minimum or maximum of numpy bools cannot be translated", "and, or, bool(...)"
                )
            sure = all(isinstance(each, NumpyNumber) and each.sure for each in kinds)
            return Code(numpy_number(of, sure), found)
        return Code(reduce(joined_type, kinds), found)

    def first_of(self, target: Any, terms: Sequence[Term], keys: Sequence[Term], node: ast.Call) -> Term:
        """Return the first element with the smallest (`min`) or largest key. A key is a number or an ordered state."""
        if len(terms) == 1:
            return terms[0]
        found = [number_of(self.f, each, node) for each in keys]
        if any(each is None for each in found):
            raise self.f.refused(
                node,
                "a minimum or maximum is chosen by something other than numbers or members of an IntEnum",
                "float(...)",
            )
        numbers = [self.f.values.number(each, node) for each in found if each is not None]
        of = REAL if any(each.type == REAL for each in numbers) else INT
        place, best = self.f.temporary(INT, "place"), self.f.temporary(of, "best")
        self.f.assign(place, ZERO)
        self.f.assign(best, self.f.values.as_type(numbers[0], of, node))
        for at, each in enumerate(numbers[1:], 1):
            value = self.f.values.as_type(each, of, node)
            test = Operator("<" if target is min else ">", value, best)
            self.f.add_if(test, Assign(place, Literal(at, INT)), Assign(best, value))
        objects = tuple(each for each in terms if isinstance(each, Known) and self.f.values.type_of(each) is None)
        if len(objects) == len(terms):
            return OneOf(place, objects)
        return element_of_terms(self.f, terms, Code(INT, place), node)

    def _of_few(self, terms: Sequence[Term], default: Term | None, node: ast.Call) -> Term:
        """Return the extreme of one element, which is compared with nothing, or of none."""
        if not terms and default is None:
            self.f.raises(ValueError, node)
            return Known(0.0)
        (found,) = terms or [default or Known(None)]
        return found

    def _static(self, target: Any, arguments: list[Term], node: ast.Call) -> Term:
        if target is len and isinstance(arguments[0], Known) and is_ring(arguments[0].value):
            return self.f.rings.count(arguments[0], node)
        if target is len and isinstance(arguments[0], Selection):
            return Code(INT, arguments[0].count)
        if target is len and (length := self._length(arguments[0], node)) is not None:
            return Known(length)
        if target is len and isinstance(arguments[0], Known) and isinstance(arguments[0].value, TruePlaces):
            found = self.f.arrays.of_numpy(np.count_nonzero, [arguments[0].value.array], {}, node)
            assert found is not None
            return found
        for each in arguments:
            self.f.texts.check_decided(each, node)
        if target is isinstance and isinstance(arguments[0], Code) and isinstance(arguments[1], Known | TupleTerm):
            return self._is_instance(arguments[0], arguments[1], node)
        if target in (getattr, hasattr) and (found := self._attribute_by_name(target, arguments, node)) is not None:
            return found
        if (
            target in (tuple, list)
            and len(arguments) == 1
            and isinstance(arguments[0], TupleTerm)
            and arguments[0].kind is None
        ):
            return TupleTerm(arguments[0].terms, kind=list if target is list else None)
        if target in (len, tuple, list) and not all(map(_is_container, arguments[:1])):
            raise self.f.refused(
                node, f"{target.__name__} is applied to an object whose class defines its elements", "a list, a tuple"
            )
        if not all(isinstance(each, Known) for each in arguments):
            raise self.f.refused(
                node, f"{target.__name__} is applied to something that is not known when the code is generated"
            )
        return Known(target(*(each.value for each in arguments)))  # type: ignore[union-attr]

    def _length(self, term: Term, node: ast.AST) -> int | None:
        """Return the length of a tuple, a list or an array, or None if it is a known value or has no length."""
        self.f.expressions.check_elements(term, node)
        of = term.type if isinstance(term, Code) else None
        if isinstance(of, ArrayType):
            self.f.arrays.check_length(of, node)
            return of.length
        if isinstance(of, TupleType):
            return len(of.members)
        return len(term.terms) if isinstance(term, TupleTerm) else None

    def _attribute_by_name(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        """Return `getattr` or `hasattr` of a live object, or None if it is not a live object or has no such
        attribute."""
        base, named = arguments[:2]
        if not (isinstance(base, Known) and isinstance(named, Known)):
            return None
        if target is getattr and hasattr(base.value, named.value):
            return self.f.attributes.attribute(base, named.value, node)
        self.f.takes(base.value, named.value, node)
        return None

    def _is_instance(self, value: Code, classes: Known | TupleTerm, node: ast.AST) -> Known:
        """Return `isinstance`, if the result is the same for all classes that the value may have in Python."""
        terms = classes.terms if isinstance(classes, TupleTerm) else (classes,)
        wanted = tuple(each.value for each in terms if isinstance(each, Known))
        possible = _classes_of(value.type)
        answers = {issubclass(each, wanted) for each in possible}
        if len(answers) != 1 or len(wanted) != len(terms):
            raise self.f.refused(node, "the value may be of another class", "one name per class")
        return Known(answers.pop())

    def added(self, terms: Iterable[Term], node: ast.Call, start: Term = KNOWN_ZERO) -> Term:
        """Return the sum in the order of the terms. From Python 3.12 on `sum` compensates the rounding of Python floats
        (Neumaier), but not that of numpy numbers, nor that of terms after a numpy number."""
        total, makes_up = self.f.values.number(start, node), SUM_COMPENSATES and not is_of_numpy(start)
        lost: Value | None = None
        of_numpy = is_of_numpy(start)
        for each in terms:
            of_numpy |= is_of_numpy(each)
            makes_up = makes_up and not (isinstance(each, Code) and isinstance(each.type, NumpyNumber))
            self.f.expressions.check_sure([total, each], node)
            code = self.f.values.number(each, node)
            if lost and not makes_up:
                total, lost = Code(REAL, Runtime("umo_added", (total.value, lost))), None
            if makes_up and not lost and REAL == total.type == code.type:
                name, lost = self.f.temporary(REAL, "sum"), self.f.temporary(REAL, "lost")
                self.f.assign(name, total.value)
                self.f.assign(lost, ZERO)
                total = Code(REAL, name)
            if lost is None:
                total = self.f.expressions.arithmetic(ast.Add(), total, code, node)
            elif code.type == REAL:
                self.f.add(RuntimeCall(Runtime("umo_add", (Address(total.value), Address(lost), code.value))))
            else:
                self.f.assign(total.value, Operator("+", total.value, self.f.values.as_type(code, REAL, node)))
        total = total if lost is None else Code(REAL, Runtime("umo_added", (total.value, lost)))
        return Code(numpy_number(total.type, sure=False), total.value) if of_numpy else total

    def _any_or_all(self, target: Any, terms: Sequence[Term], node: ast.Call) -> Term:
        truths = [as_value(self.f.values.truth(each, node)) for each in terms]
        return Code(BOOL, joined("||" if target is any else "&&", truths)) if truths else Known(target(()))


def _is_state(term: Term) -> bool:
    if isinstance(term, Known):
        return isinstance(term.value, Enum)
    return isinstance(term, Code) and isinstance(term.type, StateType) and not isinstance(term.type, TextType)


def _is_finite(value: Value) -> Value:
    return Runtime("umo_is_finite", (value,))


def _is_nan(value: Value) -> Value:
    return Runtime("umo_is_nan", (value,))


def _is_container(term: Term) -> bool:
    """True if Python itself finds its elements."""
    return not isinstance(term, Known) or is_container(term.value)


def _classes_of(of: CType) -> tuple[type, ...]:
    """Return the classes that a value of this type may have in Python."""
    if isinstance(of, OptionalType):
        return (*_classes_of(of.of), type(None))
    if isinstance(of, NumpyNumber):
        own: tuple[type, ...] = {REAL: (np.float64,), INT: (np.int64,), BOOL: (np.bool_,)}[of.of]
        return own if of.sure else (*own, float, int, bool)
    if isinstance(of, ArrayType):
        return (list,) if of.listed else (np.ndarray,)
    if isinstance(of, StateType):
        return (str if isinstance(of, TextType) else of.kind,)
    if isinstance(of, TupleType):
        return (of.kind or tuple,)
    return {REAL: (float,), INT: (int, bool), BOOL: (bool,)}.get(of, (float, int, bool))
