"""Texts that only tell something: a controller leaves them out, as long as they do nothing else."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from typing import Any

from umo.generate.c_types import (
    INT,
    REAL,
)
from umo.generate.check.form_effects import changes
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import Code

TELLING = (str, repr)
"""Functions that make a text of whatever there is."""
DIVIDES = (ast.Div, ast.FloorDiv, ast.Mod, ast.Pow)


class LoweredTelling(LoweredSubject):
    """What is left out of a function."""

    def check_told(self, nodes: Sequence[ast.AST]) -> None:
        """That what is left out, as it only tells something, does nothing else: it changes nothing and cannot fail.
        umo's own texts are known to be so."""
        self._check_calls(nodes)
        if not self.f.source.file.startswith("umo/"):
            for node in nodes:
                self._check_text(node)

    def _check_text(self, node: ast.AST) -> None:
        """A part of a text: names, attributes, numbers, and texts made of these."""
        if isinstance(node, ast.Constant):
            return
        if isinstance(node, ast.JoinedStr | ast.Tuple | ast.List | ast.IfExp | ast.Call):
            inner = [each for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr | ast.keyword)]
            for each in inner[isinstance(node, ast.Call) :]:
                self._check_text(each.value if isinstance(each, ast.keyword) else each)
            if not isinstance(node, ast.Call) or self.is_joined_text(node) or self._meaning_of(node.func) in TELLING:
                return
        elif isinstance(node, ast.FormattedValue):
            self._check_text(node.value)
            if node.format_spec is None or self._is_formatted(node):
                return
        elif isinstance(node, ast.Name | ast.Attribute):
            with self.f.gathered() as needed:
                self.f.term(node)
            if not any(map(changes, needed)):
                return
        raise self.f.refused(node, "a text that a controller does not have, and that may fail", "a name for it first")

    def _is_formatted(self, node: ast.FormattedValue) -> bool:
        """Whether a number takes this format whatever it is."""
        spec = node.format_spec.values if isinstance(node.format_spec, ast.JoinedStr) else []
        text = "".join(str(each.value) if isinstance(each, ast.Constant) else "?" for each in spec)
        term = self.f.term(node.value)
        of = term.type if isinstance(term, Code) else None
        ends = {REAL: "fFeEgG%", INT: "fFeEgG%dxob"}.get(of) if of is not None else None
        return ends is not None and re.fullmatch(rf"[-+ ]?0?[0-9]*(\.[0-9]+)?[{ends}]", text) is not None

    def _meaning_of(self, func: ast.AST) -> Any:
        return (
            self.f.source.meaning(func.id) if isinstance(func, ast.Name) and func.id not in self.f.flow.names else None
        )

    def _check_calls(self, nodes: Sequence[ast.AST]) -> None:
        for each in (one for node in nodes for one in ast.walk(node)):
            if isinstance(each, ast.NamedExpr | ast.Await):
                raise self.f.refused(
                    each, "an assignment in a text that a controller does not have", "a line of its own"
                )
            if isinstance(each, ast.BinOp) and isinstance(each.op, DIVIDES) and not _is_text(each.left):
                raise self.f.refused(
                    each, "a quotient in a text that a controller does not have", "a name for it first"
                )
            if isinstance(each, ast.Call) and not self._only_tells(each):
                raise self.f.refused(each, "a call in a text that a controller does not have", "a name for it first")

    def does_nothing(self, node: ast.AST) -> bool:
        """Whether evaluating an expression only looks at what there is."""
        try:
            self._check_calls([node])
        except NoTranslation:
            return False
        return True

    def _only_tells(self, node: ast.Call) -> bool:
        """Whether a call in a text changes nothing: a function of Python, or of umo."""
        if self.is_joined_text(node):
            return True
        func = node.func
        root = func
        while isinstance(root, ast.Attribute):
            root = root.value
        if isinstance(root, ast.Call) and isinstance(root.func, ast.Name) and root.func.id == "super":
            return False
        if not isinstance(root, ast.Name) or root.id in self.f.flow.names:
            return self.f.source.file.startswith("umo/")
        found = self.f.source.meaning(root.id)
        for name in reversed(_names_of(func)):
            found = getattr(found, name, None)
        return str(getattr(found, "__module__", "")).partition(".")[0] in ("builtins", "umo", "math", "numpy")

    def is_joined_text(self, node: ast.Call) -> bool:
        """A method of a text, such as `", ".join(...)`: it gives a text."""
        func = node.func
        if not (isinstance(func, ast.Attribute) and isinstance(func.value, ast.Constant | ast.JoinedStr)):
            return False
        if isinstance(func.value, ast.Constant) and not isinstance(func.value.value, str):
            return False
        return func.attr in ("join", "format")


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant | ast.JoinedStr)


def _names_of(func: ast.AST) -> list[str]:
    """The attributes of a dotted name, the last one first."""
    return [func.attr, *_names_of(func.value)] if isinstance(func, ast.Attribute) else []
