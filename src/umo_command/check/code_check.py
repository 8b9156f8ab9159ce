"""Finds errors in the code of a station that would appear late in a run, or never: a sequence that is never awaited, a
function that is never called, a condition that is evaluated only once, a comparison that is never true, an attribute
that does not exist. The code is not executed. Only errors that are certain are reported."""

from __future__ import annotations

import ast
import builtins
import inspect
import os
import sys
import time
import tokenize
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from umo.control import Lock, first, timeout, together, unless, until
from umo.cycle.sequence_mistakes import called_name, forgotten, no_machine
from umo.errors import Mistake
from umo.objects import Compound, Interlock, link
from umo.objects.stored_names import MAKING
from umo.operation.alarms import Alarm
from umo.process.station import Station
from umo.text import shown_path, shown_place
from umo.user_code import definition
from umo_command.check import code_control, code_periods
from umo_command.check.code_states import CodeObjects
from umo_command.check.code_units import CodeUnits, declared_units
from umo_command.check.code_values import (
    ExactObject,
    FunctionNode,
    InnerFunction,
    Instance,
    MadeSequence,
    ModuleCode,
    NameScope,
    Objects,
    Remarks,
    waits_or_ends,
    within,
)

CONDITIONS: Mapping[Any, str] = {until: "until", unless: "unless", Interlock: "Interlock"}
"""Callables whose first argument is a condition: a function without arguments."""
ASKING = (*CONDITIONS, Alarm)
UNUSED_RESULTS: Mapping[Any, str] = {timeout: "async with {}:", Lock: "async with {}:", Interlock: "yield {}"}
"""Callables whose result must be used, each with the text to write instead."""
BLOCKING = (time.sleep, builtins.input)
"""Functions that wait without letting periods pass."""
SEQUENCES = (together, first, link.Cycle.start)
"""Functions that take only sequences."""
SHOWING = (print, str, repr, float, int, round, abs, sum)
"""Functions of Python that use values, such as `print`."""
ORDERS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
"""The signs of those comparisons that functions do not support."""
VALUES = (ast.Compare, ast.UnaryOp, ast.Constant, ast.JoinedStr)
"""Kinds of expressions that are never functions."""


def mistakes_in(station: Station, machine: Compound) -> list[Mistake]:
    """Return the errors in all imported modules of the station, in the order of files and lines."""
    return mistakes_of(_modules(station), machine, station.main)


def mistakes_of(modules: list[ModuleType], machine: Compound, main: Any) -> list[Mistake]:
    """Return the errors in some modules. `main`: the application, which receives the machine."""
    sources = {module: _source(str(module.__file__)) for module in modules}
    trees = {module: ast.parse(source) for module, source in sources.items()}
    names, units = _Attributes(trees.values()), declared_units(machine)
    objects = Objects(machine, modules, names.changing)
    found = (
        [Mistake(shown_place(definition(main)), "", text)] if main is not None and (text := no_machine(main)) else []
    )
    for module, tree in trees.items():
        code = ModuleCode(module, tree, objects, main)
        values = CodeObjects(code, objects)
        check = _Check(code, sources[module], names, values, CodeUnits(code, values, units))
        found += [Mistake(f"{shown_path(str(module.__file__))}:{line}", "", text) for line, text in check.all()]
    return found


def _modules(station: Station) -> list[ModuleType]:
    """Return the imported modules of the station."""
    found = {}
    folder = cache(os.path.realpath)  # resolved once for all modules of a folder
    for module in list(sys.modules.values()):
        file = getattr(module, "__file__", None)
        if isinstance(file, str) and file.endswith(".py"):
            if os.path.islink(file):
                place = os.path.realpath(file)
            else:
                place = os.path.join(folder(os.path.dirname(file)), os.path.basename(file))
            if place.startswith(f"{station.path}{os.sep}"):
                found[Path(place)] = module
    return [found[file] for file in sorted(found)]


def _source(file: str) -> str:
    with tokenize.open(file) as stream:
        return stream.read()


