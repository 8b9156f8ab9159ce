"""Finds errors in the code of a station that concern periods: loops and writes in which no period passes, values and
conditions that are evaluated at the wrong time, numbers that differ from run to run. Only errors that are certain are
reported."""

from __future__ import annotations

import ast
import datetime
import inspect
import random
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from types import FunctionType
from typing import Any

import numpy.random

from umo.control import unless, until
from umo.objects import Interlock
from umo.operation.alarms import Alarm
from umo_command.check.code_states import CodeObjects
from umo_command.check.code_values import (
    FunctionNode,
    ModuleCode,
    NameScope,
    Remarks,
    inside_of,
    waits_or_ends,
    within,
)

CLOCKS = (
    *(time.time, time.monotonic, time.perf_counter, time.time_ns, time.monotonic_ns, time.perf_counter_ns),
    *(inspect.getattr_static(datetime.datetime, name) for name in ("now", "utcnow", "today")),
)
"""Functions that return the time of the computer."""
SHARED = (random.random.__self__, numpy.random.random.__self__)  # type: ignore[attr-defined]
"""The generators of random numbers that all modules share."""
ASKED_LATER = (until, unless, Interlock, Alarm)
"""Callables whose first argument is a condition that is evaluated in later periods."""
COMPREHENSION = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
BLOCKS = ("body", "orelse", "finalbody")
"""The lists of statements that a statement may have."""


def _is_one_of(value: Any, known: Iterable[Any]) -> bool:
    return any(value is each for each in known)


def _names(node: ast.AST, kind: type[ast.expr_context]) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, kind)}


# Loops and writes -----------------------------------------------------------------------------------------


def _endless(code: ModuleCode, node: ast.While, scope: NameScope) -> Remarks:
    """Check an endless loop in which no period passes. A loop with a `try` or `with` block, or in one, is not reported:
    an error that the block expects may end the loop."""
    is_true = isinstance(node.test, ast.Constant) and bool(node.test.value)
    if not (is_true and scope.is_control) or any(map(waits_or_ends, inside_of(node.body))):
        return
    blocks = (each for each in within(scope.node) if isinstance(each, ast.Try | ast.With))
    if not any(node in ast.walk(each) or each in ast.walk(node) for each in blocks):
        text = "no period passes in this loop, so the machine stops here: write `await next_period()` in the loop"
        yield node.test, text


def _ramp(code: ModuleCode, node: ast.For, scope: NameScope) -> Remarks:
    """Check a loop that writes one actuator several times in one period."""
    if not scope.is_control or any(map(waits_or_ends, inside_of(node.body))):
        return
    turning = _names(node.target, ast.Store).union(*(_names(each, ast.Store) for each in node.body))
    for statement in node.body:
        written = _write_in(code, statement, scope)
        if written is None:
            continue
        of, value = written
        if _names(value, ast.Load) & turning and not _names(of, ast.Load) & turning:
            wait = "; write `await next_period()` in the loop" if isinstance(scope.node, ast.AsyncFunctionDef) else ""
            yield statement, f"no period passes in this loop, so only the last value of `{{}}` counts{wait}"


def overwritten(code: ModuleCode, values: CodeObjects, statements: list[ast.stmt], scope: NameScope) -> Remarks:
    """Find two writes of the same actuator without a period between them. An asynchronous actuator sends every
    write."""
    for first, second in pairwise(statements):
        one, other = (_write_in(code, each, scope) for each in (first, second))
        if one is None or other is None or ast.unparse(one[0]) != ast.unparse(other[0]):
            continue
        items = values.objects(one[0], scope)
        if items and all(each.synchronous for each in items) and ast.unparse(one[1]) != ast.unparse(other[1]):
            text = "`{}` has no effect, because no period passes before the next value"
            yield first, f"{text}: write `await wait(...)` between the two"


def _write_in(code: ModuleCode, node: ast.stmt, scope: NameScope) -> tuple[ast.expr, ast.expr] | None:
    """The actuator and the value of a statement that writes."""
    call = node.value if isinstance(node, ast.Expr) and scope.is_control else None
    if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "write"):
        return None
    is_written = len(call.args) == 1 and code.atomic(call.func.value, scope)
    return (call.func.value, call.args[0]) if is_written else None


# What is taken at the wrong time --------------------------------------------------------------------------


def _read_once(code: ModuleCode, node: ast.While, scope: NameScope) -> Remarks:
    """Check a loop whose test contains only values that were read before the loop, and that nothing else ends."""
    ends = (ast.Break, ast.Return, ast.Raise)
    inside = [*inside_of(node.body)]
    if any(isinstance(each, ast.Await | ast.AsyncWith) for each in inside) and not any(
        isinstance(each, ends) for each in inside
    ):
        yield from _constant(code, node.test, scope)


def _asked_later(code: ModuleCode, node: ast.Call, scope: NameScope) -> Remarks:
    """Check the condition of a wait in the same way."""
    value = code.value(node.func, scope)
    if node.args and isinstance(node.args[0], ast.Lambda) and _is_one_of(value, (until, unless)):
        yield from _constant(code, node.args[0].body, scope)


