"""Errors: how they are raised and caught, and what is done on the way out."""

from __future__ import annotations

import ast
from contextlib import suppress
from typing import Any

from umo.generate.c_types import BOOL, INT
from umo.generate.function_scope import TryBlock
from umo.generate.loop_code import LoopCode
from umo.generate.terms import Known


class ErrorCode(LoopCode):
    """The part of a function that is raise, try, assert and with."""

    def _join(self, one: dict[str, Any], goes_on: bool, other: bool) -> None:
        raise NotImplementedError

    def _Raise(self, node: ast.Raise) -> bool:
        if node.exc is None:
            if not self.world.caught:
                raise self.refused(node, "`raise` outside of `except`")
            self.fail(self.world.caught[-1])
            return False
        error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        kind = self.term(error)
        if isinstance(kind, Known) and isinstance(kind.value, type) and issubclass(kind.value, BaseException):
            self.raises(kind.value, node, text=_said(node.exc, self.source.segment(node.exc)))
            return False
        raise self.refused(node, "the class of the error is not known when the code is generated", "raise Error(...)")

    def _Assert(self, node: ast.Assert) -> None:
        truth = self.truth(self.term(node.test), node.test)
        if truth is not True:
            self.raises(AssertionError, node, "true" if truth is False else f"!({truth})")
        self.known |= self.proved(node.test)

    def _Try(self, node: ast.Try) -> bool | None:
        returns = any(isinstance(each, ast.Return) for part in node.body + node.orelse for each in ast.walk(part))
        returns |= any(isinstance(each, ast.Return) for part in node.handlers for each in ast.walk(part))
        if node.finalbody:
            pending = self.temporary(INT, "pending")
            returning = self.temporary(BOOL, "returning") if returns else ""
            return self._with_finally(node, TryBlock(self.label("finally"), pending, returning=returning))
        return self._with_except(node)

    def _with_finally(self, node: ast.Try, handler: TryBlock) -> bool | None:
        self.line(f"{handler.variable} = UMO_OK;", pure=True)
        if handler.returning:
            self.line(f"{handler.returning} = false;", pure=True)
        self.handlers.append(handler)
        goes_on = self._with_except(node) if node.handlers or node.orelse else self.body(node.body)
        self.handlers.pop()
        if handler.uses:
            self.line(f"{handler.label}:;", pure=True)
        self.known.clear()
        self.body(node.finalbody)
        self.fail(f"(umo_fault){handler.variable}", f"{handler.variable} != UMO_OK")
        if handler.returning:
            outer = [each for each in self.handlers if each.returning]
            with self.block(f"if ({handler.returning})"):
                if outer:
                    outer[-1].uses += 1
                    self.line(f"{outer[-1].returning} = true;", pure=True)
                    self.line(f"goto {outer[-1].label};", pure=True)
                else:
                    self.line("return UMO_OK;", pure=True)
        return None if goes_on is not False else False

    def _with_except(self, node: ast.Try) -> bool | None:
        if not node.handlers:
            return self.body([*node.body, *node.orelse])
        caught, after = self.temporary(INT, "caught"), self.label("after")
        handler = TryBlock(self.label("except"), caught)
        self.handlers.append(handler)
        names = dict(self.names)
        goes_on = self.body(node.body)
        self.handlers.pop()
        if goes_on and node.orelse:
            goes_on = self.body(node.orelse)
        if not handler.uses:
            return None if goes_on else False
        after_body = self.names
        if goes_on:
            self.line(f"goto {after};", pure=True)
        self.line(f"{handler.label}:;", pure=True)
        others = self._caught(node.handlers, caught, after, names)
        self.known.clear()
        if goes_on or others:
            self.line(f"{after}:;", pure=True)
        self._join(after_body, goes_on is not False, others)
        return None if goes_on or others else False

    def _caught(self, handlers: list[ast.ExceptHandler], caught: str, after: str, names: dict[str, Any]) -> bool:
        goes_on = False
        first = True
        for each in handlers:
            kinds = self._kinds(each)
            self.names = dict(names)
            if each.name:
                self.names[each.name] = Known(object())
            self.world.caught.append(f"(umo_fault){caught}")
            with self.block(f"if ({self.world.is_a(caught, kinds)})"):
                if self.body(each.body):
                    goes_on = True
                    self.line(f"goto {after};", pure=True)
            self.world.caught.pop()
            first = False
        assert not first
        self.fail(f"(umo_fault){caught}")
        return goes_on

    def _kinds(self, handler: ast.ExceptHandler) -> tuple[type[BaseException], ...]:
        if handler.type is None:
            return (BaseException,)
        term = self.term(handler.type)
        found = term.value if isinstance(term, Known) else tuple(getattr(each, "value", None) for each in term.terms)  # type: ignore[union-attr]
        return found if isinstance(found, tuple) else (found,)

    def _With(self, node: ast.With) -> bool | None:
        """`with suppress(...)`."""
        call = node.items[0].context_expr
        if len(node.items) == 1 and isinstance(call, ast.Call):
            func = self.term(call.func)
            if isinstance(func, Known) and func.value is suppress:
                kinds = ast.Tuple(call.args, ast.Load())
                handler = ast.ExceptHandler(ast.copy_location(kinds, call), None, [ast.copy_location(ast.Pass(), node)])
                tried = ast.Try(node.body, [ast.copy_location(handler, node)], [], [])
                return self._Try(ast.copy_location(tried, node))
        raise self.refused(node, "`with` does not translate", "with suppress(...)")


def _said(error: ast.AST, text: str) -> str:
    """The message of an error as it is written."""
    if isinstance(error, ast.Call) and error.args:
        return (
            ast.unparse(error.args[0]).strip("'\"")
            if isinstance(error.args[0], ast.Constant)
            else ast.unparse(error.args[0])
        )
    return text