class _Attributes:
    """The names of the attributes that are read or assigned anywhere in the station, and all constants in its code."""

    def __init__(self, trees: Iterable[ast.Module]) -> None:
        everything = [node for tree in trees for node in ast.walk(tree)]
        nodes = [node for node in everything if isinstance(node, ast.Attribute)]
        self.read = {node.attr for node in nodes if isinstance(node.ctx, ast.Load)}
        stored = [node for node in nodes if not isinstance(node.ctx, ast.Load)]
        self.assigned = {node.attr for node in stored}
        making = {
            id(node)
            for function in everything
            if isinstance(function, FunctionNode) and function.name in MAKING
            for node in ast.walk(function)
        }
        self.changing = {node.attr for node in stored if id(node) not in making}
        """Attributes that are assigned outside the functions that make an object."""
        self.in_texts = {node.value for node in everything if isinstance(node, ast.Constant)}


class _Check:
    """The check of one module."""

    def __init__(
        self, code: ModuleCode, source: str, attributes: _Attributes, values: CodeObjects, units: CodeUnits
    ) -> None:
        self._code, self._source, self._attributes, self._values = code, source, attributes, values
        self._units = units
        self._found: dict[tuple[int, str], None] = {}

    def all(self) -> list[tuple[int, str]]:
        """Return the line and the text of each error."""
        self._look(NameScope(self._code.tree, None, self._code), None)
        return sorted(self._found)

    def _tell_all(self, found: Remarks) -> None:
        for node, text in found:
            self._tell(node, text)

    def _tell(self, node: Any, text: str) -> None:
        self._found[node.lineno, text.replace("{}", self._shown(node))] = None

    def _shown(self, node: ast.AST) -> str:
        return " ".join((ast.get_source_segment(self._source, node) or ast.unparse(node)).split())

    # What is looked at ---------------------------------------------------------------------------------

    def _look(self, scope: NameScope, in_class: ast.ClassDef | None) -> None:
        """Check a module, a function or the body of a class, and the functions in it."""
        for statements in code_periods.blocks_in(scope.node) if in_class is None else ():
            self._tell_all(code_periods.overwritten(self._code, self._values, statements, scope))
        for node in within(scope.node if in_class is None else in_class):
            for kind, look in _LOOKS:
                if isinstance(node, kind):
                    look(self, node, scope)
            for kind, of_control in (*code_control.LOOKS, *code_periods.LOOKS):
                if isinstance(node, kind):
                    self._tell_all(of_control(self._code, node, scope))
            if isinstance(node, FunctionNode | ast.Lambda):
                self._look(NameScope(node, scope, self._code, self._owner(node, in_class)), None)
            elif isinstance(node, ast.ClassDef):
                self._tell_all(code_control.in_class(self._code, node, self._attributes.read))
                self._look(scope, node)

    def _owner(self, node: Any, in_class: ast.ClassDef | None) -> type | None:
        """Return the class of the first argument of a method."""
        decorators = {getattr(each, "id", "") for each in getattr(node, "decorator_list", ())}
        if in_class is None or isinstance(node, ast.Lambda) or decorators & {"staticmethod", "classmethod"}:
            return None
        return self._code.class_at(in_class)

    # Sequences -----------------------------------------------------------------------------------------

    def _statement(self, node: ast.Expr, scope: NameScope) -> None:
        for each in _dropped(node.value):
            made = self._code.thing(each, scope)
            if isinstance(made, MadeSequence):
                self._tell(each, _forgotten(scope))
            elif self._is_function(each, scope):
                self._tell(each, "`{}` is not called, so it does not run: write `{}()`")
            elif isinstance(each, ast.Call) and isinstance(made, Instance) and made.kind in UNUSED_RESULTS:
                self._tell(each, f"`{{}}` alone does nothing: write `{UNUSED_RESULTS[made.kind]}`")

    def _assigned(self, node: ast.Assign, scope: NameScope) -> None:
        """Check a sequence that is assigned to a name which is never read."""
        if not isinstance(self._code.thing(node.value, scope), MadeSequence):
            return
        for target in node.targets:
            if isinstance(target, ast.Name) and target.id in scope.bindings:
                reads = (each.id for each in ast.walk(scope.node) if isinstance(each, ast.Name) and _is_read(each))
                if target.id in reads:
                    return
            elif not (isinstance(target, ast.Attribute) and target.attr not in self._attributes.read):
                return
        self._tell(node.value, _forgotten(scope))

    def _replaced(self, node: ast.Assign, scope: NameScope) -> None:
        """Check a value that is assigned to a name of a function."""
        targets = [each for each in node.targets if isinstance(each, ast.Attribute)]
        is_none = isinstance(node.value, ast.Constant) and node.value.value is None  # None switches a hook off
        for target in targets if isinstance(node.value, VALUES) and not is_none else ():
            of = self._code.thing(target.value, scope)
            if isinstance(of, Instance) and isinstance(
                inspect.getattr_static(of.kind, target.attr, None), FunctionType
            ):
                self._tell(target, "`{}` is a function: write `{}(...)`")

    def _returned(self, node: ast.Return, scope: NameScope) -> None:
        """Check the return value of a law, which is not used."""
        is_law = isinstance(scope.node, ast.FunctionDef) and scope.is_control
        if is_law and node.value is not None and isinstance(self._code.thing(node.value, scope), MadeSequence):
            self._tell(node.value, _forgotten(scope))

    def _awaited(self, node: ast.Await, scope: NameScope) -> None:
        if isinstance(node.value, ast.Tuple | ast.List | ast.ListComp):
            self._tell(node.value, "`{}`: several sequences are awaited by `await together(...)`")
        if self._is_sequence_function(node.value, scope):
            self._tell(node.value, "`{}` is not called: write `await {}()`")

    def _block(self, node: ast.With, scope: NameScope) -> None:
        for each in node.items:
            made = self._code.thing(each.context_expr, scope)
            if isinstance(made, Instance) and UNUSED_RESULTS.get(made.kind, "").startswith("async with"):
                self._tell(each.context_expr, "`with {}:` is refused: write `async with {}:`")

    def _test(self, node: Any, scope: NameScope) -> None:
        self._truth(node.test, scope)

    def _turns(self, node: ast.While, scope: NameScope) -> None:
        """Check a loop of a sequence that reads an object and lets no period pass: the value does not change."""
        if not isinstance(scope.node, ast.AsyncFunctionDef):
            return
        inside = (each for statement in node.body for each in ast.walk(statement))
        calls = (each for each in ast.walk(node.test) if isinstance(each, ast.Call))
        if not any(map(waits_or_ends, inside)) and any(self._is_reading(each, scope) for each in calls):
            self._tell(node.test, "`{}` does not change while no period passes: write `await until(lambda: ...)`")

    def _is_reading(self, node: ast.Call, scope: NameScope) -> bool:
        of = self._code.atomic(node.func.value, scope) if isinstance(node.func, ast.Attribute) else None
        return of is not None and called_name(node) == "read"

    def _stays(self, node: ast.While, scope: NameScope) -> None:
        """Check a loop of a sequence that does nothing and tests a condition without calls."""
        is_idle = all(isinstance(each, ast.Pass | ast.Continue) for each in node.body)
        asks = not any(isinstance(each, ast.Call | ast.Await | ast.NamedExpr) for each in ast.walk(node.test))
        if (
            is_idle
            and asks
            and not isinstance(node.test, ast.Constant)
            and isinstance(scope.node, ast.AsyncFunctionDef)
        ):
            self._tell(node.test, "`{}` does not change while no period passes: write `await until(lambda: ...)`")

    def _used(self, node: Any, scope: NameScope) -> None:
        """Check the operands of a calculation or a text."""
        for each in [node.value] if isinstance(node, ast.FormattedValue) else [node.left, node.right]:
            self._value_of_function(each, scope)

    def _value_of_function(self, node: ast.expr, scope: NameScope) -> None:
        if self._is_function(node, scope):
            self._tell(node, "`{}` is not called, so it has no value: write `{}()`")

    def _result(self, node: ast.Attribute, scope: NameScope) -> None:
        """The result of a sequence that has only been started."""
        is_of_call = node.attr == "result" and isinstance(node.value, ast.Call)
        if is_of_call and self._code.value(node.value.func, scope) is link.Cycle.start:  # type: ignore[attr-defined]
            self._tell(node, "`{}` is None, because the sequence has only been started: write `await` before the call")

    def _filters(self, node: ast.comprehension, scope: NameScope) -> None:
        for each in node.ifs:
            self._truth(each, scope)

    def _truth(self, node: ast.expr, scope: NameScope) -> None:
        """Check an expression whose truth value is used."""
        if isinstance(node, ast.BoolOp):
            for each in node.values:
                self._truth(each, scope)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self._truth(node.operand, scope)
        elif isinstance(self._code.thing(node, scope), MadeSequence):
            self._tell(node, f"`{{}}` is a sequence, which is always true: {_awaiting(scope)}")
        elif self._is_function(node, scope):
            self._tell(node, "`{}` is not called, and a function is always true: write `{}()`")
        elif self._values.is_state(node, scope):
            self._tell(node, "`{}` is not compared with anything: write each comparison in full, `... is {}`")
        elif text := self._values.no_truth(node, scope):
            self._tell(node, text)

    def _compared(self, node: ast.Compare, scope: NameScope) -> None:
        operands = [node.left, *node.comparators]
        if any(isinstance(each, ast.Constant) and each.value is None for each in operands):
            return
        is_of_data = any(isinstance(each, ORDERS) for each in node.ops) or any(
            isinstance(each, VALUES) or self._is_data(each, scope) for each in operands
        )
        for each in operands:
            if isinstance(self._code.thing(each, scope), MadeSequence):
                self._tell(each, f"`{{}}` is a sequence, not its result: {_awaiting(scope)}")
            elif is_of_data and self._is_function(each, scope):
                self._tell(each, "`{}` is not called, and a function is compared: write `{}()`")

    def _is_data(self, node: ast.expr, scope: NameScope) -> bool:
        """True if an expression is certainly not a function, for example if it is a state."""
        found = self._code.thing(node, scope)
        return isinstance(found, ExactObject) and not callable(found.value)

    # States, objects and attributes --------------------------------------------------------------------

    def _states(self, node: ast.Compare | ast.Match, scope: NameScope) -> None:
        for each, text in self._values.mistaken(node, scope):
            self._tell(each, text)

    def _written(self, node: ast.Call, scope: NameScope) -> None:
        if text := self._values.wrongly_written(node, scope):
            self._tell(node, text)

    def _units_taken(self, node: ast.Call, scope: NameScope) -> None:
        self._tell_all(self._units.called(node, scope))

    def _units_compared(self, node: ast.Compare, scope: NameScope) -> None:
        self._tell_all(self._units.compared(node, scope))

    def _attribute(self, node: ast.Attribute, scope: NameScope) -> None:
        """Check an attribute, unless a string in the code is its name: the code may then test for it with `hasattr`."""
        if node.attr not in self._attributes.in_texts and (text := self._values.misspelt(node, scope)):
            self._tell(node, text)

    def _is_function(self, node: ast.expr, scope: NameScope) -> bool:
        """True if an expression is a method that is not called. An attribute that is assigned somewhere may not be
        one."""
        if not isinstance(node, ast.Attribute) or node.attr in self._attributes.assigned:
            return False
        found = self._code.thing(node, scope)
        of = self._code.thing(node.value, scope)
        return isinstance(of, Instance) and isinstance(found, ExactObject) and isinstance(found.value, FunctionType)

    # Conditions ----------------------------------------------------------------------------------------

    def _called(self, node: ast.Call, scope: NameScope) -> None:
        value = self._code.value(node.func, scope)
        given = [each for each in node.args if not isinstance(each, ast.Starred)]
        if any(value is each for each in BLOCKING) and scope.is_control:
            self._tell(node, "`{}` stops the whole machine: write `await wait(...)` in a sequence")
        if any(value is each for each in SHOWING):
            for each in given:
                self._value_of_function(each, scope)
        if any(value is each for each in SEQUENCES):
            for each in given:
                if self._is_sequence_function(each, scope):
                    self._tell(each, "`{}` is not called: write `{}()`")
                elif isinstance(each, ast.List | ast.Tuple | ast.ListComp | ast.GeneratorExp):
                    self._tell(each, "`{}` is not a sequence: give several with a star, `*{}`")
        if given and node.args[0] is given[0] and any(value is each for each in ASKING):
            name = CONDITIONS.get(value)
            self._condition(given[0], scope, name if name in ("until", "unless") else "")

    def _is_sequence_function(self, node: ast.expr, scope: NameScope) -> bool:
        found = self._code.thing(node, scope)
        if isinstance(found, InnerFunction):
            return isinstance(found.node, ast.AsyncFunctionDef)
        return isinstance(found, ExactObject) and inspect.iscoroutinefunction(found.value)

    def _condition(self, node: ast.expr, scope: NameScope, function: str) -> None:
        """Check a condition. `function`: the function that evaluates the condition, or "" for a declared condition,
        whose declaration refuses everything but functions."""
        found = self._code.thing(node, scope)
        if isinstance(node, ast.Lambda):
            inner = NameScope(node, scope, self._code)
            if isinstance(self._code.thing(node.body, inner), MadeSequence):
                self._tell(node.body, "`{}` is a sequence, which is always true: the condition would hold immediately")
            else:
                self._truth(node.body, inner)
        elif self._is_sequence_function(node, scope):
            self._tell(node, "`{}` is a sequence, which is always true: the condition would hold immediately")
        elif function and isinstance(found, MadeSequence):
            self._tell(node, "`{}` is a sequence, not a condition: write `await {}`")
        elif (
            function
            and isinstance(node, ast.Attribute)
            and node.attr == "read"
            and self._code.atomic(node.value, scope)
        ):
            self._tell(node, f"`{{}}` returns a value, not a condition: write `{function}(lambda: {{}}() ...)`")
        elif function and (kind := self._code.atomic(node, scope)):
            compared = " is ..." if kind._has_states else " > ..."
            self._tell(node, f"`{{}}` is an object, not a function: write `{function}(lambda: {{}}.read(){compared})`")
        elif function and _is_value(node):
            self._tell(node, f"`{{}}` is evaluated only once, beforehand: write `{function}(lambda: {{}})`")


