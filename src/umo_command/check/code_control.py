"""Finds errors in the code of a station that do not concern the use of sequences: calculations with objects in place of
their values, wrong values, code that waits outside the cycle, blocks that swallow a stop or a fault, data that all
objects of a class share. Only errors that are certain are reported."""

from __future__ import annotations

import ast
import asyncio
import difflib
import inspect
import os
import subprocess
import threading
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from umo.objects import Compound
from umo.objects.attributes import own_names
from umo_command.check.code_values import (
    FunctionNode,
    InnerFunction,
    Instance,
    ModuleCode,
    NameScope,
    Remarks,
    inside_of,
)

BLOCKING = (
    *(os.system, urllib.request.urlopen),
    *(subprocess.run, subprocess.call, subprocess.check_call, subprocess.check_output),
)
"""Functions that wait for another program or for a network."""
ASYNCIO: Mapping[Any, str] = {
    asyncio.run: "`await` the sequence",
    asyncio.sleep: "`await wait(...)`",
    asyncio.create_task: "`cycle.start(...)`",
    asyncio.ensure_future: "`cycle.start(...)`",
    asyncio.gather: "`await together(...)`",
    asyncio.wait_for: "`async with timeout(...):`",
}
"""Functions of asyncio, each with its replacement in a sequence."""
NAME_IT = "name the errors that are expected, as in `except TaskFailed:`"
HOOKS = ("control", "setup", "interlocks")
"""Methods of a class that umo calls."""
SIMPLE = (ast.Assign, ast.AnnAssign, ast.AugAssign, ast.Expr, ast.Return)
"""Statements that contain no other statements."""
CONDITIONAL = (ast.BoolOp, ast.IfExp, ast.Lambda, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
"""Expressions whose parts are not evaluated every time."""
ENDS = (ast.Return, ast.Raise)
"""Statements after which a function does not continue."""
CHANGING = frozenset(("append", "extend", "insert", "add", "update", "setdefault", "appendleft"))
"""Methods that change a container."""


# Objects and values ---------------------------------------------------------------------------------------


def _calculated(code: ModuleCode, node: ast.BinOp, scope: NameScope) -> Remarks:
    is_of_text = isinstance(node.op, ast.Mod)  # "%s" % m.level
    for each in (node.left,) if is_of_text else (node.left, node.right):
        if code.atomic(each, scope) and not isinstance(node.op, ast.BitOr):
            yield each, "`{}` is an object, not its value: write `{}.read()`"


def _without_effect(code: ModuleCode, node: ast.Expr, scope: NameScope) -> Remarks:
    if isinstance(node.value, ast.Compare) and scope.is_control:
        yield (
            node.value,
            "`{}` is compared, and nothing is done with the result: assign with `=`, or write the value to the object",
        )


def _local(code: ModuleCode, node: ast.Assign, scope: NameScope) -> Remarks:
    """Check a local name that equals the name of an attribute and is never read."""
    if scope.owner is None or not issubclass(scope.owner, Compound) or not scope.is_own_method:
        return
    for target in node.targets:
        if not isinstance(target, ast.Name) or target.id not in own_names(scope.owner):
            continue
        read = (each for each in ast.walk(scope.node) if isinstance(each, ast.Name) and each.id == target.id)
        others = [each for each in read if isinstance(each.ctx, ast.Load) and each is not node.value]
        if not others and not any(isinstance(each, ast.Global | ast.Nonlocal) for each in ast.walk(scope.node)):
            yield target, "`{}` is a name of this function only, and nothing reads it: write `self.{} = ...`"


# Time -----------------------------------------------------------------------------------------------------


def _called(code: ModuleCode, node: ast.Call, scope: NameScope) -> Remarks:
    if not scope.is_control:
        return
    value = code.value(node.func, scope)
    if any(value is each for each in BLOCKING):
        yield node, "`{}` stops the whole machine while it waits: do it in another program, or before the run"
    if isinstance(node.func, ast.Attribute) and node.func.attr in ("sample", "update") and not node.args:
        of = code.thing(node.func.value, scope)
        if isinstance(of, Instance) and issubclass(of.kind, Compound) and value is vars(Compound).get(node.func.attr):
            yield node, "`{}`: the cycle does this in each period: remove it"
    if _is_law(value) and _is_in_each_period(node, scope):
        yield node, "`{}` is created again in each period, so it keeps no state: create it in `setup`"
    if value is threading.Thread:
        yield from _thread(code, node, scope)
    for each, instead in ASYNCIO.items():
        if value is each:
            yield node, f"`{{}}`: asyncio cannot be used in a sequence: write {instead}"


def _is_law(value: Any) -> bool:
    """True if a value is the class of a control law of umo."""
    if not isinstance(value, type) or issubclass(value, Compound) or not value.__module__.startswith("umo.control."):
        return False
    return hasattr(value, "step") or hasattr(value, "control")


def _is_in_each_period(node: ast.Call, scope: NameScope) -> bool:
    """True if a law makes this call unconditionally in each period."""
    if not isinstance(scope.node, ast.FunctionDef):
        return False
    for statement in scope.node.body:
        if isinstance(statement, SIMPLE) and any(node is each for each in _always_evaluated(statement)):
            return True
        if any(isinstance(each, ENDS) for each in ast.walk(statement)):
            return False
    return False


def _always_evaluated(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the expressions that are evaluated whenever this expression is evaluated."""
    yield node
    if not isinstance(node, CONDITIONAL):
        for each in ast.iter_child_nodes(node):
            yield from _always_evaluated(each)


def _thread(code: ModuleCode, node: ast.Call, scope: NameScope) -> Remarks:
    """Check a thread that writes objects outside the cycle."""
    target: Any = next((each.value for each in node.keywords if each.arg == "target"), None)
    inner, found = scope, code.thing(target, scope) if target is not None else None
    if isinstance(found, InnerFunction):
        target, inner = found.node, NameScope(found.node, scope, code)
    for each in ast.walk(target) if target is not None else ():
        if isinstance(each, ast.Attribute) and each.attr == "write" and code.atomic(each.value, inner):
            yield (
                node,
                ("`{}` writes outside the cycle, at any time in a period: write in a sequence, `cycle.start(...)`"),
            )
            return


# Blocks ---------------------------------------------------------------------------------------------------


def _swallowed(code: ModuleCode, node: ast.Try, scope: NameScope) -> Remarks:
    """Check a block that catches exceptions: a stop of the machine, or a fault, passes through a sequence as one."""
    if not scope.is_control:
        return
    inside = [*inside_of(node.body)]
    is_sequence = isinstance(scope.node, ast.AsyncFunctionDef)
    for handler in node.handlers:
        caught = None if handler.type is None else code.value(handler.type, scope)
        if any(isinstance(each, ast.Raise) for each in inside_of(handler.body)):
            continue
        if (handler.type is None or caught is BaseException) and any(isinstance(each, ast.Await) for each in inside):
            yield handler, f"this block swallows the stop of the sequence too: {NAME_IT}"
        elif _is_any(handler.type, caught) and all(map(_is_nothing, handler.body)) and _acts(code, inside, scope):
            yield handler, f"this block swallows every fault, and nothing reports it: {NAME_IT}"
    for each in node.finalbody if is_sequence else ():
        if isinstance(each, ast.Return):
            yield (
                each,
                "`return` in `finally` swallows the stop of the sequence, and every error: write it after the block",
            )


def _suppressed(code: ModuleCode, node: ast.With, scope: NameScope) -> Remarks:
    for item in node.items:
        call = item.context_expr
        if not (isinstance(call, ast.Call) and code.value(call.func, scope) is suppress and scope.is_control):
            continue
        for each in call.args:
            if _is_any(each, code.value(each, scope)) and _acts(code, [*inside_of(node.body)], scope):
                yield call, f"`{{}}` swallows every fault, and nothing reports it: {NAME_IT}"


def _is_any(node: ast.expr | None, caught: Any) -> bool:
    return node is None or caught in (Exception, BaseException)


def _is_nothing(node: ast.stmt) -> bool:
    return isinstance(node, ast.Pass | ast.Continue) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    )


def _acts(code: ModuleCode, inside: list[ast.AST], scope: NameScope) -> bool:
    """True if this code waits, or reads or writes an object."""
    asked = (each.value for each in inside if isinstance(each, ast.Attribute))
    return any(isinstance(each, ast.Await) for each in inside) or any(code.atomic(each, scope) for each in asked)


# Classes --------------------------------------------------------------------------------------------------


def in_class(code: ModuleCode, node: ast.ClassDef, read: set[str]) -> Remarks:
    """Yield the errors in a class. `read`: the attributes that are read anywhere in the station."""
    kind = code.class_at(node)
    if kind is None or not issubclass(kind, Compound):
        return
    for each in node.body:
        if isinstance(each, FunctionNode) and not each.decorator_list:
            yield from _method(kind, each, read)
        elif isinstance(each, ast.Assign) and isinstance(each.value, ast.List | ast.Dict | ast.Set):
            names = {target.id for target in each.targets if isinstance(target, ast.Name)}
            if names & set(_changed(node)):
                name = next(iter(names))
                yield each, f"`{name}` is shared by all objects and all runs: write `self.{name} = ...` in `setup`"


def _method(kind: type, node: Any, read: set[str]) -> Remarks:
    arguments = node.args
    if not (arguments.posonlyargs or arguments.args or arguments.vararg):
        yield node, f"`{node.name}` has no parameter for its object: write `def {node.name}(self)`"
    near = difflib.get_close_matches(node.name, HOOKS, 1, 0.85)
    inherited = any(node.name in vars(base) for base in inspect.getmro(kind)[1:])
    if near and node.name not in (*HOOKS, *read) and not inherited and not node.name.startswith("_"):
        yield node, f"nothing calls `{node.name}`: umo calls `{near[0]}`"


def _changed(node: ast.ClassDef) -> Iterator[str]:
    """Yield the attributes of `self` that methods change in place, but never assign."""
    made = {each.attr for each in ast.walk(node) if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store)}
    for each in ast.walk(node):
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Attribute) and each.func.attr in CHANGING:
            of = each.func.value
            is_own = isinstance(of, ast.Attribute) and isinstance(of.value, ast.Name) and of.value.id == "self"
            if is_own and of.attr not in made:  # type: ignore[attr-defined]
                yield of.attr  # type: ignore[attr-defined]


LOOKS: tuple[tuple[Any, Callable[[ModuleCode, Any, NameScope], Remarks]], ...] = (
    (ast.BinOp, _calculated),
    (ast.Call, _called),
    (ast.Expr, _without_effect),
    (ast.Try, _swallowed),
    (ast.With, _suppressed),
    (ast.Assign, _local),
)
