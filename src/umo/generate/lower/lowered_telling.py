"""Texts that only tell something: they are left out where it is proved that they do nothing else."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from umo.generate.c_types import NOTHING, CType
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import TEXT, Known, Term, UnknownText
from umo.generate.lower.text_proofs import MAKERS, METHODS, TextProof, Unproved, Ways

TELLS = "a text that is made at run time"
"""Why a condition does not translate that a text decides."""
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

    def undecided(self, text: UnknownText, node: ast.AST) -> NoTranslation:
        """The refusal to decide by a text: one that is read from an attribute may be a state in the next pass."""
        self.f.world.memory.ask_text(text)
        return self.f.refused(node, TELLS, "a state of an Enum")

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
