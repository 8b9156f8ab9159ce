"""Python's own functions and those of math, on numbers and lists."""

from __future__ import annotations

import ast
import copy
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
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
    TupleType,
    joined,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.condition_code import calls_in
from umo.generate.expression_code import NUMBERS, is_of_numpy
from umo.generate.function_scope import TELLS
from umo.generate.math_code import OF_MATH, of_math, rounded
from umo.generate.terms import Code, Known, Many, Term, UnknownText
from umo.generate.translation import ControllerLimit
from umo.generate.value_kinds import is_container
from umo.generate.vector_code import VectorCode

EXACT: dict[Any, str] = {math.fabs: "umo_fabs"}
INEXACT: dict[Any, tuple[str, str]] = {
    math.sin: ("umo_sin", "!umo_is_finite({0})"), math.cos: ("umo_cos", "!umo_is_finite({0})"),
    math.tan: ("umo_tan", "!umo_is_finite({0})"), math.exp: ("umo_exp", ""), math.log: ("umo_log", "{0} <= 0"),
    math.asin: ("umo_asin", "umo_fabs({0}) > 1"), math.acos: ("umo_acos", "umo_fabs({0}) > 1"),
    math.atan: ("umo_atan", ""), math.log10: ("umo_log10", "{0} <= 0"),
}  # fmt: skip
TO_WHOLE: dict[Any, str] = {
    math.floor: "umo_floor",
    math.ceil: "umo_ceil",
    math.trunc: "umo_trunc",
    int: "umo_trunc",
    round: "umo_round_even",
}


MAKES_UP = sys.version_info >= (3, 12)
"""Whether `sum` of this Python makes up for what is lost when it rounds."""


