"""Errors: how they are raised and caught, and what is done on the way out."""

from __future__ import annotations

import ast
from contextlib import suppress
from typing import Any

from umo.generate.c_types import BOOL, INT
from umo.generate.function_scope import TryBlock, Way
from umo.generate.loop_code import LoopCode
from umo.generate.terms import TEXT, Known, Many
from umo.generate.value_kinds import made_by_code

LEAVING = (ast.Return, ast.Break, ast.Continue)


class ErrorCode(LoopCode):
    """The part of a function that is raise, try, assert and with."""

    def _Raise(self, node: ast.Raise) -> bool:
        if node.exc is None:
            if not self.caught:
                raise self.refused(node, "`raise` outside of `except`")
            self.fail(self.caught[-1])
            return False
        self.check_told(error_arguments(node.exc))
        if node.cause is not None:
            self.check_told([node.cause])
        error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        kind = self.term(error)
        if isinstance(kind, Known) and isinstance(kind.value, type) and issubclass(kind.value, BaseException):
            if made_by_code(kind.value):
                raise self.refused(node, f"{kind.value.__name__} runs code when it is made", "a class without __init__")
            self.raises(kind.value, node, text=_said(node.exc, self.source.segment(node.exc)))
            return False
        raise self.refused(node, "the class of the error is not known when the code is generated", "raise Error(...)")

    def _Assert(self, node: ast.Assert) -> None:
        truth = self.truth(self.term(node.test), node.test)
        if truth is not True:
            self.check_told([] if node.msg is None else [node.msg])
            self.raises(AssertionError, node, "true" if truth is False else f"!({truth})")
        self.known |= self.proved(node.test)

    def _Try(self, node: ast.Try) -> bool | None:
        returns = any(isinstance(each, ast.Return) for part in node.body + node.orelse for each in ast.walk(part))
        returns |= any(isinstance(each, ast.Return) for part in node.handlers for each in ast.walk(part))
        if any(isinstance(each, LEAVING) for part in node.finalbody for each in ast.walk(part)):
            raise self.refused(node, "`finally` is left, which forgets the error", "except")
        if node.finalbody:
            pending = self.temporary(INT, "pending")
            returning = self.temporary(BOOL, "returning") if returns else ""
            return self._with_finally(node, TryBlock(self.label("finally"), pending, returning=returning))
        return self._with_except(node)

    def _with_finally(self, node: ast.Try, handler: TryBlock) -> bool | None:
        self.line(f"{handler.variable} = UMO_OK;", pure=True)
        if handler.returning:
            self.line(f"{handler.returning} = false;", pure=True)
        before = dict(self.names)
        self.handlers.append(handler)
        goes_on = self._with_except(node) if node.handlers or node.orelse else self.body(node.body)
        self.handlers.pop()
        if handler.uses:
            self.line(f"{handler.label}:;", pure=True)
        after = self.names if goes_on is not False else before
        self.names = {name: of for name, of in before.items() if self.names.get(name, of) == of}
        self.known.clear()
        if self.body(node.finalbody) is False:
            return False
        self.names = {name: of for name, of in after.items() if self.names.get(name, of) == of} | self.names
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
        ways = [self.way()] if goes_on else []
        if goes_on:
            self.line(f"goto {after};", pure=True)
        self.line(f"{handler.label}:;", pure=True)
        ways += self._caught(node.handlers, caught, after, names)
        if ways:
            self.line(f"{after}:;", pure=True)
            self.go_on_from(ways)
        self.known.clear()
        return None if ways else False

    def _caught(self, handlers: list[ast.ExceptHandler], caught: str, after: str, names: dict[str, Any]) -> list[Way]:
        """The handlers; what is known where they go on."""
        ways = []
        for each in handlers:
            kinds = self._kinds(each)
            self.names = {name: of for name, of in names.items() if self.names.get(name, of) == of}
            self.known.clear()
            if each.name:
                self.names[each.name] = Known(TEXT)  # its class and what it says are of run time
            self.caught.append(f"(umo_fault){caught}")
            with self.block(f"if ({self.world.is_a(caught, kinds)})"):
                if self.body(each.body):
                    self.names.pop(each.name or "", None)
                    ways.append(self.way())
                    self.line(f"goto {after};", pure=True)
            self.caught.pop()
        self.fail(f"(umo_fault){caught}")
        return ways

    def _kinds(self, handler: ast.ExceptHandler) -> tuple[type[BaseException], ...]:
        if handler.type is None:
            return (BaseException,)
        term = self.term(handler.type)
        terms = term.terms if isinstance(term, Many) else [term]
        values = [each.value if isinstance(each, Known) else None for each in terms]
        kinds = [one for each in values for one in (each if isinstance(each, tuple) else (each,))]
        for each in kinds:
            if not (isinstance(each, type) and issubclass(each, BaseException)) or type(each) is not type:
                raise self.refused(
                    handler, "what is caught is no class of errors", "ZeroDivisionError, RangeError, ..."
                )
        return tuple(kinds)

    def _With(self, node: ast.With) -> bool | None:
        """`with suppress(...)`."""
        call = node.items[0].context_expr
        if len(node.items) == 1 and node.items[0].optional_vars is None and isinstance(call, ast.Call):
            func = self.term(call.func)
            if isinstance(func, Known) and func.value is suppress and call.args and not call.keywords:
                kinds = ast.Tuple(call.args, ast.Load())
                handler = ast.ExceptHandler(ast.copy_location(kinds, call), None, [ast.copy_location(ast.Pass(), node)])
                tried = ast.Try(node.body, [ast.copy_location(handler, node)], [], [])
                return self._Try(ast.copy_location(tried, node))
        raise self.refused(node, "`with` does not translate", "with suppress(...)")


def error_arguments(error: ast.expr) -> list[ast.expr]:
    """What the message of an error is made of."""
    return [*error.args, *(each.value for each in error.keywords)] if isinstance(error, ast.Call) else []


def _said(error: ast.AST, text: str) -> str:
    """The message of an error as it is written."""
    if isinstance(error, ast.Call) and error.args:
        return (
            ast.unparse(error.args[0]).strip("'\"")
            if isinstance(error.args[0], ast.Constant)
            else ast.unparse(error.args[0])
        )
    return text
