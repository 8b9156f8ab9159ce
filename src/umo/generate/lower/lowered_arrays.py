"""Arrays of numbers in C: element-wise operations become loops.

An array is a struct in C, so that it is assigned, passed and returned as a value. In Python it is shared: a change in
place is seen through all references. So an array is changed in place only if it has no other references; any other
change is refused."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    MaybeScalar,
    array,
    is_number,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.form import (
    LEAST_INT,
    ONE,
    ZERO,
    Assign,
    CheckedArithmetic,
    Conditional,
    Conversion,
    CountedLoop,
    CurrentIndex,
    Element,
    Elements,
    Literal,
    Operator,
    Runtime,
    Unary,
    Value,
    differs,
    is_named,
    negated,
    placed,
    walk,
)
from umo.generate.lower.array_functions import BINARY, CREATED, DTYPES, OF_ELEMENTS, REDUCED, WHOLE_BEFORE
from umo.generate.lower.lowered_expressions import CHECKED, SIGNS
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.numpy_functions import of_numbers, one_after_the_other, place_of, rolled, sign_of
from umo.generate.lower.terms import ArrayMethod, Code, Elementwise, Known, SliceView, Term, TruthTest, TupleTerm
from umo.generate.lower.whole_powers import MOST_POWER
from umo.generate.translation import ControllerLimit

OF_ARRAYS = ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow
EXACT_POWERS: dict[float, Callable[[Value], Value]] = {
    -1: lambda x: Operator("/", Literal(1.0, REAL), x),
    0: lambda _: Literal(1.0, REAL),
    0.5: lambda x: Runtime("umo_sqrt", (x,)),
    1: lambda x: x,
    2: lambda x: Operator("*", x, x),
}
MOST_SUMMED = 128
"""The number of elements that numpy sums in one block."""


class LoweredArrays(LoweredSubject):
    """The arrays of a function."""

    # Elements ------------------------------------------------------------------------------------------

    def is_array(self, term: Term) -> bool:
        if isinstance(term, Known):
            return isinstance(term.value, np.ndarray)
        of = plain(term.type) if isinstance(term, Code) else None
        return isinstance(of, ArrayType) and not of.listed

    def array(self, term: Term, node: ast.AST) -> Code:
        """Return an array or a number. None is refused, because numpy takes it as NaN or an object, or raises an
        error."""
        if isinstance(term, Known) and isinstance(term.value, int) and not isinstance(term.value, bool):
            term = Known(int(term.value))  # a Quality beside numbers of qualities
        code = self.f.values.code(term, node)
        self.f.values.check_there(code.type, "next to an array or in one", node)
        code = replace(code, type=plain_number(code.type))
        if not isinstance(code.type, ArrayType) and not is_number(code.type):
            raise self.f.refused(node, "the operand is neither an array nor a number")
        return code

    def length(self, codes: Sequence[Code], node: ast.AST) -> int:
        """Return the length of the result of these operands. A number or an array of one element counts as an array of
        any length."""
        types = [each.type for each in codes if isinstance(each.type, ArrayType)]
        found = {each.length for each in types}
        more = found - {1}
        if not found:
            raise self.f.refused(node, "an array of one number", "np.array([x])")
        if len(more) > 1:
            raise self.f.refused(
                node, f"the arrays have different lengths: {' and '.join(map(str, sorted(more)))} elements"
            )
        length = next(iter(more or found))
        strict = any(each.length == length and not each.loose for each in types)
        return length if strict else MaybeScalar(length)

    def length_of(self, code: Code, node: ast.AST) -> int:
        """Return the known length of an array."""
        assert isinstance(code.type, ArrayType)
        self.check_length(code.type, node)
        return code.type.length

    def check_length(self, of: ArrayType, node: ast.AST) -> None:
        """Refuse an array whose length is not known."""
        if of.loose:
            raise self.f.refused(
                node, "the array may have one or more elements in Python", "np.zeros(n), np.full(n, ...)"
            )

    def at(self, code: Code, of: CType, length: int) -> Value:
        """Return an element as this type."""
        if not isinstance(code.type, ArrayType):
            value, kind = self.f.values.kept(code).value, code.type
        else:
            kind = code.type.of
            value = code.value if isinstance(code, Elementwise) else Element(self.kept_place(code), CurrentIndex())
            if code.type.length == 1 < length:  # one for all
                value = placed(value, ZERO)
        return value if kind == of else Conversion(of, value)

    def kept_place(self, code: Code) -> Value:
        """Return an array as a variable or a field."""
        return (
            code.value if is_named(code.value) and not isinstance(code, Elementwise) else self.f.values.kept(code).value
        )

    def fill(self, place: Value, code: Elementwise, test: Value | None = None) -> None:
        """Add a loop that sets the elements of an array for which the condition holds. If elements of the same array
        are read at another index, they are copied first."""
        assert isinstance(code.type, ArrayType)
        length = code.type.length
        if _reads_elsewhere(place, code.value):
            code = Elementwise(code.type, Element(self.f.values.kept(code).value, CurrentIndex()))
        if test is not None and _reads_elsewhere(place, test):
            test = Element(self.f.values.kept(Elementwise(array(BOOL, length), test)).value, CurrentIndex())
        with self.each_place(length) as turn:
            step = Assign(Element(place, turn), placed(code.value, turn))
            if test is None:
                self.f.add(step)
            else:
                self.f.add_if(placed(test, turn), step)

    @contextmanager
    def each_place(self, length: int) -> Iterator[Value]:
        """Return a context for a loop over the indices of an array."""
        turn = self.f.temporary(INT, "k")
        with self.f.body_of() as body:
            yield turn
        self.f.add(CountedLoop(self.f.label("turn"), turn, ZERO, Literal(length, INT), 1, tuple(body)))

    def as_array(self, term: Term, of: ArrayType, node: ast.AST) -> Value:
        """Return a term as an array of this type."""
        code = self.array(term, node)
        if code.type.name == of.name and not isinstance(code, Elementwise):
            return code.value
        if isinstance(code.type, ArrayType) and code.type.length not in (1, of.length):
            raise self.f.refused(node, f"{code.type.length} elements where {of.length} were before")
        return self.f.values.kept(Elementwise(of, self.at(code, of.of, of.length))).value

    # Slices --------------------------------------------------------------------------------------------

    def sliced(self, term: Term, part: slice, node: ast.AST) -> Term:
        """Return a slice of an array: the elements of the array under other indices."""
        if isinstance(term, Known):
            self.f.world.memory.place_known(term.value)
            return Known(term.value[part])
        code = self.array(term, node)
        place, of = self.kept_place(code), code.type
        at, count = self._places(of, part, node)
        return SliceView(array(self.of(code), count), Element(place, at(CurrentIndex())), place, at)

    def _places(self, of: CType, part: slice, node: ast.AST) -> tuple[Callable[[Value], Value], int]:
        """Return the index of each element of a slice, and their number."""
        assert isinstance(of, ArrayType)
        self.check_length(of, node)
        first, end, step = part.indices(of.length)
        count = len(range(first, end, step))
        if not count:
            raise self.f.refused(node, "the slice has no elements", "other ends")

        def at(number: Value) -> Value:
            if isinstance(number, Literal):
                return Literal(first + step * int(number.value), INT)
            far = number if abs(step) == 1 else Operator("*", Literal(abs(step), INT), number)
            if step > 0:
                return far if first == 0 else Operator("+", far, Literal(first, INT))
            return Operator("-", Literal(first, INT), far)

        return at, count

    def set_slice(self, base: Code, part: slice, value: Term, node: ast.AST) -> None:
        """Set the elements of a slice to values that are computed first."""
        self.f.aliases.check_sole(base, node)
        self.f.aliases.changes.add(base.value)
        at, count = self._places(base.type, part, node)
        code = self._given(base, value, count, node)
        code = self.f.values.kept(code) if isinstance(code.type, ArrayType) else code
        each = self.at(code, self.of(base), count)
        with self.each_place(count) as turn:
            self.f.assign(Element(base.value, at(turn)), placed(each, turn))

    def _given(self, base: Code, value: Term, count: int, node: ast.AST) -> Code:
        """Return the values for this number of elements of an array."""
        code = self.array(self.listed(value, node) if isinstance(value, TupleTerm) else value, node)
        of = self.of(base)
        if of != REAL and self.of(code) not in (of, BOOL):  # numpy cuts them in silence
            raise self.f.refused(node, "the array is assigned numbers of another type", "a new array")
        if isinstance(code.type, ArrayType) and code.type.length not in (1, count):
            raise self.f.refused(
                node, "the slice is assigned an array of another length", "one number for all elements"
            )
        return code

    # Arithmetic ----------------------------------------------------------------------------------------

    def of_arrays(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Code:
        """Return the result of an operator between arrays, or an array and a number."""
        a, b = self.array(left, node), self.array(right, node)
        n, kinds = self.length((a, b), node), {self.of(a), self.of(b)}
        if isinstance(sign, ast.BitAnd | ast.BitOr | ast.BitXor):
            if kinds != {BOOL}:
                raise self.f.refused(node, "& and | are applied to numbers", "& and | of booleans")
            of_bools = {ast.BitAnd: "&&", ast.BitOr: "||", ast.BitXor: "!="}[type(sign)]
            return Elementwise(array(BOOL, n), Operator(of_bools, self.at(a, BOOL, n), self.at(b, BOOL, n)))
        if kinds == {BOOL} or type(sign) not in OF_ARRAYS:
            raise self.f.refused(
                node, "this arithmetic of arrays cannot be translated", "+, -, *, /, //, %, **, & and | of booleans"
            )
        if isinstance(sign, ast.Pow):
            return self._power(a, right, n, node)
        if REAL in kinds or isinstance(sign, ast.Div):
            return self._of_reals(sign, self.at(a, REAL, n), self.at(b, REAL, n), n)
        if isinstance(sign, ast.FloorDiv | ast.Mod):
            return self._divided(sign, self.at(a, INT, n), self.at(self.f.values.kept(b), INT, n), n, node)
        return self._checked(CHECKED[type(sign)], self.at(a, INT, n), self.at(b, INT, n), n, node)

    def _of_reals(self, sign: ast.operator, a: Value, b: Value, n: int) -> Code:
        if isinstance(sign, ast.FloorDiv | ast.Mod):
            function = "umo_mod" if isinstance(sign, ast.Mod) else "umo_np_floor_div"
            return Elementwise(array(REAL, n), Runtime(function, (a, b)))
        return Elementwise(array(REAL, n), Operator("/" if isinstance(sign, ast.Div) else SIGNS[type(sign)], a, b))

    def _divided(self, sign: ast.operator, a: Value, b: Value, n: int, node: ast.AST) -> Code:
        """Return the quotient. Integers divided by 0 are 0. Raises ControllerLimit beyond 32 bits."""
        if isinstance(sign, ast.FloorDiv):
            beyond = Operator("&&", Operator("==", b, Literal(-1, INT)), Operator("==", a, LEAST_INT))
            with self.each_place(n) as turn:
                self.f.raises(ControllerLimit, node, placed(beyond, turn))
        function = "umo_np_mod_int" if isinstance(sign, ast.Mod) else "umo_np_floor_div_int"
        return Elementwise(array(INT, n), Runtime(function, (a, b)))

    def of(self, code: Code) -> CType:
        """Return the type of the elements of an array."""
        return code.type.of if isinstance(code.type, ArrayType) else code.type

    def _power(self, base: Code, power: Term, n: int, node: ast.AST) -> Code:
        """Return a power that numpy computes exactly. Others are refused: numpy's own function gives other bits than
        that of the C library."""
        exponent = power.value if isinstance(power, Known) else None
        if self.of(base) == INT and type(exponent) is int and 0 <= exponent <= MOST_POWER:
            return self._whole_power(base, exponent, n, node)
        if self.of(base) != REAL or type(exponent) not in (int, float) or exponent not in EXACT_POWERS:
            nearest = "** -1, 0, 0.5, 1, 2; of whole numbers 0, 1, 2, 3 ...; x * x * x"
            raise self.f.refused(node, "this power of an array cannot be translated", nearest)
        return Elementwise(array(REAL, n), EXACT_POWERS[exponent](self.at(self.f.values.kept(base), REAL, n)))

    def _whole_power(self, base: Code, power: int, n: int, node: ast.AST) -> Code:
        one = Elementwise(array(INT, n), ONE)
        found, base = (base if power else one), self.f.values.kept(base)
        for bit in f"{power:b}"[1:]:
            each = self.at(found, INT, n)
            found = self._checked("mul", each, each, n, node)
            if bit == "1":
                found = self._checked("mul", self.at(found, INT, n), self.at(base, INT, n), n, node)
        return found

    def _checked(self, what: str, a: Value, b: Value, n: int, node: ast.AST) -> Code:
        """Return the result for integers. Raises ControllerLimit beyond 32 bits."""
        result, fault = self.f.temporary(array(INT, n)), self.f.fault(ControllerLimit, node)
        with self.each_place(n) as turn:
            self.f.add(CheckedArithmetic(what, Element(result, turn), placed(a, turn), placed(b, turn), fault))
        self.f.aliases.sole.add(result)
        return Code(array(INT, n), result)

    def of_array(self, sign: ast.unaryop, term: Term, node: ast.AST) -> Code:
        """Return the result of a unary operator on an array."""
        code = self.array(term, node)
        n, of = self.length((code,), node), self.of(code)
        if isinstance(sign, ast.Invert) and of == BOOL:
            return Elementwise(array(BOOL, n), negated(self.at(code, BOOL, n)))
        if isinstance(sign, ast.USub) and of == REAL:
            return Elementwise(array(REAL, n), Unary("-", self.at(code, REAL, n)))
        if isinstance(sign, ast.USub) and of == INT:
            return self._checked("sub", ZERO, self.at(code, INT, n), n, node)
        raise self.f.refused(node, "this operator of an array cannot be translated", "- of numbers, ~ of booleans")

    def compared_arrays(self, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code:
        if type(sign) not in SIGNS:
            raise self.f.refused(node, "`is` and `in` of arrays cannot be translated", "==, <, any(), all()")
        a, b = self.array(left, node), self.array(right, node)
        n, of = self.length((a, b), node), REAL if REAL in (self.of(a), self.of(b)) else INT
        return Elementwise(array(BOOL, n), Operator(SIGNS[type(sign)], self.at(a, of, n), self.at(b, of, n)))

    # Functions of numpy, methods -----------------------------------------------------------------------

    def of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """Return the result of a numpy function, or None if the function is not one of numpy, or cannot be
        translated."""
        others = {name: each for name, each in named.items() if name != "out"}
        out, found = named.get("out"), self._of_numpy(target, arguments, others, node)
        if found is None or out is None:
            return found
        if isinstance(out, Known):
            raise self.f.refused(node, "an array that is known when the code is generated is changed", "a new array")
        place = self.array(out, node)
        self.overwrite(place, found, node)
        return place

    def _of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        if target in CREATED:
            return self._created(target, arguments, named, node)
        if target is np.nan_to_num and named.keys() == {"nan"} and _is_zero(named["nan"]):
            named = {}
        if target in (np.nan_to_num, np.array, np.asarray, np.copy) and len(arguments) == 1 and not named:
            return self._converted(target, arguments[0], node)
        if named:
            return None
        if target is np.concatenate and len(arguments) == 1 and isinstance(arguments[0], TupleTerm):
            return one_after_the_other(self.f, arguments[0].terms, node)
        if not any(map(self.is_array, arguments)):
            return of_numbers(self.f, target, arguments, node)
        if target is np.roll and len(arguments) == 2:
            return rolled(self.f, arguments[0], arguments[1], node)
        if target in (np.argmin, np.argmax) and len(arguments) == 1:
            return place_of(self.f, target, arguments[0], node)
        if target in OF_ELEMENTS and len(arguments) == 1:
            return self._of_elements(target, self.array(arguments[0], node), node)
        if target in BINARY and len(arguments) == 2:
            sign = BINARY[target]
            if isinstance(sign, ast.operator):
                return self.of_arrays(sign, arguments[0], arguments[1], node)
            return self._extreme_of(sign, arguments, node)
        if target is np.where and len(arguments) == 3:
            return self._where(arguments[0], arguments[1], arguments[2], node)
        if target is np.clip and len(arguments) == 3:
            ends = "" if any(map(self.is_array, arguments[1:])) else "_keeping"  # numpy keeps zeros at constant bounds
            above = self._extreme_of(f"umo_np_max{ends}", arguments[:2], node)
            return self._extreme_of(f"umo_np_min{ends}", [above, arguments[2]], node)
        if target in REDUCED and len(arguments) == 1:
            code = self.array(arguments[0], node)
            return self.counted(code, node) if target is np.count_nonzero else self.reduced(REDUCED[target], code, node)
        return None

    def _of_elements(self, target: Any, code: Code, node: ast.AST) -> Code:
        """Apply a function to each element."""
        function, takes, gives = OF_ELEMENTS[target]
        n, of = self.length((code,), node), self.of(code)
        if gives == REAL and of == BOOL:
            raise self.f.refused(
                node, "numpy computes this operation on bools in 16 bits, or not at all", "astype(float)"
            )
        if target in WHOLE_BEFORE and of == INT:
            raise self.f.refused(node, "integers are rounded, which gives floats in some versions of numpy", "them")
        if of == INT and target in (np.abs, np.sign):
            takes = gives = INT
        each = self.at(code, takes, n)
        if target is np.sign:
            return Elementwise(array(gives, n), sign_of(each))
        if gives == INT:
            with self.each_place(n) as turn:
                self.f.raises(ControllerLimit, node, placed(Operator("==", each, LEAST_INT), turn))
            return Elementwise(array(INT, n), Conditional(Operator("<", each, ZERO), Unary("-", each), each))
        return Elementwise(array(gives, n), negated(each) if function == "!" else Runtime(function, (each,)))

    def _extreme_of(self, name: str, arguments: Sequence[Term], node: ast.AST) -> Code:
        a, b = (self.array(each, node) for each in arguments)
        n, kinds = self.length((a, b), node), {self.of(a), self.of(b)}
        if REAL in kinds:
            return Elementwise(array(REAL, n), Runtime(name, (self.at(a, REAL, n), self.at(b, REAL, n))))
        if kinds == {BOOL}:
            sign = "||" if name == "umo_np_max" else "&&"
            return Elementwise(array(BOOL, n), Operator(sign, self.at(a, BOOL, n), self.at(b, BOOL, n)))
        name = name.replace("_np_", "_").removesuffix("_keeping") + "_int"
        return Elementwise(array(INT, n), Runtime(name, (self.at(a, INT, n), self.at(b, INT, n))))

    def _where(self, condition: Term, one: Term, other: Term, node: ast.AST) -> Code:
        chosen, a, b = (self.array(each, node) for each in (condition, one, other))
        if self.of(chosen) != BOOL:
            raise self.f.refused(node, "the condition of `where` is not an array of bools")
        n, kinds = self.length((chosen, a, b), node), {self.of(a), self.of(b)}
        of = kinds.pop() if len(kinds) == 1 else REAL if REAL in kinds else INT
        return Elementwise(array(of, n), Conditional(self.at(chosen, BOOL, n), self.at(a, of, n), self.at(b, of, n)))

    def _created(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        value, like = CREATED[target]
        terms = list(arguments)
        rows = terms[0].value if isinstance(terms[0], Known) else None
        if isinstance(terms[0], TupleTerm) and all(isinstance(each, Known) for each in terms[0].terms):
            rows = tuple(each.value for each in terms[0].terms)  # type: ignore[union-attr]
        if isinstance(rows, tuple) and len(rows) == 2:  # rows that get a name each
            return TupleTerm((self._created(target, [Known(rows[1]), *terms[1:]], named, node),) * rows[0])
        first = terms.pop(0)
        filled: Term = Known(value) if value is not None else terms.pop(0)
        dtype = named.get("dtype", terms[0] if terms else None)
        given = self.array(first, node) if like else None
        length = self.length((given,), node) if given is not None else self._whole_of(first, node)
        code = self.array(filled, node)
        of = self.of(given) if given is not None else code.type
        if value is not None and given is None:
            of = REAL
        if dtype is not None:
            of = self._dtype(dtype, node)
        return Elementwise(array(of, length), self.at(code, of, length))

    def _whole_of(self, term: Term, node: ast.AST) -> int:
        if isinstance(term, Known) and type(term.value) is int and term.value > 0:
            return term.value
        raise self.f.refused(node, "the length of the array is not known when the code is generated", "np.zeros(3)")

    def _dtype(self, term: Term, node: ast.AST) -> CType:
        found = DTYPES.get(term.value) if isinstance(term, Known) else None
        if found is None:
            raise self.f.refused(
                node, "this type of number cannot be translated", "float, np.float64, np.int64, np.bool_"
            )
        return found

    def _converted(self, target: Any, term: Term, node: ast.AST) -> Code:
        if isinstance(term, TupleTerm):
            return self.listed(term, node)
        code = self.array(term, node)
        n, of = self.length((code,), node), self.of(code)
        if target is np.asarray and (isinstance(code, SliceView) or not isinstance(code, Elementwise)):
            return code
        each = self.at(code, of, n)
        return Elementwise(
            array(of, n), Runtime("umo_nan_to_num", (each,)) if target is np.nan_to_num and of == REAL else each
        )

    def listed(self, term: TupleTerm, node: ast.AST) -> Code:
        codes = [self.f.values.number(self.array(each, node), node) for each in term.terms]
        kinds = {each.type for each in codes}
        of = kinds.pop() if len(kinds) == 1 else REAL if REAL in kinds else INT
        kind = array(of, len(codes))
        result = self.f.temporary(kind)
        for number, each in enumerate(codes):
            self.f.assign(Element(result, Literal(number, INT)), self.f.values.as_type(each, of, node))
        self.f.aliases.sole.add(result)
        return Code(kind, result)

    def counted(self, code: Code, node: ast.AST) -> Term:
        """Return np.count_nonzero. If the array may have only one element, only the truth of the result can be used."""
        found = self.reduced("count", code, node)
        loose = isinstance(code.type, ArrayType) and code.type.loose
        return TruthTest(differs(found.value)) if loose else found

    def reduced(self, what: str, code: Code, node: ast.AST) -> Code:
        """Reduce an array to one number."""
        n, of = self.length((code,), node), self.of(code)
        if of == BOOL:
            what = {"max": "any", "min": "all"}.get(what, what)
        if what == "mean":
            total = self.reduced("sum", Elementwise(array(REAL, n), self.at(code, REAL, n)), node)
            return replace(total, value=Operator("/", total.value, Literal(n, REAL)))
        if what in ("any", "all", "count"):
            kind, first = (INT, ZERO) if what == "count" else (BOOL, Literal(what == "all", BOOL))
            sign = {"count": "+", "any": "||", "all": "&&"}[what]
            found = self._loop(kind, first, lambda so_far, each: Operator(sign, so_far, differs(each)), code, n)
            return replace(found, type=numpy_number(kind, sure=kind == BOOL))
        if what == "sum":
            self.check_length(array(of, n), node)
            return self._sum(code, n, of, node)
        name = f"umo_np_{what}" if of == REAL else f"umo_{what}_int"
        kind = REAL if of == REAL else INT
        code = Code(code.type, self.kept_place(code))
        start = Element(code.value, ZERO)
        found = self._loop(kind, start, lambda so_far, each: Runtime(name, (so_far, each)), code, n)
        return replace(found, type=numpy_number(kind))

    def _loop(self, kind: CType, start: Value, step: Callable[[Value, Value], Value], code: Code, n: int) -> Code:
        """Add a loop that applies `step` to the result so far and each element in turn."""
        each = self.at(code, self.of(code), n)
        result = self.f.temporary(kind, "r")
        self.f.assign(result, start)
        with self.each_place(n) as turn:
            self.f.assign(result, step(result, placed(each, turn)))
        return Code(kind, result)

    def _sum(self, code: Code, n: int, of: CType, node: ast.AST) -> Code:
        if of == REAL:
            if n > MOST_SUMMED:
                raise self.f.refused(node, f"the sum has {n} numbers", f"at most {MOST_SUMMED}, or a loop")
            numbers = Elements(self.kept_place(code))
            return self.f.values.kept(Code(numpy_number(REAL), Runtime("umo_sum", (numbers, Literal(n, INT)))))
        if of == BOOL:
            found = self._loop(INT, ZERO, lambda so_far, each: Operator("+", so_far, each), code, n)
            return replace(found, type=numpy_number(INT))
        each, result = self.at(code, INT, n), self.f.temporary(INT, "r")
        self.f.assign(result, ZERO)
        with self.each_place(n) as turn:
            self.f.add(
                CheckedArithmetic("add", result, result, placed(each, turn), self.f.fault(ControllerLimit, node))
            )
        return Code(numpy_number(INT), result)

    def attribute_of_array(self, code: Code, name: str, node: ast.AST) -> Term:
        if name in ("size", "shape"):
            length = self.length_of(code, node)
            return Known(length if name == "size" else (length,))
        return Known(ArrayMethod(code, name))

    def method_of_array(self, method: ArrayMethod, arguments: list[Term], node: ast.AST) -> Code:
        code, name = method.array, method.name
        if name == "copy" and not arguments:
            return self._converted(np.copy, code, node)
        if name == "astype" and len(arguments) == 1:
            of, n = self._dtype(arguments[0], node), self.length((code,), node)
            if (self.of(code), of) == (REAL, INT):
                raise self.f.refused(node, "floats of an array are converted to integers", "a loop with int()")
            return Elementwise(
                array(of, n), differs(self.at(code, self.of(code), n)) if of == BOOL else self.at(code, of, n)
            )
        if name in REDUCED.values() and name != "count" and not arguments:
            return self.reduced(name, code, node)
        if name in ("argmin", "argmax") and not arguments:
            return place_of(self.f, getattr(np, name), code, node)
        nearest = "any, all, sum, mean, max, min, argmax, argmin, copy, astype"
        raise self.f.refused(node, f"`{name}` of an array cannot be translated", nearest)

    # In place ------------------------------------------------------------------------------------------

    def overwrite(
        self, place: Code, value: Term, node: ast.AST, where: Code | None = None, by_place: bool = False
    ) -> None:
        """Replace all elements of an array, or those that a mask selects, each by the value at its index."""
        self.f.aliases.check_sole(place, node)
        self.f.aliases.changes.add(place.value)
        assert isinstance(place.type, ArrayType)
        of, n = place.type.of, place.type.length
        code = self._given(place, value, 1 if where is not None and not by_place else n, node)
        test = None if where is None else self.at(where, BOOL, n)
        self.fill(place.value, Elementwise(place.type, self.at(code, of, n)), test)


def _is_zero(term: Term) -> bool:
    """True if the term is known to be 0 and not -0.0."""
    return isinstance(term, Known) and repr(term.value) in ("0", "0.0")


def _reads_elsewhere(place: Value, value: Value) -> bool:
    """True if an element of an array is computed from another element of the same array."""
    elements = (each for each in walk(value) if isinstance(each, Element) and each.whole == place)
    return any(each.index != CurrentIndex() for each in elements)
