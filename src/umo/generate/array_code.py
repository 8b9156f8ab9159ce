"""Arrays of numbers as C: what is computed element by element becomes loops.

An array is a struct in C, so that it is assigned, passed and returned as a value. In Python it is shared: whoever
changes it in place changes it for all who have it. So only an array that nobody else has is changed in place; anything
else is refused.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from umo.generate.array_functions import BINARY, CREATED, DTYPES, OF_ELEMENTS, REDUCED
from umo.generate.c_types import (
    BOOL,
    INT,
    REAL,
    ArrayType,
    CType,
    Loose,
    array,
    is_number,
    numpy_number,
    plain,
    plain_number,
)
from umo.generate.condition_code import ConditionCode
from umo.generate.expression_code import CHECKED, SIGNS
from umo.generate.terms import Code, Elements, Known, Many, Present, Term
from umo.generate.translation import ControllerLimit

MOST_SUMMED = 128
"""Numbers that numpy sums in one block."""
HERE = "@"
"""Stands for the place in the text of an element."""


@dataclass(frozen=True)
class ArrayMethod:
    """A method of an array."""

    array: Code
    name: str


class ArrayCode(ConditionCode):
    """The part of a function that computes with arrays."""

    # Elements ------------------------------------------------------------------------------------------

    def is_array(self, term: Term) -> bool:
        if isinstance(term, Known):
            return isinstance(term.value, np.ndarray)
        of = plain(term.type) if isinstance(term, Code) else None
        return isinstance(of, ArrayType) and not of.listed

    def array(self, term: Term, node: ast.AST) -> Code:
        """An array, or a number; TypeError where it is None."""
        if isinstance(term, Known) and isinstance(term.value, int) and not isinstance(term.value, bool):
            term = Known(int(term.value))  # a Quality beside numbers of qualities
        code = self.present(self.code(term, node), node)
        code = replace(code, type=plain_number(code.type))
        if not isinstance(code.type, ArrayType) and not is_number(code.type):
            raise self.refused(node, "it is neither an array nor a number")
        return code

    def length(self, codes: Sequence[Code], node: ast.AST) -> int:
        """The length of what is computed of these; numbers and arrays of one element are taken for each."""
        types = [each.type for each in codes if isinstance(each.type, ArrayType)]
        found = {each.length for each in types}
        more = found - {1}
        if len(more) > 1:
            raise self.refused(node, f"arrays of {' and '.join(map(str, sorted(more)))} elements")
        length = next(iter(more or found))
        strict = any(each.length == length and not each.loose for each in types)
        return length if strict else Loose(length)

    def check_length(self, of: ArrayType, node: ast.AST) -> None:
        """The length is known."""
        if of.loose:
            raise self.refused(node, "it may have one element in Python, or more", "np.zeros(n), np.full(n, ...)")

    def at(self, code: Code, of: CType, length: int) -> str:
        """The text of an element, as this type."""
        if not isinstance(code.type, ArrayType):
            text, kind = self.kept(code).text, code.type
        else:
            kind = code.type.of
            text = code.text if isinstance(code, Elements) else f"{self.kept_place(code)}.at[{HERE}]"
            if code.type.length == 1 < length:  # one for all
                text = text.replace(HERE, "0")
        if kind == of:
            return text
        return f"({of.name})({text})"

    def kept_place(self, code: Code) -> str:
        """The text of an array as a variable or a field."""
        named = code.text.replace("->", "").replace(".", "").replace("_", "").isalnum()
        return code.text if named and not isinstance(code, Elements) else self.kept(code).text

    def kept(self, code: Code, what: str = "t") -> Code:
        if not isinstance(code, Elements):
            return super().kept(code, what)
        name = self.temporary(code.type, what)
        self.fill(name, code)
        return Code(code.type, name, stable=True)

    def fill(self, place: str, code: Elements, condition: str = "") -> None:
        """A loop that sets the elements of an array, those for which the condition holds."""
        assert isinstance(code.type, ArrayType)
        turn = self.temporary(INT, "k")
        with self.block(f"for ({turn} = 0; {turn} < {code.type.length}; {turn}++)"):
            if condition:
                self.line(f"if ({condition.replace(HERE, turn)})", pure=True)
            lead = "    " if condition else ""
            self.line(f"{lead}{place}.at[{turn}] = {code.text.replace(HERE, turn)};", pure=True)

    def as_type(self, term: Term, of: CType, node: ast.AST) -> str:
        if not isinstance(of, ArrayType):
            return super().as_type(term, of, node)
        code = self.array(term, node)
        if code.type.name == of.name and not isinstance(code, Elements):
            return code.text
        if isinstance(code.type, ArrayType) and code.type.length not in (1, of.length):
            raise self.refused(node, f"{code.type.length} elements where {of.length} were before")
        return self.kept(Elements(of, self.at(code, of.of, of.length))).text

    # Arithmetic ----------------------------------------------------------------------------------------

    def of_arrays(self, sign: ast.operator, left: Term, right: Term, node: ast.AST) -> Code:
        """An operator between arrays, or an array and a number."""
        a, b = self.array(left, node), self.array(right, node)
        n, kinds = self.length((a, b), node), {self.of(a), self.of(b)}
        if isinstance(sign, ast.BitAnd | ast.BitOr | ast.BitXor):
            if kinds != {BOOL}:
                raise self.refused(node, "& and | of numbers", "of booleans")
            text = {ast.BitAnd: "&&", ast.BitOr: "||", ast.BitXor: "!="}[type(sign)]
            return Elements(array(BOOL, n), f"({self.at(a, BOOL, n)} {text} {self.at(b, BOOL, n)})")
        if kinds == {BOOL} or (type(sign) not in CHECKED and not isinstance(sign, ast.Div | ast.Pow)):
            raise self.refused(node, "this arithmetic of arrays does not translate", "+, -, *, /, & and | of booleans")
        if isinstance(sign, ast.Pow):
            return self._squared(a, right, n, node)
        if REAL in kinds or isinstance(sign, ast.Div):
            text = "/" if isinstance(sign, ast.Div) else SIGNS[type(sign)]
            return Elements(array(REAL, n), f"({self.at(a, REAL, n)} {text} {self.at(b, REAL, n)})")
        return self._checked(CHECKED[type(sign)], self.at(a, INT, n), self.at(b, INT, n), n, node)

    def of(self, code: Code) -> CType:
        """The type of its elements."""
        return code.type.of if isinstance(code.type, ArrayType) else code.type

    def _squared(self, base: Code, power: Term, n: int, node: ast.AST) -> Code:
        if not (isinstance(power, Known) and power.value == 2 and self.of(base) == REAL):
            raise self.refused(node, "a power of an array", "** 2")
        text = self.at(Code(base.type, self.kept(base).text, stable=True), REAL, n)
        return Elements(array(REAL, n), f"({text} * {text})")

    def _checked(self, what: str, a: str, b: str, n: int, node: ast.AST) -> Code:
        """Whole numbers: ControllerLimit beyond 32 bits."""
        result, turn = self.temporary(array(INT, n)), self.temporary(INT, "k")
        with self.block(f"for ({turn} = 0; {turn} < {n}; {turn}++)"):
            a, b = a.replace(HERE, turn), b.replace(HERE, turn)
            self.raises(ControllerLimit, node, f"__builtin_{what}_overflow({a}, {b}, &{result}.at[{turn}])")
        self.sole.add(result)
        return Code(array(INT, n), result, stable=True)

    def of_array(self, sign: ast.unaryop, term: Term, node: ast.AST) -> Code:
        """An operator before an array."""
        code = self.array(term, node)
        n, of = self.length((code,), node), self.of(code)
        if isinstance(sign, ast.Invert) and of == BOOL:
            return Elements(array(BOOL, n), f"(!{self.at(code, BOOL, n)})")
        if isinstance(sign, ast.USub) and of == REAL:
            return Elements(array(REAL, n), f"(-{self.at(code, REAL, n)})")
        if isinstance(sign, ast.USub) and of == INT:
            return self._checked("sub", "0", self.at(code, INT, n), n, node)
        raise self.refused(node, "this operator of an array does not translate", "- of numbers, ~ of booleans")

    def compared_arrays(self, sign: ast.cmpop, left: Term, right: Term, node: ast.AST) -> Code:
        if type(sign) not in SIGNS:
            raise self.refused(node, "`is` and `in` of arrays", "==, <, any(), all()")
        a, b = self.array(left, node), self.array(right, node)
        n, of = self.length((a, b), node), REAL if REAL in (self.of(a), self.of(b)) else INT
        return Elements(array(BOOL, n), f"({self.at(a, of, n)} {SIGNS[type(sign)]} {self.at(b, of, n)})")

    # Functions of numpy, methods -----------------------------------------------------------------------

    def of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        """A function of numpy with these arguments; None: it has no translation."""
        out = named.pop("out", None)
        found = self._of_numpy(target, arguments, named, node)
        if found is None or out is None:
            return found
        if isinstance(out, Known):
            raise self.refused(node, "an array that is known when the code is generated is changed", "a new array")
        place = self.array(out, node)
        self.overwrite(place, found, node)
        return place

    def _of_numpy(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term | None:
        if target in CREATED:
            return self._created(target, arguments, named, node)
        if target in (np.nan_to_num, np.array, np.asarray, np.copy) and len(arguments) == 1 and not named:
            return self._converted(target, arguments[0], node)
        if named or not any(map(self.is_array, arguments)):
            return None
        if target in OF_ELEMENTS and len(arguments) == 1:
            text, takes, gives = OF_ELEMENTS[target]
            code = self.array(arguments[0], node)
            n = self.length((code,), node)
            return Elements(array(gives, n), text.format(self.at(code, takes, n)))
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

    def _extreme_of(self, name: str, arguments: Sequence[Term], node: ast.AST) -> Code:
        a, b = (self.array(each, node) for each in arguments)
        n, kinds = self.length((a, b), node), {self.of(a), self.of(b)}
        if REAL in kinds:
            return Elements(array(REAL, n), f"{name}({self.at(a, REAL, n)}, {self.at(b, REAL, n)})")
        if kinds == {BOOL}:
            sign = "||" if name == "umo_np_max" else "&&"
            return Elements(array(BOOL, n), f"({self.at(a, BOOL, n)} {sign} {self.at(b, BOOL, n)})")
        name = name.replace("_np_", "_").removesuffix("_keeping") + "_int"
        return Elements(array(INT, n), f"{name}({self.at(a, INT, n)}, {self.at(b, INT, n)})")

    def _where(self, condition: Term, one: Term, other: Term, node: ast.AST) -> Code:
        chosen, a, b = (self.array(each, node) for each in (condition, one, other))
        if self.of(chosen) != BOOL:
            raise self.refused(node, "the condition of `where` is no array of booleans")
        n, kinds = self.length((chosen, a, b), node), {self.of(a), self.of(b)}
        of = kinds.pop() if len(kinds) == 1 else REAL if REAL in kinds else INT
        return Elements(array(of, n), f"({self.at(chosen, BOOL, n)} ? {self.at(a, of, n)} : {self.at(b, of, n)})")

    def _created(self, target: Any, arguments: list[Term], named: dict[str, Term], node: ast.Call) -> Term:
        value, like = CREATED[target]
        terms = list(arguments)
        rows = terms[0].value if isinstance(terms[0], Known) else None
        if isinstance(terms[0], Many) and all(isinstance(each, Known) for each in terms[0].terms):
            rows = tuple(each.value for each in terms[0].terms)  # type: ignore[union-attr]
        if isinstance(rows, tuple) and len(rows) == 2:  # rows that get a name each
            return Many((self._created(target, [Known(rows[1]), *terms[1:]], named, node),) * rows[0])
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
        return Elements(array(of, length), self.at(code, of, length))

    def _whole_of(self, term: Term, node: ast.AST) -> int:
        if isinstance(term, Known) and type(term.value) is int and term.value > 0:
            return term.value
        raise self.refused(node, "the length of the array is not known when the code is generated")

    def _dtype(self, term: Term, node: ast.AST) -> CType:
        found = DTYPES.get(term.value) if isinstance(term, Known) else None
        if found is None:
            raise self.refused(node, "this type of numbers does not translate", "float, np.float64, np.int64, np.bool_")
        return found

    def _converted(self, target: Any, term: Term, node: ast.AST) -> Code:
        if isinstance(term, Many):
            return self._listed(term, node)
        code = self.array(term, node)
        n, of = self.length((code,), node), self.of(code)
        text = self.at(code, of, n)
        if target is np.nan_to_num and of == REAL:
            text = f"umo_nan_to_num({text})"
        elif target is np.asarray and not isinstance(code, Elements):
            return code
        return Elements(array(of, n), text)

    def _listed(self, term: Many, node: ast.AST) -> Code:
        codes = [self.number(each, node) for each in term.terms]
        kinds = {each.type for each in codes}
        of = kinds.pop() if len(kinds) == 1 else REAL if REAL in kinds else INT
        kind = array(of, len(codes))
        result = self.temporary(kind)
        for number, each in enumerate(codes):
            self.line(f"{result}.at[{number}] = {self.as_type(each, of, node)};", pure=True)
        self.sole.add(result)
        return Code(kind, result, stable=True)

    def counted(self, code: Code, node: ast.AST) -> Term:
        """np.count_nonzero: of one element or more only whether there is one."""
        found = self.reduced("count", code, node)
        loose = isinstance(code.type, ArrayType) and code.type.loose
        return Present(f"({found.text} != 0)") if loose else found

    def reduced(self, what: str, code: Code, node: ast.AST) -> Code:
        """One number of an array."""
        n, of = self.length((code,), node), self.of(code)
        if what in ("any", "all", "count"):
            text = self.at(code, of, n)
            kind, start = (INT, "0") if what == "count" else (BOOL, "false" if what == "any" else "true")
            step = {"count": "{0} += {1} != 0", "any": "{0} = {0} || {1} != 0", "all": "{0} = {0} && {1} != 0"}[what]
            found = self._loop(kind, start, step, text, n)
            return replace(found, type=numpy_number(kind, sure=kind == BOOL))
        if what == "sum":
            self.check_length(array(of, n), node)
            return self._sum(code, n, of, node)
        place = self.kept_place(code)
        name = f"umo_np_{what}" if of == REAL else f"umo_{what}_int"
        kind = REAL if of == REAL else INT
        found = self._loop(kind, f"{place}.at[0]", f"{{0}} = {name}({{0}}, {{1}})", f"{place}.at[{HERE}]", n)
        return replace(found, type=numpy_number(kind))

    def _loop(self, kind: CType, start: str, step: str, text: str, n: int) -> Code:
        result, turn = self.temporary(kind, "r"), self.temporary(INT, "k")
        self.line(f"{result} = {start};", pure=True)
        with self.block(f"for ({turn} = 0; {turn} < {n}; {turn}++)"):
            self.line(f"{step.format(result, text.replace(HERE, turn))};", pure=True)
        return Code(kind, result, stable=True)

    def _sum(self, code: Code, n: int, of: CType, node: ast.AST) -> Code:
        if of == REAL:
            if n > MOST_SUMMED:
                raise self.refused(node, f"a sum of {n} numbers", f"at most {MOST_SUMMED}, or a loop")
            place = self.kept_place(code)
            return self.kept(Code(numpy_number(REAL), f"umo_sum({place}.at, {n})"))
        if of == BOOL:
            found = self._loop(INT, "0", "{0} += {1}", self.at(code, BOOL, n), n)
            return replace(found, type=numpy_number(INT))
        result, turn = self.temporary(INT, "r"), self.temporary(INT, "k")
        text = self.at(code, INT, n).replace(HERE, turn)
        self.line(f"{result} = 0;", pure=True)
        with self.block(f"for ({turn} = 0; {turn} < {n}; {turn}++)"):
            self.raises(ControllerLimit, node, f"__builtin_add_overflow({result}, {text}, &{result})")
        return Code(numpy_number(INT), result, stable=True)

    def attribute_of_array(self, code: Code, name: str, node: ast.AST) -> Term:
        kind = plain(code.type)
        assert isinstance(kind, ArrayType)
        if name in ("size", "shape"):
            self.check_length(kind, node)
            return Known(kind.length if name == "size" else (kind.length,))
        return Known(ArrayMethod(self.present(code, node), name))

    def method_of_array(self, method: ArrayMethod, arguments: list[Term], node: ast.AST) -> Code:
        code, name = method.array, method.name
        if name == "copy" and not arguments:
            return self._converted(np.copy, code, node)
        if name == "astype" and len(arguments) == 1:
            of, n = self._dtype(arguments[0], node), self.length((code,), node)
            if (self.of(code), of) == (REAL, INT):
                raise self.refused(node, "a cast of real to whole numbers", "a loop with int()")
            text = self.at(code, self.of(code), n)
            return Elements(array(of, n), f"({text} != 0)" if of == BOOL else self.at(code, of, n))
        if name in ("any", "all", "sum", "max", "min") and not arguments:
            return self.reduced(name, code, node)
        raise self.refused(node, f"`{name}` of an array does not translate", "any, all, sum, max, min, copy, astype")

    # In place ------------------------------------------------------------------------------------------

    def overwrite(self, place: Code, value: Term, node: ast.AST, where: Code | None = None) -> None:
        """The elements of an array become others: all, or those that a mask chooses."""
        self.check_sole(place, node)
        self.changes.add(place.text)
        assert isinstance(place.type, ArrayType)
        of, n = place.type.of, place.type.length
        code = self.array(value, node)
        if of != REAL and self.of(code) not in (of, BOOL):  # numpy cuts them in silence
            raise self.refused(node, "numbers of another type are set in the array", "a new array")
        if isinstance(code.type, ArrayType) and (code.type.length not in (1, n) or where is not None):
            raise self.refused(node, "an array of another length is set in it", "one number for all")
        condition = "" if where is None else self.at(where, BOOL, n)
        self.fill(place.text, Elements(place.type, self.at(code, of, n)), condition)
        self.impure += 1

    def check_sole(self, place: Code, node: ast.AST) -> None:
        """That nobody else has this array."""
        if isinstance(place, Elements) or self.shares(place.text):
            nearest = "a new array: x = x + 1, np.where, a copy"
            raise self.refused(node, "an array is changed in place, and may have another name", nearest)

    def shares(self, text: str) -> bool:
        """Whether what this text names may be had by others too."""
        if text.startswith("m->"):
            return text in self.world.memory.shared
        if text in self.temporaries and text not in self.local_texts and text not in self.sole:
            return True  # it was copied from somewhere
        return text in self.shared or (self.key, text) in self.world.memory.shared or text in self.c_parameters

    def is_sole(self, term: Term) -> bool:
        """Whether nobody else has an array."""
        is_list = isinstance(term, Code) and isinstance(plain(term.type), ArrayType)
        if not (is_list or self.is_array(term)) or isinstance(term, Elements):
            return True
        return isinstance(term, Code) and (term.text in self.sole or not self.shares(term.text))

    def share(self, term: Term) -> None:
        """Another name is given to an array: neither is changed in place from now on."""
        if isinstance(term, Many):
            for each in term.terms:
                self.share(each)
        if not (isinstance(term, Code) and isinstance(plain(term.type), ArrayType)) or isinstance(term, Elements):
            return
        text = term.text.removesuffix(".value")
        self.shared.add(text)
        if text in self.c_parameters:
            self.keeps = True
        if text.startswith("m->"):
            self.world.memory.share(text)
        elif self.loops:
            self.world.memory.share((self.key, text))
