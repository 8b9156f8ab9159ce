"""Texts that only tell something: they are left out where it is proved that they do nothing else."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, TypeAlias

from umo.generate.c_types import NOTHING, CType
from umo.generate.form import Local, TellStatement, Value
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.local_functions import LocalFunction
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.state_members import StateMethod
from umo.generate.lower.terms import TEXT, ArrayMethod, Code, Known, Term, TruePlaces, UnknownText
from umo.generate.lower.text_makers import error_as_written, evaluated, is_certain
from umo.generate.lower.text_proofs import MAKERS, METHODS, TextProof, Unproved, Ways
from umo.generate.translation import Teller

TELLS = "a text that is made at run time, or a caught error"
"""Why a condition does not translate that a text decides."""
NOT_OF_PYTHON = ArrayMethod | LocalFunction | TruePlaces | StateMethod
"""What a local name may stand for while code is translated, and that Python does not have."""
Made: TypeAlias = tuple[Callable[..., Any], Sequence[tuple[CType, Value]]]
REASON = "it is not proved that the text has no effect and cannot fail"


class LoweredTelling(LoweredSubject):
    """What is left out of a function."""

    def text(self, node: ast.expr) -> Known:
        """The text that an expression makes at run time."""
        self.check_told([node])
        return Known(TEXT)

    def check_told(self, nodes: Sequence[ast.AST]) -> None:
        """That what is left out, as it only tells something, does nothing else: it changes nothing and cannot fail."""
        for each in nodes:
            try:
                self._proof().shown(each)
            except Unproved as error:
                raise self._refused(error, each) from None

    def does_nothing(self, test: ast.expr) -> bool:
        """Whether evaluating a condition only looks at what there is."""
        try:
            self._proof().asked(test)
        except Unproved:
            return False
        return True

    def check_decided(self, term: Term, node: ast.AST) -> None:
        """That code does not decide by a text that is only told; that of an attribute may be a state next time."""
        if isinstance(term, Known) and isinstance(term.value, UnknownText):
            self.f.world.memory.ask_text(term.value)
            raise self.f.refused(node, TELLS, "a state of an Enum, `except` for each error")

    def is_text(self, node: ast.AST) -> bool:
        """Whether an expression makes a text at run time."""
        if isinstance(node, ast.JoinedStr):
            return True
        if isinstance(node, ast.Name):
            text = self._told_name(node)
            return text is not None and text.field is None
        if isinstance(node, ast.IfExp):
            return self.is_text(node.body) or self.is_text(node.orelse)
        if isinstance(node, ast.BinOp):
            signs = ast.Add | ast.Mult | ast.Mod
            return isinstance(node.op, signs) and any(map(self._begins_text, (node.left, node.right)))
        if isinstance(node, ast.Call):
            of_text = isinstance(node.func, ast.Attribute) and self._has_method(node.func)
            return of_text or self._meaning_of(node.func) in MAKERS
        return False

    def _begins_text(self, node: ast.AST) -> bool:
        """Whether it is a text, also one that is written down."""
        is_told = isinstance(node, ast.Name) and self._told_name(node) is not None
        return is_told or self.is_text(node) or (isinstance(node, ast.Constant) and type(node.value) is str)

    def _told_name(self, node: ast.Name) -> UnknownText | None:
        found = self.f.flow.names.get(node.id)
        return found.value if isinstance(found, Known) and isinstance(found.value, UnknownText) else None

    def _has_method(self, func: ast.Attribute) -> bool:
        """Whether a method of a text is called."""
        if isinstance(func.value, ast.Attribute) and func.attr in METHODS:
            with suppress(NoTranslation), self.f.gathered():
                term = self.f.term(func.value)
                return isinstance(term, Known) and isinstance(term.value, UnknownText)
        return self._begins_text(func.value)

    def _meaning_of(self, func: ast.AST) -> Any:
        if not isinstance(func, ast.Name) or func.id in self.f.flow.names or self.f.source.is_local(func.id):
            return None
        return self.f.source.meaning(func.id)

    # Texts that Python makes ---------------------------------------------------------------------------

    def tell_error(self, node: ast.expr, kind: type[BaseException], said: str, fault: int) -> None:
        """Python makes the error of a fault, where it is there. One that needs a text which is made at run time, or a
        number whose class is not certain, says what stands in the code."""
        if not self.f.world.target.tells:
            return
        made = self._made(node)
        make, given = (partial(error_as_written, kind, said), ()) if made is None else made
        self._tell(make, given, fault=fault)

    def tell_field(self, term: Term, node: ast.AST, target: ast.Attribute, owner: Any) -> bool:
        """Whether Python assigns a text that is made at run time; else it is left out."""
        if not self.f.world.target.tells or not isinstance(term, Known):
            return False
        is_value = isinstance(node, ast.AnnAssign) or (isinstance(node, ast.Assign) and target in node.targets)
        if not isinstance(term.value, UnknownText):
            made: Made | None = partial(str, term.value), ()
        else:
            made = self._made(node.value) if is_value else None  # type: ignore[attr-defined]
        if made is None:
            return False
        make, given = made
        self._tell(make, given, field=(owner, target.attr))
        return True

    def tell_call(self, node: ast.Call) -> bool:
        """Whether Python calls a function that only tells; else it is left out."""
        made = self._made(node) if self.f.world.target.tells else None
        if made is None:
            return False
        make, given = made
        self._tell(make, given)
        return True

    def _tell(self, make: Callable[..., Any], given: Sequence[tuple[CType, Value]], **to: Any) -> None:
        number = self.f.world.teller(Teller(make, [of for of, _ in given], **to))
        self.f.add(TellStatement(number, tuple(place for _, place in given)))

    def _made(self, node: ast.expr) -> Made | None:
        """What evaluates an expression, of which variables; None: Python does not have all that it needs."""
        known: dict[str, Any] = {}
        given: dict[str, tuple[CType, Value]] = {}
        for name in dict.fromkeys(each.id for each in ast.walk(node) if isinstance(each, ast.Name)):
            found = self.f.flow.names.get(name)
            if isinstance(found, Known):
                if isinstance(found.value, UnknownText | NOT_OF_PYTHON):
                    return None
                known[name] = found.value
            elif found is not None:
                of, place = (found.type, found.value) if isinstance(found, Code) else (found, self.f.local(name))
                if not (isinstance(of, CType) and is_certain(of) and isinstance(place, Local)):
                    return None
                given[name] = of, place
            elif name in self.f.source.function.__code__.co_freevars or name == "super":
                return None
        return evaluated(self.f.source, node, known, list(given)), list(given.values())

    # Proofs --------------------------------------------------------------------------------------------

    def _proof(self) -> TextProof:
        return TextProof(self.f.source, {}, Ways(self._field, self._take, self._local))

    def _local(self, name: str) -> Term | None:
        if name not in self.f.flow.names:
            return None
        return self.f.expressions.lower_name(ast.Name(name, ast.Load()))

    def _field(self, owner: Any, name: str) -> CType | None:
        of = self.f.world.fields.type_of(owner, name, getattr(owner, name))
        return None if of == NOTHING else of

    def _take(self, owner: Any, name: str, at: tuple[str, int]) -> None:
        self.f.world.known.attribute(owner, name, at)

    def _refused(self, error: Unproved, node: ast.AST) -> NoTranslation:
        line, why = getattr(error.node, "lineno", 0), error.why
        if error.source is self.f.source:
            node = error.node if line else node
        else:
            why = f"{error.source.file}:{line}: {error.source.segment(error.node)}: {why}"
        return self.f.refused(node, f"{REASON}: {why}", "a name for it first")
