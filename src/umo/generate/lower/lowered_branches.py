"""Statements of Python."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from umo.generate.form import If, Return
from umo.generate.lower.flow import disproved_by, proved_by
from umo.generate.lower.function_builder import NoTranslation
from umo.generate.lower.local_functions import local_function
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.lowered_telling import TELLS
from umo.generate.lower.terms import Known


class LoweredBranches(LoweredSubject):
    """The part of a function that is statements."""

    def lower_pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def lower_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        self.f.term(node.value)

    def lower_function_def(self, node: ast.FunctionDef) -> None:
        self.f.flow.names[node.name] = local_function(self.f, node)

    def lower_import(self, node: ast.Import | ast.ImportFrom) -> None:
        scope: dict[str, Any] = {}
        exec(
            compile(ast.Module([node], []), "<import>", "exec"), {"__name__": self.f.source.function.__module__}, scope
        )
        self.f.flow.names |= {name: Known(value, name=name) for name, value in scope.items()}
        if isinstance(node, ast.ImportFrom) and node.module:
            module = import_module(
                "." * node.level + node.module, self.f.source.function.__globals__.get("__package__")
            )
            for each in node.names:
                self.f.takes(module, each.name, node)

    # Ways ----------------------------------------------------------------------------------------------

    def lower_if(self, node: ast.If) -> bool | None:
        at = len(self.f.statements)
        try:
            truth = self.f.values.truth(self.f.term(node.test), node.test)
        except NoTranslation as refused:
            if (
                refused.reason != TELLS
                or not self.f.telling.does_nothing(node.test)
                or self._does_something([*node.body, *node.orelse])
            ):
                raise
            self.f.world.note(f"{self.f.source.segment(node.test)} decides only what is told: it is left out")
            return None
        shown = not self.f.changed_since(at)
        proved, disproved = (proved_by(node.test), disproved_by(node.test)) if shown else (set(), set())
        names, otherwise_names = self.f.flow.names_if(node.test)
        if isinstance(truth, bool):
            self.f.flow.known |= proved if truth else disproved
            self.f.flow.names = names if truth else otherwise_names
            return self.f.body(node.body if truth else node.orelse)
        before = set(self.f.flow.known)
        self.f.flow.known |= proved
        self.f.flow.names = names
        with self.f.body_of() as body:
            goes_on = self.f.body(node.body)
        one, self.f.flow.known = self.f.flow.way(), before | disproved
        self.f.flow.names = otherwise_names
        with self.f.one_of_two() as otherwise:
            other = self.f.body(node.orelse)
        self.f.add(If(truth, tuple(body), tuple(otherwise)))
        ways = [*([one] if goes_on else []), *([self.f.flow.way()] if other else [])]
        if ways:
            self.f.flow.go_on_from(ways)
        return None if goes_on or other else False

    def lower_match(self, node: ast.Match) -> bool:
        """As `if`s, of which each compares with what stands after `case`."""
        name = f"matched {node.lineno} {node.col_offset}"
        ways: list[ast.stmt] = []
        for case in reversed(node.cases):
            test = self._matches(case.pattern, name)
            test = test if case.guard is None else ast.BoolOp(ast.And(), [test, case.guard])
            ways = [ast.If(test, case.body, ways)]
        new = [ast.Assign([ast.Name(name, ast.Store())], node.subject), *ways]
        return self.f.body([ast.fix_missing_locations(ast.copy_location(each, node)) for each in new])

    def _matches(self, pattern: ast.pattern, name: str) -> ast.expr:
        if isinstance(pattern, ast.MatchOr):
            return ast.BoolOp(ast.Or(), [self._matches(each, name) for each in pattern.patterns])
        if isinstance(pattern, ast.MatchAs) and pattern.pattern is None and pattern.name is None:
            return ast.Constant(True)
        if isinstance(pattern, ast.MatchValue):
            return ast.Compare(ast.Name(name, ast.Load()), [ast.Eq()], [pattern.value])
        if isinstance(pattern, ast.MatchSingleton):
            return ast.Compare(ast.Name(name, ast.Load()), [ast.Is()], [ast.Constant(pattern.value)])
        raise self.f.refused(pattern, "this pattern does not translate", "values, None, |, _ and `if`")

    def _does_something(self, statements: Sequence[ast.stmt]) -> bool:
        """Whether more is left of statements than a text: a statement, or a way out."""
        with self.f.gathered() as found:
            goes_on = self.f.body(statements)
        return not goes_on or not self.f.world.only_tells(found)

    def lower_return(self, node: ast.Return) -> bool:
        term = Known(None) if node.value is None else self.f.term(node.value)
        self.f.results.append(term)
        self.f.aliases.sole_result = self.f.aliases.sole_result and self.f.aliases.is_sole(term)
        self.f.aliases.share(term)
        self.f.add(Return(self.f.world.result_of(self.f, term, node)))
        return False