class BuiltinCode(VectorCode):
    """The part of a function that calls min, max, abs, round, len, any, math ..."""

    def _of_python(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        """A function of Python itself, or of math; None: it is another one."""
        if target in (isinstance, hasattr, getattr, len, callable, type, range, zip, enumerate, reversed, tuple, list):
            return self._static(target, arguments, node)
        if target in (min, max):
            return self._extreme(target, arguments, node)
        one = arguments[0] if len(arguments) == 1 else None
        if one is not None and target in (sum, any, all) and not isinstance(one, Known):
            terms = self.parts(one, node.args[0])
            if target is sum and self.is_array(one) and plain_number(self.of(self.array(one, node))) == BOOL:
                raise self.refused(node, "sum of an array of bools", "np.sum, np.count_nonzero")
            return self._added(terms, node) if target is sum else self._any_or_all(target, terms, node)
        if target in OF_MATH:
            return of_math(self, target, arguments, node)
        if one is None:
            return self._of_two(target, arguments, node)
        if (
            isinstance(one, Known)
            and type(one.value) in NUMBERS
            and (target in TO_WHOLE or target in (abs, float, bool, math.sqrt))
        ):
            try:
                return Known(target(one.value))
            except (ArithmeticError, ValueError) as error:
                self.raises(type(error), node)
                return Known(0.0)
        return self._of_one(target, one, node)

    def _of_one(self, target: Any, one: Term, node: ast.Call) -> Term | None:
        if target is abs and self.is_array(one):
            return self.of_numpy(np.abs, [one], {}, node)
        if target is bool:
            truth = self.truth(one, node)
            return Known(truth) if isinstance(truth, bool) else Code(BOOL, f"({truth})")
        known = target in TO_WHOLE or target in (abs, float, math.isfinite, math.isnan, math.isinf, math.sqrt)
        if not (known or target in EXACT or target in INEXACT):
            return None
        code = self.number(one, node)
        if target is abs and code.type in (INT, BOOL):
            code = Code(INT, self.as_type(code, INT, node))
            kept = self.kept(code).text
            self.raises(ControllerLimit, node, f"{kept} == INT32_MIN")
            return Code(INT, f"({kept} < 0 ? -{kept} : {kept})")
        if target in TO_WHOLE:
            return self._whole(target, code, node)
        text = self.as_type(code, REAL, node)
        if target is float:
            return Code(REAL, text)
        if target in (abs, math.fabs):
            of = (
                one.type if target is abs and isinstance(one, Code) and not isinstance(one.type, OptionalType) else REAL
            )
            return Code(of, f"umo_fabs({text})")
        if target is math.isinf:
            kept = self.kept(Code(REAL, text)).text
            return Code(BOOL, f"(!umo_is_finite({kept}) && !umo_is_nan({kept}))")
        if target in (math.isfinite, math.isnan):
            return Code(BOOL, f"umo_is_{'finite' if target is math.isfinite else 'nan'}({text})")
        kept = self.kept(Code(REAL, text)).text
        if target is math.sqrt:
            self.raises(ValueError, node, f"{kept} < 0")
            return Code(REAL, f"umo_sqrt({kept})")
        return self._inexact(target, kept, node)

    def _inexact(self, target: Any, kept: str, node: ast.Call) -> Code:
        name, wrong = INEXACT[target]
        self.world.note_inexact(target.__name__)
        if wrong:
            self.raises(
                ValueError,
                node,
                f"!umo_is_nan({kept}) && {wrong.format(kept)}" if "finite" in wrong else wrong.format(kept),
            )
        result = self.kept(Code(REAL, f"{name}({kept})")).text
        if target is math.exp:
            self.raises(OverflowError, node, f"!umo_is_finite({result}) && umo_is_finite({kept})")
        return Code(REAL, result, stable=True)

    def _whole(self, target: Any, code: Code, node: ast.Call) -> Code:
        if code.type != REAL:
            return Code(INT, self.as_type(code, INT, node))
        kept = self.kept(code).text
        self.raises(ValueError, node, f"umo_is_nan({kept})")
        cut = self.kept(Code(REAL, f"{TO_WHOLE[target]}({kept})")).text
        self.raises(OverflowError, node, f"!umo_is_finite({kept})")
        self.raises(ControllerLimit, node, f"!umo_fits_int({cut})")
        return Code(INT, f"(int32_t){cut}")

    def _of_two(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        if len(arguments) != 2:
            return None
        if target is round:
            return rounded(self, arguments[0], arguments[1], node)
        if target is math.copysign:
            a, b = (self.as_type(self.number(each, node), REAL, node) for each in arguments)
            return Code(REAL, f"umo_copysign({a}, {b})")
        if target is math.atan2:
            self.world.note_inexact("atan2")
            a, b = (self.as_type(self.number(each, node), REAL, node) for each in arguments)
            return Code(REAL, f"umo_atan2({a}, {b})")
        return None

    def _extreme(self, target: Any, arguments: list[Term], node: ast.Call) -> Term:
        terms = self.parts(arguments[0], node) if len(arguments) == 1 else arguments
        if all(isinstance(each, Known) and type(each.value) in NUMBERS for each in terms):
            return Known(target(each.value for each in terms))  # type: ignore[union-attr]
        kinds = [plain(self.code(each, node).type) for each in terms]
        codes = [self.number(each, node) for each in terms]
        of = REAL if any(each.type == REAL for each in codes) else INT
        texts = [self.as_type(each, of, node) for each in codes]
        name = f"umo_{target.__name__}{'' if of == REAL else '_int'}"
        found = texts[0]
        for each in texts[1:]:
            found = f"{name}({found}, {each})"
        if any(isinstance(each, NumpyNumber) for each in kinds):
            if BOOL in map(plain_number, kinds):
                raise self.refused(node, "an extreme of bools of numpy", "and, or, bool(...)")
            sure = all(isinstance(each, NumpyNumber) and each.sure for each in kinds)
            return Code(numpy_number(of, sure), found)
        return Code(reduce(joined, kinds), found)

    def _static(self, target: Any, arguments: list[Term], node: ast.Call) -> Term:
        if target is len and isinstance(arguments[0], Code) and isinstance(arguments[0].type, ArrayType):
            self.check_length(arguments[0].type, node)
            return Known(arguments[0].type.length)
        if target is len and isinstance(arguments[0], Many):
            return Known(len(arguments[0].terms))
        if any(isinstance(each, Known) and isinstance(each.value, UnknownText) for each in arguments):
            raise self.refused(node, TELLS, "a state of an Enum")
        if target is isinstance and isinstance(arguments[0], Code) and isinstance(arguments[1], Known | Many):
            return self._is_instance(arguments[0], arguments[1], node)
        if target in (getattr, hasattr) and (found := self._attribute_by_name(target, arguments, node)) is not None:
            return found
        if (
            target in (tuple, list)
            and len(arguments) == 1
            and isinstance(arguments[0], Many)
            and arguments[0].kind is None
        ):
            return Many(arguments[0].terms, kind=list if target is list else None)
        if target in (len, zip, enumerate, reversed, tuple, list) and not all(map(_is_container, arguments[:1])):
            raise self.refused(node, f"{target.__name__} of what decides what its elements are", "a list, a tuple")
        if not all(isinstance(each, Known) for each in arguments):
            raise self.refused(node, f"{target.__name__} of something that is not known when the code is generated")
        return Known(target(*(each.value for each in arguments)))  # type: ignore[union-attr]

    def _attribute_by_name(self, target: Any, arguments: list[Term], node: ast.Call) -> Term | None:
        """`getattr` and `hasattr` of a live object; None: it is none, or has no such attribute."""
        if not all(isinstance(each, Known) for each in arguments[:2]):
            return None
        owner, name = (each.value for each in arguments[:2])  # type: ignore[union-attr]
        if target is getattr and hasattr(owner, name):
            return self.attribute(arguments[0], name, node)  # type: ignore[arg-type]
        self.takes(owner, name, node)
        return None

    def _over(self, target: Any, generator: ast.GeneratorExp, node: ast.Call) -> Term:
        """any, all or sum of an expression over objects."""
        if len(generator.generators) != 1 or generator.generators[0].is_async:
            raise self.refused(node, "two loops in one expression", "a loop for each")
        generator = _with_own_names(generator, f" {node.lineno} {node.col_offset}")
        first = generator.generators[0]
        if any(isinstance(each, ast.NamedExpr) for each in ast.walk(generator)):
            raise self.refused(node, "an assignment in a generator", "a loop")
        over = self.term(first.iter)
        elements = self.elements(over, first.iter)
        if not (isinstance(over, Code) and isinstance(over.type, ArrayType)):
            elements = [self.settled(each) for each in elements]
        at = len(self.lines)
        found = self._over_elements(target, generator, elements, node)
        calls = any(line.strip().startswith("fault = ") for line in self.lines[at:])
        if calls and isinstance(over, Code) and isinstance(over.type, ArrayType):
            raise self.refused(node, "code that may change what a generator goes through", "a loop")
        return found

    def _over_elements(self, target: Any, generator: ast.GeneratorExp, elements: list[Term], node: ast.Call) -> Term:
        first = generator.generators[0]
        if target is sum:
            if first.ifs:
                raise self.refused(node, "`if` in a sum", "a loop")
            return self._added(self._terms_over(generator, elements), node)
        result = self.temporary(BOOL, "c")
        end = self.label("found")
        self.line(f"{result} = {'false' if target is any else 'true'};", pure=True)
        at, names = len(self.lines), dict(self.names)
        for each in elements:
            on, known = self.label("next"), set(self.known)
            with self.bound_to(first.target, each):
                for test in first.ifs:
                    self._skip_unless(self.truth(self.term(test), test), on)
                    self.known |= self.proved(test) if not calls_in(test) else set()
                truth = self.truth(self.term(generator.elt), generator.elt)
            text = str(truth).lower() if isinstance(truth, bool) else truth
            with self.block(f"if ({text})" if target is any else f"if (!({text}))"):
                self.line(f"{result} = {'true' if target is any else 'false'};", pure=True)
                self.line(f"goto {end};", pure=True)
            self.known &= known
            self._place_label(on, at)
        self._place_label(end, at)
        self.names = names
        return Code(BOOL, result, stable=True)

    def _skip_unless(self, truth: str | bool, label: str) -> None:
        text = str(truth).lower() if isinstance(truth, bool) else truth
        with self.block(f"if (!({text}))"):
            self.line(f"goto {label};", pure=True)

    def _place_label(self, label: str, at: int) -> None:
        """A label, where a line from there on leads to it."""
        if any(f"goto {label};" in line for line in self.lines[at:]):
            self.line(f"{label}:;", pure=True)

    def _is_instance(self, value: Code, classes: Known | Many, node: ast.AST) -> Known:
        """`isinstance`, where every class that the value may have in Python gives the same."""
        terms = classes.terms if isinstance(classes, Many) else (classes,)
        wanted = tuple(each.value for each in terms if isinstance(each, Known))
        possible = _classes_of(value.type)
        answers = {issubclass(each, wanted) for each in possible}
        if len(answers) != 1 or len(wanted) != len(terms):
            raise self.refused(node, "the class of a value that may have another one", "a name for each class")
        return Known(answers.pop())

    def attribute(self, base: Known, name: str, node: ast.AST) -> Term:
        raise NotImplementedError

    def _terms_over(self, generator: ast.GeneratorExp, elements: Sequence[Term]) -> Iterator[Term]:
        names = dict(self.names)
        for each in elements:
            with self.bound_to(generator.generators[0].target, each):
                term = self.term(generator.elt)
                self.names = dict(names)
                yield self.kept(term) if isinstance(term, Code) else term  # the names stand for others in the next turn

    def _added(self, terms: Iterable[Term], node: ast.Call) -> Term:
        """A sum in the order of its terms. From Python 3.12 on `sum` makes up for what rounding loses (Neumaier); for
        its own numbers, not for those of numpy, and those after one."""
        total, lost, makes_up = self.number(Known(0), node), "", MAKES_UP
        of_numpy = False
        for each in terms:
            of_numpy |= is_of_numpy(each)
            makes_up = makes_up and not (isinstance(each, Code) and isinstance(each.type, NumpyNumber))
            self.check_sure([total, each], node)
            code = self.number(each, node)
            if lost and not makes_up:
                total, lost = Code(REAL, f"umo_added({total.text}, {lost})"), ""
            if makes_up and not lost and REAL == total.type == code.type:
                name, lost = self.temporary(REAL, "sum"), self.temporary(REAL, "lost")
                self.line(f"{name} = {total.text};", pure=True)
                self.line(f"{lost} = 0;", pure=True)
                total = Code(REAL, name)
            if not lost:
                total = self.arithmetic(ast.Add(), total, code, node)
            elif code.type == REAL:
                self.line(f"umo_add(&{total.text}, &{lost}, {code.text});", pure=True)
            else:
                self.line(f"{total.text} += {self.as_type(code, REAL, node)};", pure=True)
        total = Code(REAL, f"umo_added({total.text}, {lost})") if lost else total
        return Code(numpy_number(total.type, sure=False), total.text, total.stable) if of_numpy else total

    def _any_or_all(self, target: Any, terms: Sequence[Term], node: ast.Call) -> Term:
        truths = [self.truth(each, node) for each in terms]
        texts = [str(each).lower() if isinstance(each, bool) else f"({each})" for each in truths]
        return Code(BOOL, f"({(' || ' if target is any else ' && ').join(texts)})") if texts else Known(target(()))

    def elements(self, term: Term, node: ast.AST) -> list[Term]:
        raise NotImplementedError

    def bound_to(self, target: ast.AST, term: Term) -> Any:
        raise NotImplementedError


def _is_container(term: Term) -> bool:
    """Whether Python itself knows its elements."""
    return not isinstance(term, Known) or is_container(term.value)


def _classes_of(of: CType) -> tuple[type, ...]:
    """The classes that a value of this type may have in Python."""
    if isinstance(of, OptionalType):
        return (*_classes_of(of.of), type(None))
    if isinstance(of, NumpyNumber):
        own: tuple[type, ...] = {REAL: (np.float64,), INT: (np.int64,), BOOL: (np.bool_,)}[of.of]
        return own if of.sure else (*own, float, int, bool)
    if isinstance(of, ArrayType):
        return (list,) if of.listed else (np.ndarray,)
    if isinstance(of, StateType):
        return (of.kind,)
    if isinstance(of, TupleType):
        return (of.kind or tuple,)
    return {REAL: (float,), INT: (int, bool), BOOL: (bool,)}.get(of, (float, int, bool))


def _with_own_names(generator: ast.GeneratorExp, mark: str) -> ast.GeneratorExp:
    """The same, whose names are no names of the function around it."""
    copied = copy.deepcopy(generator)
    first = copied.generators[0]
    own = {each.id for each in ast.walk(first.target) if isinstance(each, ast.Name)}
    inner = [first.target, *first.ifs, copied.elt]
    for each in (one for part in inner for one in ast.walk(part)):
        if isinstance(each, ast.Name) and each.id in own:
            each.id += mark
    return copied
