"""Statements other than assignments and loops."""

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
from umo.generate.lower.lowered_telling import DEPENDS_ON_TEXT
from umo.generate.lower.terms import Known


class LoweredBranches(LoweredSubject):
    """Lowers the statements of a function."""

    def lower_pass(self, node: ast.Pass) -> None:
        """Do nothing."""

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
                refused.reason != DEPENDS_ON_TEXT
                or not self.f.texts.does_nothing(node.test)
                or self._does_something([*node.body, *node.orelse])
            ):
                raise
            self.f.world.note(f"{self.f.source.segment(node.test)} only decides which text is made: it is left out")
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
        """Lower `match` as `if` statements that compare the value with each pattern."""
        name = ast.Name(f"matched {node.lineno} {node.col_offset}", ast.Load())
        ways: list[ast.stmt] = []
        for case in reversed(node.cases):
            test, names = self._pattern(case.pattern, name, node.subject)
            if isinstance(case.pattern, ast.MatchAs) and case.pattern.pattern is None:
                ways = [*names, ast.If(case.guard or test, case.body, ways)]  # a name has its value in the guard
                continue
            if names and case.guard is not None:
                raise self.f.refused(case.pattern, "a name in a pattern with an `if`", "an `if` in the case")
            test = test if case.guard is None else ast.BoolOp(ast.And(), [test, case.guard])
            ways = [ast.If(test, [*names, *case.body], ways)]
        new = [ast.Assign([ast.Name(name.id, ast.Store())], node.subject), *ways]
        return self.f.body([ast.fix_missing_locations(ast.copy_location(each, node)) for each in new])

    def _pattern(self, pattern: ast.pattern, value: ast.expr, subject: ast.expr) -> tuple[ast.expr, list[ast.stmt]]:
        """Return the condition of a pattern for a value, and the assignments to its names. `subject` is the source of
        the value."""
        if isinstance(pattern, ast.MatchOr):
            tests, names = zip(*(self._pattern(each, value, subject) for each in pattern.patterns), strict=True)
            if not any(names):
                return ast.BoolOp(ast.Or(), [*tests]), []
        if isinstance(pattern, ast.MatchAs):
            inner = pattern.pattern
            test, found = (ast.Constant(True), []) if inner is None else self._pattern(inner, value, subject)
            store = [] if pattern.name is None else [ast.Assign([ast.Name(pattern.name, ast.Store())], value)]
            return test, [*found, *store]
        if isinstance(pattern, ast.MatchValue):
            return ast.Compare(value, [ast.Eq()], [pattern.value]), []
        if isinstance(pattern, ast.MatchSingleton):
            return ast.Compare(value, [ast.Is()], [ast.Constant(pattern.value)]), []
        if isinstance(pattern, ast.MatchSequence) and isinstance(subject, ast.Tuple):
            return self._sequence(pattern, value, subject)
        nearest = "values, None, |, _, names and `if`; (a, b) for a tuple that is written out"
        raise self.f.refused(pattern, "this pattern cannot be translated", nearest)

    def _sequence(
        self, pattern: ast.MatchSequence, value: ast.expr, subject: ast.Tuple
    ) -> tuple[ast.expr, list[ast.stmt]]:
        """Return the same for the patterns of the elements of a tuple that is written out."""
        parts = pattern.patterns
        uneven = any(isinstance(each, ast.MatchStar | ast.Starred) for each in (*parts, *subject.elts))
        if uneven or len(parts) != len(subject.elts):
            raise self.f.refused(pattern, "the pattern has another number of elements", "one pattern per element")
        found = [
            self._pattern(each, ast.Subscript(value, ast.Constant(n), ast.Load()), of)
            for n, (each, of) in enumerate(zip(parts, subject.elts, strict=True))
        ]
        return ast.BoolOp(ast.And(), [ast.Constant(True), *(test for test, _ in found)]), [
            each for _, names in found for each in names
        ]

    def _does_something(self, statements: Sequence[ast.stmt]) -> bool:
        """True if these statements do more than make a text."""
        with self.f.gathered() as found:
            goes_on = self.f.body(statements)
        return not goes_on or not self.f.world.only_makes_texts(found)

    def lower_return(self, node: ast.Return) -> bool:
        term = Known(None) if node.value is None else self.f.term(node.value)
        self.f.results.append(term)
        self.f.aliases.sole_result = self.f.aliases.sole_result and self.f.aliases.is_sole(term)
        self.f.aliases.share(term)
        self.f.add(Return(self.f.world.result_of(self.f, term, node)))
        return False
