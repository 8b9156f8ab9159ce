"""Errors: their raising and catching, and the statements that are carried out on the way out."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from umo.generate.c_types import BOOL, INT
from umo.generate.check.form_effects import may_fail, returns
from umo.generate.form import TRUE, ErrorHandler, Fail, Finally, Statement, Temporary, Try, negated
from umo.generate.lower.flow import FlowState, proved_by
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.lowered_subject import LoweredSubject
from umo.generate.lower.terms import TEXT, Known, TupleTerm
from umo.generate.value_kinds import made_by_code


class LoweredErrors(LoweredSubject):
    """Lowers raise, try, assert and with."""

    def __init__(self, f: FunctionBuilder) -> None:
        super().__init__(f)
        self.tries = 0
        """The number of `try` statements around this one."""
        self.caught: list[Temporary] = []
        """The faults that are being handled."""

    def lower_raise(self, node: ast.Raise) -> bool:
        if node.exc is None:
            if not self.caught:
                raise self.f.refused(node, "`raise` without an error stands outside of `except`")
            self.f.add(Fail(self.caught[-1]))
            return False
        self.f.texts.check_removable(error_arguments(node.exc))
        if node.cause is not None:
            self.f.texts.check_removable([node.cause])
        error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        kind = self.f.term(error)
        if isinstance(kind, Known) and isinstance(kind.value, type) and issubclass(kind.value, BaseException):
            if made_by_code(kind.value):
                raise self.f.refused(
                    node, f"{kind.value.__name__} runs code when it is created", "a class without __init__"
                )
            said = _said(node.exc, self.f.source.segment(node.exc))
            fault = self.f.fault(kind.value, node, said)
            if not all(isinstance(each, ast.Constant) for each in error_arguments(node.exc)):
                self.f.texts.python_makes_error(node.exc, kind.value, said, fault)
            self.f.add(Fail(fault))
            return False
        raise self.f.refused(node, "the class of the error is not known when the code is generated", "raise Error(...)")

    def lower_assert(self, node: ast.Assert) -> None:
        at = len(self.f.statements)
        truth = self.f.values.truth(self.f.term(node.test), node.test)
        shown = not self.f.changed_since(at)
        self.f.flow.names, _ = self.f.flow.names_if(node.test)
        if truth is not True:
            self.f.texts.check_removable([] if node.msg is None else [node.msg])
            said = node.msg.value if isinstance(node.msg, ast.Constant) and isinstance(node.msg.value, str) else None
            self.f.raises(AssertionError, node, TRUE if truth is False else negated(truth), said)
        self.f.flow.known |= proved_by(node.test) if shown else set()

    def lower_try(self, node: ast.Try) -> bool | None:
        if any(map(_leaves, node.finalbody)):
            raise self.f.refused(node, "a jump out of `finally` discards the error", "except")
        return self._with_finally(node) if node.finalbody else self._with_except(node)

    def _with_finally(self, node: ast.Try) -> bool | None:
        pending, before = self.f.temporary(INT, "pending"), dict(self.f.flow.names)
        with self.tried() as body:
            goes_on = self._with_except(node) if node.handlers or node.orelse else self.f.body(node.body)
        returning = self.f.temporary(BOOL, "returning") if returns(body) else None
        after = self.f.flow.names if goes_on is not False else before
        self.f.flow.names = {name: of for name, of in before.items() if self.f.flow.names.get(name, of) == of}
        self.f.flow.known.clear()
        with self.f.gathered() as last:
            ends = self.f.body(node.finalbody)
        self.f.add(Finally(pending, returning, tuple(body), tuple(last)))
        if ends is False:
            return False
        self.f.flow.names = {
            name: of for name, of in after.items() if self.f.flow.names.get(name, of) == of
        } | self.f.flow.names
        return None if goes_on is not False else False

    @contextmanager
    def tried(self) -> Iterator[list[Statement]]:
        """Return a context for statements that no `break` or `continue` leaves."""
        self.tries += 1
        try:
            with self.f.gathered() as found:
                yield found
        finally:
            self.tries -= 1

    def _with_except(self, node: ast.Try) -> bool | None:
        if not node.handlers:
            return self.f.body([*node.body, *node.orelse])
        caught, names = self.f.temporary(INT, "caught"), dict(self.f.flow.names)
        with self.tried() as body:
            goes_on = self.f.body(node.body)
        with self.f.gathered() as otherwise:
            if goes_on and node.orelse:
                goes_on = self.f.body(node.orelse)
        if not may_fail(body):
            self.f.statements += [*body, *otherwise]
            return None if goes_on else False
        ways = [self.f.flow.way()] if goes_on else []
        handlers, more = self._caught(node.handlers, caught, names)
        self.f.add(Try(caught, tuple(body), tuple(otherwise), handlers))
        ways += more
        if ways:
            self.f.flow.go_on_from(ways)
        self.f.flow.known.clear()
        return None if ways else False

    def _caught(
        self, nodes: list[ast.ExceptHandler], caught: Temporary, names: dict[str, Any]
    ) -> tuple[tuple[ErrorHandler, ...], list[FlowState]]:
        """Return the handlers, and what is known where they end."""
        handlers, ways = [], []
        for each in nodes:
            kinds = self._kinds(each)
            self.f.flow.names = {name: of for name, of in names.items() if self.f.flow.names.get(name, of) == of}
            self.f.flow.known.clear()
            if each.name:
                self.f.flow.names[each.name] = Known(TEXT)  # its class and what it says are of run time
            self.caught.append(caught)
            with self.f.body_of() as body:
                if self.f.body(each.body):
                    self.f.flow.names.pop(each.name or "", None)
                    ways.append(self.f.flow.way())
            self.caught.pop()
            handlers.append(ErrorHandler(kinds, tuple(body)))
        return tuple(handlers), ways

    def _kinds(self, handler: ast.ExceptHandler) -> tuple[type[BaseException], ...]:
        if handler.type is None:
            return (BaseException,)
        term = self.f.term(handler.type)
        terms = term.terms if isinstance(term, TupleTerm) else [term]
        values = [each.value if isinstance(each, Known) else None for each in terms]
        kinds = [one for each in values for one in (each if isinstance(each, tuple) else (each,))]
        for each in kinds:
            if not (isinstance(each, type) and issubclass(each, BaseException)) or type(each) is not type:
                raise self.f.refused(
                    handler, "the caught class is not a class of errors", "ZeroDivisionError, RangeError, ..."
                )
        return tuple(kinds)

    def lower_with(self, node: ast.With) -> bool | None:
        """Lower `with suppress(...)`."""
        call = node.items[0].context_expr
        if len(node.items) == 1 and node.items[0].optional_vars is None and isinstance(call, ast.Call):
            func = self.f.term(call.func)
            if isinstance(func, Known) and func.value is np.errstate and all(map(_lets_go_on, call.keywords)):
                return self.f.body(node.body)
            if isinstance(func, Known) and func.value is suppress and call.args and not call.keywords:
                kinds = ast.Tuple(call.args, ast.Load())
                handler = ast.ExceptHandler(ast.copy_location(kinds, call), None, [ast.copy_location(ast.Pass(), node)])
                tried = ast.Try(node.body, [ast.copy_location(handler, node)], [], [])
                return self.lower_try(ast.copy_location(tried, node))
        nearest = "with suppress(...), with np.errstate(all='ignore')"
        raise self.f.refused(node, "`with` cannot be translated", nearest)


def _lets_go_on(setting: ast.keyword) -> bool:
    """True if numpy continues after an error with this setting."""
    return isinstance(setting.value, ast.Constant) and setting.value.value in ("ignore", "warn")


def error_arguments(error: ast.expr) -> list[ast.expr]:
    """Return the expressions in the message of an error."""
    return [*error.args, *(each.value for each in error.keywords)] if isinstance(error, ast.Call) else []


def _said(error: ast.AST, text: str) -> str:
    """Return the message of an error as it is written in the code."""
    if isinstance(error, ast.Call) and error.args:
        return (
            ast.unparse(error.args[0]).strip("'\"")
            if isinstance(error.args[0], ast.Constant)
            else ast.unparse(error.args[0])
        )
    return text


def _leaves(node: ast.AST, in_loop: bool = False) -> bool:
    """True if a statement leaves the block around it. A loop inside it may be left."""
    if isinstance(node, ast.FunctionDef):
        return False
    if isinstance(node, ast.Break | ast.Continue):
        return not in_loop
    inside = node.body if isinstance(node, ast.For | ast.While) else []
    parts = ((each, in_loop or each in inside) for each in ast.iter_child_nodes(node))
    return isinstance(node, ast.Return) or any(_leaves(each, within) for each, within in parts)