_LOOKS: tuple[tuple[Any, Callable[[_Check, Any, NameScope], None]], ...] = (
    (ast.Expr, _Check._statement),
    (ast.Await, _Check._awaited),
    (ast.With, _Check._block),
    (ast.Assign, _Check._assigned),
    (ast.Assign, _Check._replaced),
    (ast.Return, _Check._returned),
    (ast.If | ast.While | ast.IfExp | ast.Assert, _Check._test),
    (ast.While, _Check._turns),
    (ast.While, _Check._stays),
    (ast.FormattedValue | ast.BinOp, _Check._used),
    (ast.Attribute, _Check._result),
    (ast.comprehension, _Check._filters),
    (ast.Compare, _Check._compared),
    (ast.Call, _Check._called),
    (ast.Call, _Check._written),
    (ast.Compare | ast.Match, _Check._states),
    (ast.Call, _Check._units_taken),
    (ast.Compare, _Check._units_compared),
    (ast.Attribute, _Check._attribute),
)


def _forgotten(scope: NameScope) -> str:
    """Return the message for a sequence that a function calls and that nobody awaits."""
    function = scope.node
    return forgotten("{}", getattr(function, "name", ""), in_sequence=isinstance(function, ast.AsyncFunctionDef))


def _awaiting(scope: NameScope) -> str:
    """Return what to write for the result of a sequence."""
    return "write `await {}`" if isinstance(scope.node, ast.AsyncFunctionDef) else "await it in a sequence"


def _dropped(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the values that a statement computes and does not use, as in `m.fill() if m.hot else None`."""
    if isinstance(node, ast.IfExp):
        parts = [node.body, node.orelse]
    elif isinstance(node, ast.BoolOp):
        parts = node.values[-1:]
    elif isinstance(node, ast.Tuple | ast.List | ast.Set):
        parts = node.elts
    elif isinstance(node, ast.ListComp | ast.SetComp):
        parts = [node.elt]
    else:
        yield node
        return
    for each in parts:
        yield from _dropped(each)


def _is_value(node: ast.expr) -> bool:
    """True if an expression is a value, or may be one, in place of a function. For `pressed or default` this is not
    certain."""
    if isinstance(node, ast.BoolOp):
        return any(isinstance(each, VALUES) for each in node.values) or all(map(_is_value, node.values))
    return isinstance(node, VALUES)


def _is_read(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Load)
