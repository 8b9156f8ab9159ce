"""The function that is being written: its lines, its names, and where a fault leads."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

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
    TupleType,
    is_number,
    numpy_number,
    plain,
    plain_number,
    state,
)
from umo.generate.code_context import CodeContext
from umo.generate.function_source import SourcedFunction
from umo.generate.known_values import Unwatchable
from umo.generate.live_fields import mask_of
from umo.generate.terms import Code, Known, Many, Present, Term, UnknownText
from umo.generate.value_kinds import NUMPY_NUMBERS, TRUTH, is_bare_enum, own_methods, refused_truth
from umo.objects import Quality

INDENT = "    "
PLAIN_NAMES: dict[CType, str] = {REAL: "float", INT: "int", BOOL: "bool"}
ZERO: dict[CType, str] = {REAL: "0", INT: "0", BOOL: "false", MASK: "0"}


TELLS = "a text that is made at run time"
"""Why a condition does not translate that a text decides."""


class NoTranslation(Exception):
    """Something does not translate."""

    def __init__(self, node: ast.AST, reason: str, nearest: str = "") -> None:
        super().__init__(reason)
        self.node, self.reason, self.nearest = node, reason, nearest


class Way(NamedTuple):
    """What is known at a place of a function."""

    names: dict[str, CType | Known]
    known: set[str]


@dataclass
class TryBlock:
    """Where faults go inside of `try`."""

    label: str
    variable: str
    """Keeps the fault."""
    uses: int = 0
    returning: str = ""
    """Keeps that the function returns; "": nothing is to be done on the way out."""


class FunctionScope:
    """The lines of one function in C, while it is written."""

    def __init__(self, world: CodeContext, source: SourcedFunction, key: Any, name: str) -> None:
        self.world, self.source, self.key, self.c_name = world, source, key, name
        self.lines: list[str] = []
        self.depth = 1
        self.temporaries: dict[str, CType] = {}
        self.names: dict[str, CType | Known] = {}
        """Local names: their types, or the live object that each stands for."""
        self.parameters: dict[str, CType] = {}
        self.given: dict[str, CType] = {}
        """The parameters in C."""
        self.results: list[Term | None] = []
        self.handlers: list[TryBlock] = []
        self.impure = 0
        """Grows with each line that may change what an expression before it has seen."""
        self.caught: list[str] = []
        """The faults that are being handled."""
        self.known: set[str] = set()
        """Expressions that are not None here: local names, and fields."""
        self._c_names: dict[str, str] = {}
        """Names in C of local ones."""
        self.loops: list[tuple[str, str, int]] = []
        """The labels to which `continue` and `break` lead, "": C's own; and how many handlers there are around."""
        self.shared: set[str] = set()
        """Texts of arrays that have several names."""
        self.same: dict[str, str] = {}
        """Names that stand for the array of another local name, as long as the function runs."""
        self.sole: set[str] = set()
        """Temporary arrays that nobody else has."""
        self.sole_result = True
        """Whether nobody else has an array that the function returns."""
        self.rebound: list[str] = []
        """Texts of arrays that were assigned as a whole."""
        self.changes: set[str] = set()
        """Texts of arrays that are changed in place, here and in what is called."""
        self.keeps = False
        """Whether an array that it was given is had by others after it."""
        self.left: dict[str, list[Way]] = {}
        """What was known where `break` and `continue` lead to each label."""
        self._labels = 0

    # Lines ---------------------------------------------------------------------------------------------

    def line(self, text: str, pure: bool = False) -> None:
        self.lines.append(INDENT * self.depth + text)
        self.impure += not pure

    @contextmanager
    def block(self, head: str, tail: str = "}") -> Iterator[None]:
        self.line(f"{head} {{".lstrip(), pure=True)
        self.depth += 1
        known = set(self.known)
        yield
        self.known &= known
        self.depth -= 1
        self.line(tail, pure=True)

    def label(self, what: str) -> str:
        self._labels += 1
        return f"{what}_{self._labels}"

    def temporary(self, of: CType, what: str = "t") -> str:
        number = 1 + len(self.temporaries)
        while (name := f"{what}{number}") in self.temporaries or name in self.names:
            number += 1
        self.temporaries[name] = of
        return name

    def kept(self, code: Code, what: str = "t") -> Code:
        """The same value under a name of its own."""
        if code.stable:
            return code
        name = self.temporary(code.type, what)
        self.line(f"{name} = {code.text};", pure=True)
        return Code(code.type, name, stable=True)

    def settled(self, term: Term) -> Term:
        """The same, which nothing changes any longer."""
        if isinstance(term, Code):
            if isinstance(plain(term.type), ArrayType):
                self.share(term)
            return self.kept(term)
        if isinstance(term, Many):
            return Many(tuple(map(self.settled, term.terms)), term.names, term.kind)
        return Present(self.kept(Code(BOOL, term.text)).text) if isinstance(term, Present) else term

    def share(self, term: Term) -> None:
        """Another name is given to an array."""
        raise NotImplementedError

    def add_parameter(self, name: str, given: CType, of: CType) -> None:
        """A parameter; it has another type inside where the function assigns to it what it was not given."""
        self.parameters[name] = self.names[name] = of
        text = self.c_local(name)
        if of == given:
            self.given[text] = given
            return
        before = f"given_{text}"
        self.given[before] = given
        self.temporaries[text] = of
        value = self.as_type(Code(given, before, stable=True), of, self.source.tree)
        self.line(f"{text} = {value};", pure=True)

    @property
    def c_parameters(self) -> list[str]:
        return [self.c_local(name) for name in self.parameters]

    def c_local(self, name: str) -> str:
        """The name in C of a local one: no other one has it, and nothing else has an underscore after its `v`."""
        found = self._c_names.get(name)
        if found is None:
            found = f"v_{re.sub(r'[^a-zA-Z0-9_]', '_', name)}"
            while found in self._c_names.values():
                found += "_"
            self._c_names[name] = found
        return found

    @property
    def local_texts(self) -> Collection[str]:
        """The names in C of local ones."""
        return self._c_names.values()

    # What is known at a place ----------------------------------------------------------------------------

    def way(self) -> Way:
        """What is known here."""
        return Way(dict(self.names), set(self.known))

    def go_on_from(self, ways: Sequence[Way]) -> None:
        """What is known where these ways meet: names that have the same on all of them."""
        first, *rest = ways
        self.names = {
            name: each for name, each in first.names.items() if all(way.names.get(name) == each for way in rest)
        }
        self.known = first.known.intersection(*(way.known for way in rest))

    def forget(self, target: ast.AST) -> None:
        """A name or an attribute has another value from here on, and so has what is found through it."""
        if isinstance(target, ast.Name):
            self.known = {each for each in self.known if f"id='{target.id}'" not in each}
        elif isinstance(target, ast.Attribute):
            self.known = {each for each in self.known if f"attr='{target.attr}'" not in each}

    def is_proved(self, code: Code, node: ast.AST) -> bool:
        """Whether it is not None here. What a property gives may be something else each time."""
        lasting = isinstance(node, ast.Name) or (isinstance(node, ast.Attribute) and code.text.startswith("m->"))
        return lasting and ast.dump(node) in self.known

    # Faults --------------------------------------------------------------------------------------------

    def fail(self, fault: str, condition: str = "") -> None:
        """The function fails with this fault, if the condition holds."""
        if self.handlers:
            handler = self.handlers[-1]
            handler.uses += 1
            steps = [f"{handler.variable} = {fault};", f"goto {handler.label};"]
        else:
            steps = [f"return {fault};"]
        if not condition:
            for each in steps:
                self.line(each, pure=True)
        elif len(steps) == 1:
            self.line(f"if ({condition})", pure=True)
            self.line(INDENT + steps[0], pure=True)
        else:
            with self.block(f"if ({condition})"):
                for each in steps:
                    self.line(each, pure=True)

    def raises(self, kind: type[BaseException], node: ast.AST, condition: str = "", text: str | None = None) -> None:
        """Python raises this here."""
        said = self.source.segment(node) if text is None else text
        number = self.world.fault(kind, said, self.source.file, getattr(node, "lineno", 0))
        self.fail(str(number), condition)

    def called(self, call: str) -> None:
        """A call that returns a fault."""
        self.temporaries.setdefault("fault", BOOL)
        self.line(f"fault = {call};")
        self.known = {each for each in self.known if each.startswith("Name(")}  # it may assign any field
        self.fail("fault", "fault")

    # Terms ---------------------------------------------------------------------------------------------

    def takes(self, owner: Any, name: str, node: ast.AST) -> None:
        """An attribute of a live object is taken as known here."""
        self._taken(partial(self.world.known.attribute, owner, name), node)

    def takes_variable(self, name: str, node: ast.AST) -> None:
        """A name of the module, or of an enclosing function, is taken as known here."""
        self._taken(partial(self.world.known.variable, self.source.function, name), node)

    def takes_class(self, owner: Any, name: str, node: ast.AST) -> None:
        """A tracked number may be an attribute of the class of its object."""
        self._taken(partial(self.world.known.tracked, owner, name), node)

    def _taken(self, take: Callable[[tuple[str, int]], None], node: ast.AST) -> None:
        try:
            take((self.source.file, getattr(node, "lineno", 0)))
        except Unwatchable as error:
            raise self.refused(node, str(error), "an attribute that is set as usual, or a tuple") from None

    def refused(self, node: ast.AST, reason: str, nearest: str = "") -> NoTranslation:
        return NoTranslation(node, reason, nearest)

    def code(self, term: Term, node: ast.AST) -> Code:
        """A term as a value in C."""
        if isinstance(term, Code):
            return term
        if isinstance(term, Known):
            value = term.value
            if isinstance(value, np.generic) and not isinstance(value, NUMPY_NUMBERS):
                raise self.refused(node, f"a {type(value).__name__} of numpy", "np.float64, np.int64, float(...)")
            of = self.world.fields.type_of_value(value)
            if of is not None and is_number(of) and isinstance(value, np.generic):
                return Code(numpy_number(of), self.literal(value.item(), of, node), stable=True)
            if of is not None and (is_number(of) or isinstance(of, StateType)):
                return Code(of, self.literal(value, of, node), stable=True)
            if isinstance(of, ArrayType):
                self.world.memory.place_known(value)
                name = self.temporary(of)
                for number, each in enumerate(value):
                    self.line(f"{name}.at[{number}] = {self.literal(each, of.of, node)};", pure=True)
                return Code(of, name, stable=True)
            if isinstance(of, TupleType):
                return self.made(Many(tuple(map(Known, value)), tuple(n for n, _ in of.members), of.kind), of, node)
            raise self.refused(node, f"{_told(value)} is not a number or a state on the controller")
        if isinstance(term, Many):
            types = [self.code(each, node).type for each in term.terms]
            of = self.world.fields.tuple_type(list(types), term.names, term.kind or tuple)
            if of is None:
                raise self.refused(node, "a tuple of other things than numbers of Python", "float(...), int(...)")
            return self.made(term, of, node)
        raise self.refused(node, "only whether it is None is known on the controller")

    def literal(self, value: Any, of: CType, node: ast.AST) -> str:
        try:
            return self.world.fields.literal(value, of)
        except (ValueError, OverflowError):
            raise self.refused(node, f"{value} does not fit 32 bits", "a smaller number, or a float") from None

    def made(self, term: Many, of: TupleType, node: ast.AST) -> Code:
        for each, (_, kind) in zip(term.terms, of.members, strict=True):
            given = self.code(each, node).type if isinstance(each, Known | Code) else kind
            if isinstance(given, NumpyNumber):
                raise self.refused(node, "a number of numpy in a tuple", "float(...), int(...), bool(...)")
            if (kind == REAL and plain_number(given) != REAL) or isinstance(given, MixedNumber):
                raise self.refused(node, "a whole number where a tuple has a real one", "0.0, float(...)")
            if kind == INT and given == BOOL:
                raise self.refused(node, "a bool where a tuple has a whole number", "int(...)")
        parts = [self.as_type(each, kind, node) for each, (_, kind) in zip(term.terms, of.members, strict=True)]
        return Code(of, f"({of.name}){{{', '.join(parts)}}}")

    def as_type(self, term: Term, of: CType, node: ast.AST) -> str:
        """The text of a term as a value of this type."""
        of = plain_number(of)
        if isinstance(term, Known):
            if isinstance(of, OptionalType) and term.value is None:
                return f"({of.name}){{.has = false}}"
            if of == MASK:
                return f"{mask_of(term.value)}u"
            if of == REAL and type(term.value) in (int, float, bool):
                return self.literal(term.value, REAL, node)
        if isinstance(term, Many) and isinstance(of, TupleType):
            return self.made(term, of, node).text
        code = self.code(term, node)
        code = replace(code, type=plain_number(code.type))
        if code.type == of or (isinstance(of, OptionalType) and code.type.name == of.name):
            return code.text
        if isinstance(of, OptionalType):
            return f"({of.name}){{true, {self.as_type(code, of.of, node)}}}"
        if isinstance(code.type, OptionalType):
            return self.as_type(self.present(code, node), of, node)
        if is_number(of) and is_number(code.type):
            if not _widens(code.type, of):
                kinds = {REAL: "a real number", INT: "a whole number", BOOL: "a bool"}
                nearest = f"{PLAIN_NAMES[of]}(...), or {kinds[code.type]} from the start"
                raise self.refused(node, f"{kinds[code.type]} where {kinds[of]} was before", nearest)
            return _enclosed(code.text) if of == REAL and code.type == BOOL else f"({of.name}){_enclosed(code.text)}"
        if of == MASK and code.type == state(Quality):
            return f"(uint32_t)1 << {_enclosed(code.text)}"
        if isinstance(of, TupleType) and isinstance(code.type, TupleType):
            parts = [f"{self.kept(code).text}.{name}" for name, _ in code.type.members]
            terms = tuple(Code(kind, part) for part, (_, kind) in zip(parts, code.type.members, strict=True))
            return self.made(Many(terms), of, node).text
        raise self.refused(node, f"a {code.type.name} where a {of.name} was before", "one type for each name")

    def present(self, code: Code, node: ast.AST) -> Code:
        """The value of what may be None: TypeError where it is."""
        if not isinstance(code.type, OptionalType):
            return code
        code = code if _is_place(code.text) else self.kept(code)
        if not self.is_proved(code, node):
            self.raises(TypeError, node, f"!{code.text}.has")
        return Code(plain(code.type), f"{code.text}.value")

    def number(self, term: Term, node: ast.AST) -> Code:
        code = self.present(self.code(term, node), node)
        code = replace(code, type=plain_number(code.type))
        if not is_number(code.type):
            raise self.refused(node, "it is not a number")
        return code

    def truth(self, term: Term, node: ast.AST) -> str | bool:
        """The text of a condition; a bool if it is known already."""
        if isinstance(term, Known):
            if isinstance(term.value, UnknownText):
                raise self.refused(node, TELLS, "a state of an Enum")
            if refused_truth(term.value):
                raise self.refused(node, f"{type(term.value).__name__} decides whether it is true", "a comparison")
            return bool(term.value)
        if isinstance(term, Present):
            return term.text
        if isinstance(term, Many):
            return bool(term.terms)
        term = replace(term, type=plain_number(term.type))
        if isinstance(term.type, OptionalType):
            code = term if _is_place(term.text) else self.kept(term)
            inner = self.truth(Code(term.type.of, f"{code.text}.value"), node)
            return f"{code.text}.has" if inner is True else f"({code.text}.has && {inner})"
        if term.type == BOOL:
            return term.text
        if term.type in (REAL, INT, MASK):
            return f"{_enclosed(term.text)} != 0"
        if isinstance(term.type, StateType):
            if own_methods(term.type.kind, TRUTH):
                raise self.refused(node, f"{term.type.kind.__name__} decides whether it is true", "`is`, with a state")
            if is_bare_enum(term.type.kind):
                return True
            zeros = [n for n, each in enumerate(term.type.kind) if not each]
            return f"{_enclosed(term.text)} != {zeros[0]}" if zeros else True
        nearest = "any(), all()" if isinstance(term.type, ArrayType) else ""
        raise self.refused(node, "whether it is true is not known on the controller", nearest)


def _widens(one: CType, other: CType) -> bool:
    """Whether every value of one type is the same as the other."""
    return one == other or other == REAL or (one == BOOL and other == INT)


def _enclosed(text: str) -> str:
    return text if _is_place(text) or text.replace(".", "").isalnum() else f"({text})"


def _is_place(text: str) -> bool:
    """Whether a text names a variable or a field."""
    return all(
        part.isidentifier()
        for part in text.replace("->", ".").replace("[", ".").replace("]", "").split(".")
        if not part.isdigit()
    )


def _told(value: object) -> str:
    if value is None:
        return "None"
    if isinstance(value, str | Enum):
        return repr(value)
    return f"a {type(value).__name__}"
