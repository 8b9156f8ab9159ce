"""Texts that are only shown or logged. They are left out if it is proved that making them has no other effect."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, TypeAlias

from umo.generate.c_types import NOTHING, CType
from umo.generate.form import Local, TextStatement, Value
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.local_functions import LocalFunction
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.state_members import StateMethod
from umo.generate.lower.terms import TEXT, ArrayMethod, Code, Known, Term, TruePlaces, UnknownText
from umo.generate.lower.text_makers import error_as_written, evaluated, is_certain
from umo.generate.lower.text_proofs import MAKERS, METHODS, ProofQueries, TextProof, Unproved
from umo.generate.translation import TextMaker

DEPENDS_ON_TEXT = "this depends on a string that is made at run time, or on a caught error"
"""The reason why a condition on a text cannot be translated."""
NOT_OF_PYTHON = ArrayMethod | LocalFunction | TruePlaces | StateMethod
"""Meanings of a local name that do not exist in Python."""
Made: TypeAlias = tuple[Callable[..., Any], Sequence[tuple[CType, Value]]]
REASON = "it is not proved that the text has no effect and cannot fail"


class LoweredTexts(LoweredSubject):
    """Lowers or leaves out the texts of a function."""

    def text(self, node: ast.expr) -> Known:
        """Return the text that an expression makes at run time."""
        self.check_removable([node])
        return Known(TEXT)

    def check_removable(self, nodes: Sequence[ast.AST]) -> None:
        """Refuse expressions whose evaluation for a text may change something or fail."""
        for each in nodes:
            try:
                self._proof().shown(each)
            except Unproved as error:
                raise self._refused(error, each) from None

    def does_nothing(self, test: ast.expr) -> bool:
        """True if evaluating a condition has no effect and cannot fail."""
        try:
            self._proof().asked(test)
        except Unproved:
            return False
        return True

    def check_decided(self, term: Term, node: ast.AST) -> None:
        """Refuse a condition that depends on a text made at run time. In the next pass the text of an attribute may
        have become a state."""
        if isinstance(term, Known) and isinstance(term.value, UnknownText):
            self.f.world.memory.ask_text(term.value)
            raise self.f.refused(node, DEPENDS_ON_TEXT, "a state of an Enum, an `except` for each error")

    def is_text(self, node: ast.AST) -> bool:
        """True if an expression makes a text at run time."""
        if isinstance(node, ast.JoinedStr):
            return True
        if isinstance(node, ast.Name):
            text = self._unknown_text(node)
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
        """True if this is a text, including one written in the code."""
        is_told = isinstance(node, ast.Name) and self._unknown_text(node) is not None
        return is_told or self.is_text(node) or (isinstance(node, ast.Constant) and type(node.value) is str)

    def _unknown_text(self, node: ast.Name) -> UnknownText | None:
        found = self.f.flow.names.get(node.id)
        return found.value if isinstance(found, Known) and isinstance(found.value, UnknownText) else None

    def _has_method(self, func: ast.Attribute) -> bool:
        """True if a method of a text is called."""
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

    def python_makes_error(self, node: ast.expr, kind: type[BaseException], said: str, fault: int) -> None:
        """Let Python make the error of a fault if Python calls the code. An error that needs a text made at run time,
        or a number of uncertain class, gets the message as written in the code."""
        if not self.f.world.target.makes_texts:
            return
        made = self._made(node)
        make, given = (partial(error_as_written, kind, said), ()) if made is None else made
        self._tell(make, given, fault=fault)

    def python_sets_field(self, term: Term, node: ast.AST, target: ast.Attribute, owner: Any) -> bool:
        """Let Python assign a text made at run time, and return True. Return False if the assignment is left out."""
        if not self.f.world.target.makes_texts or not isinstance(term, Known):
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

    def python_calls(self, node: ast.Call) -> bool:
        """Let Python call a function that only makes texts, and return True. Return False if the call is left out."""
        made = self._made(node) if self.f.world.target.makes_texts else None
        if made is None:
            return False
        make, given = made
        self._tell(make, given)
        return True

    def _tell(self, make: Callable[..., Any], given: Sequence[tuple[CType, Value]], **to: Any) -> None:
        number = self.f.world.text_maker(TextMaker(make, [of for of, _ in given], **to))
        self.f.add(TextStatement(number, tuple(place for _, place in given)))

    def _made(self, node: ast.expr) -> Made | None:
        """Return a function that evaluates an expression, with its variables; None if Python does not have all values
        that it needs."""
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
        return TextProof(self.f.source, {}, ProofQueries(self._field, self._take, self._local))

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
        return self.f.refused(node, f"{REASON}: {why}", "assign it to a name first")