def _constant(code: ModuleCode, test: ast.expr, scope: NameScope) -> Remarks:
    """Return remarks on a condition that is evaluated repeatedly, if all of its names are bound only once, and one of
    them by a reading."""
    if not isinstance(scope.node, ast.AsyncFunctionDef) or not isinstance(test, ast.Compare):
        return
    for each in ast.walk(test):
        is_state = isinstance(each, ast.Attribute) and isinstance(code.value(each.value, scope), type)
        if isinstance(each, ast.Call | ast.Subscript | ast.Attribute | ast.NamedExpr) and not is_state:
            return
    bound = {name: scope.bindings.get(name, []) for name in _names(test, ast.Load)}
    if any(len(found) > 1 for found in bound.values()):
        return
    for name, found in bound.items():
        if found and found[0].how == "value" and (reading := _reading(code, found[0].node, scope)):
            text = f"`{{}}` never changes, because `{name}` was read once, before"
            yield test, f"{text}: write `{reading}` instead of `{name}`"
            return


def _reading(code: ModuleCode, node: ast.expr, scope: NameScope) -> str:
    """Return the source of an expression if it reads an object, otherwise ""."""
    is_read = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "read"
    return ast.unparse(node) if is_read and code.atomic(node.func.value, scope) else ""  # type: ignore[attr-defined]


def _late(code: ModuleCode, node: Any, scope: NameScope) -> Remarks:
    """Check a condition that is made in a loop and evaluated after the loop has ended. A name that the loop binds then
    has the value of the last turn."""
    if isinstance(node, ast.For):
        if any(isinstance(each, ast.Await | ast.AsyncWith | ast.Break | ast.Return) for each in inside_of(node.body)):
            return
        turning, parts = _names(node.target, ast.Store), [*inside_of(node.body)]
        turning |= {name for each in node.body for name in _names(each, ast.Store)}
    else:
        turning = set().union(*(_names(each.target, ast.Store) for each in node.generators))
        parts = [*ast.walk(node)]
        if any(isinstance(each, ast.Await) for each in parts):
            return
    for call in parts:
        condition = call.args[0] if isinstance(call, ast.Call) and call.args else None
        if not isinstance(condition, ast.Lambda):
            continue
        value = code.value(call.func, scope)  # type: ignore[attr-defined]
        late = (_names(condition.body, ast.Load) & turning) - {each.arg for each in condition.args.args}
        if late and _is_one_of(value, ASKED_LATER):
            name = min(late)
            yield (
                condition,
                f"`{{}}`: `{name}` has the value of the last turn of the loop when this is called; write `lambda "
                f"{name}={name}:`",
            )


# Time and chance ------------------------------------------------------------------------------------------


def _clock(code: ModuleCode, node: Any, scope: NameScope) -> Remarks:
    """Check a decision that depends on the computer's time."""
    for each in ast.walk(node.test) if scope.is_control else ():
        if isinstance(each, ast.Call) and not each.args and _is_one_of(code.value(each.func, scope), CLOCKS):
            yield each, "`{}` is the computer's time, which virtual time and a replay do not follow: use `.now`"


def _random(code: ModuleCode, node: ast.Call, scope: NameScope) -> Remarks:
    """Check numbers of a random generator without a seed."""
    if scope.is_control and _is_without_seed(code.value(node.func, scope), node) and not code.gives_seed:
        yield node, "`{}` is a different number in each run: use `cycle.random`, which has the seed of the run"


def _is_without_seed(value: Any, node: ast.Call) -> bool:
    """True if a call uses a generator that all modules share, or makes a generator without a seed."""
    if _is_one_of(value, (random.Random, numpy.random.default_rng)):
        return not node.args and not node.keywords
    return _is_one_of(getattr(value, "__self__", None), SHARED)


def _fixed_step(code: ModuleCode, node: ast.Call, scope: NameScope) -> Remarks:
    """Check a law that gets the time of a period as a constant."""
    value = code.value(node.func, scope)
    if not (isinstance(value, FunctionType) and value.__module__.startswith("umo.control.") and scope.is_control):
        return
    places = [*inspect.signature(value).parameters]
    if "dt" not in places:
        return
    place = places.index("dt") - 1
    given = [*node.args[place : place + 1], *(each.value for each in node.keywords if each.arg == "dt")]
    for each in given:
        if isinstance(each, ast.Constant):
            yield each, "`{}` is not the period if a wiring sets another period: write `self.dt`"


def blocks_in(scope: ast.AST) -> Iterator[list[ast.stmt]]:
    """Return the lists of statements of a function or module, without the lists of inner functions."""
    for node in (scope, *within(scope)):
        if node is scope or not isinstance(node, FunctionNode | ast.Lambda | ast.ClassDef):
            for name in BLOCKS:
                if isinstance(found := getattr(node, name, None), list):
                    yield found


LOOKS: tuple[tuple[Any, Callable[[ModuleCode, Any, NameScope], Remarks]], ...] = (
    (ast.While, _endless),
    (ast.While, _read_once),
    (ast.While | ast.If, _clock),
    (ast.For, _ramp),
    ((ast.For, *COMPREHENSION), _late),
    (ast.Call, _asked_later),
    (ast.Call, _random),
    (ast.Call, _fixed_step),
)
