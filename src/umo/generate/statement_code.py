"""Statements of Python as C."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from umo.errors import text_of
from umo.generate.error_code import ErrorCode
from umo.generate.function_scope import TELLS, NoTranslation
from umo.generate.terms import Code, Known

UNFORESEEN = (ArithmeticError, AssertionError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What the translation of a statement may raise that nobody has thought of."""


class StatementCode(ErrorCode):
    """The part of a function that is statements."""

    def body(self, statements: Sequence[ast.stmt]) -> bool:
        """Statements in a row; False if nothing after them is reached."""
        for each in statements:
            method = getattr(self, f"_{type(each).__name__}", None)
            if method is None:
                raise self.refused(
                    each, "this statement does not translate", "if, for, while, try, raise, return, assignments"
                )
            try:
                if method(each) is False:
                    return False
            except UNFORESEEN as error:
                raise self.refused(each, f"it cannot be translated ({text_of(error)})") from error
        return True

    def _Pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        term = self.term(node.value)
        if isinstance(term, Code) and term.text.endswith(")"):
            self.line(f"(void){term.text};")

    def _Import(self, node: ast.Import | ast.ImportFrom) -> None:
        scope: dict[str, Any] = {}
        exec(compile(ast.Module([node], []), "<import>", "exec"), {"__name__": self.source.function.__module__}, scope)
        self.names |= {name: Known(value, name=name) for name, value in scope.items()}
        if isinstance(node, ast.ImportFrom) and node.module:
            module = import_module("." * node.level + node.module, self.source.function.__globals__.get("__package__"))
            for each in node.names:
                self.takes(module, each.name, node)

    _ImportFrom = _Import

    # Ways ----------------------------------------------------------------------------------------------

    def _If(self, node: ast.If) -> bool | None:
        before_test = self.impure
        try:
            truth = self.truth(self.term(node.test), node.test)
        except NoTranslation as refused:
            if (
                refused.reason != TELLS
                or not self.does_nothing(node.test)
                or self._does_something([*node.body, *node.orelse])
            ):
                raise
            self.world.note(f"{self.source.segment(node.test)} decides only what is told: it is left out")
            return None
        shown = self.impure == before_test
        proved, disproved = (self.proved(node.test), self.disproved(node.test)) if shown else (set(), set())
        if isinstance(truth, bool):
            self.known |= proved if truth else disproved
            return self.body(node.body if truth else node.orelse)
        before, names = set(self.known), dict(self.names)
        self.known |= proved
        with self.block(f"if ({truth})", "}"):
            goes_on = self.body(node.body)
        one, self.known = self.way(), before | disproved
        self.names = names
        other = True
        if node.orelse:
            self.lines.pop()
            self.line("} else {", pure=True)
            self.depth += 1
            other = self.body(node.orelse)
            self.depth -= 1
            self.line("}", pure=True)
        ways = [*([one] if goes_on else []), *([self.way()] if other else [])]
        if ways:
            self.go_on_from(ways)
        return None if goes_on or other else False

    def _Match(self, node: ast.Match) -> bool:
        """As `if`s, of which each compares with what stands after `case`."""
        name = f"matched {node.lineno} {node.col_offset}"
        ways: list[ast.stmt] = []
        for case in reversed(node.cases):
            test = self._matches(case.pattern, name)
            test = test if case.guard is None else ast.BoolOp(ast.And(), [test, case.guard])
            ways = [ast.If(test, case.body, ways)]
        new = [ast.Assign([ast.Name(name, ast.Store())], node.subject), *ways]
        return self.body([ast.fix_missing_locations(ast.copy_location(each, node)) for each in new])

    def _matches(self, pattern: ast.pattern, name: str) -> ast.expr:
        if isinstance(pattern, ast.MatchOr):
            return ast.BoolOp(ast.Or(), [self._matches(each, name) for each in pattern.patterns])
        if isinstance(pattern, ast.MatchAs) and pattern.pattern is None and pattern.name is None:
            return ast.Constant(True)
        if isinstance(pattern, ast.MatchValue):
            return ast.Compare(ast.Name(name, ast.Load()), [ast.Eq()], [pattern.value])
        if isinstance(pattern, ast.MatchSingleton):
            return ast.Compare(ast.Name(name, ast.Load()), [ast.Is()], [ast.Constant(pattern.value)])
        raise self.refused(pattern, "this pattern does not translate", "values, None, |, _ and `if`")

    def _does_something(self, statements: Sequence[ast.stmt]) -> bool:
        """Whether more is left of statements than a text: a line, or a way out."""
        before = len(self.lines)
        goes_on = self.body(statements)
        return not goes_on or len(self.lines) > before

    def _Return(self, node: ast.Return) -> bool:
        term = Known(None) if node.value is None else self.term(node.value)
        self.results.append(term)
        self.sole_result = self.sole_result and self.is_sole(term)
        self.share(term)
        result = self.world.result_of(self, term, node)
        if result:
            self.line(f"*out = {result};")
        returning = [each for each in self.handlers if each.returning]
        if returning:
            returning[-1].uses += 1
            self.line(f"{returning[-1].returning} = true;", pure=True)
            self.line(f"goto {returning[-1].label};", pure=True)
        else:
            self.line("return UMO_OK;", pure=True)
        return False
