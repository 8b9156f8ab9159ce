"""Functions that are defined in a function and called only there. The values that they use from the outer function are
passed at each call, because Python looks them up at that time."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from operator import is_
from types import CellType, CodeType, FunctionType
from typing import Any

from umo.generate.function_source import SourcedFunction
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import NO_VALUE, Known, Term


@dataclass(frozen=True, eq=False)
class LocalFunction:
    """A function that was defined in the function with this key."""

    source: SourcedFunction
    home: Any

    def is_made_by(self, node: ast.FunctionDef, defaults: Sequence[Any]) -> bool:
        """True if this statement defines the same function again, as in the next turn of a loop."""
        own = self.source.function.__defaults__ or ()
        return self.source.tree is node and len(own) == len(defaults) and all(map(is_, own, defaults))


def local_function(f: FunctionBuilder, node: ast.FunctionDef) -> Known:
    """Return the term for the name of a nested function."""
    inner = [each for each in ast.walk(node) if each is not node]
    if node.decorator_list or any(isinstance(each, ast.Yield | ast.YieldFrom) for each in inner):
        raise f.refused(node, "the nested function is decorated or a generator", "a method")
    arguments = node.args
    defaults = [f.term(each) for each in arguments.defaults]
    if any(arguments.kw_defaults) or not all(isinstance(each, Known) for each in defaults):
        raise f.refused(node, "the default of a nested function is computed", "an argument")
    given = tuple(each.value for each in defaults)  # type: ignore[union-attr]
    before = f.flow.names.get(node.name)
    if isinstance(before, Known) and isinstance(before.value, LocalFunction) and before.value.is_made_by(node, given):
        return before
    outer = f.source.function
    codes = [each for each in outer.__code__.co_consts if isinstance(each, CodeType)]
    code = next(each for each in codes if (each.co_name, each.co_firstlineno) == (node.name, node.lineno))
    cells = tuple(CellType() for _ in code.co_freevars)
    function = FunctionType(code, outer.__globals__, node.name, given, cells)
    return Known(LocalFunction(f.source._replace(function=function, tree=node), f.key), name=node.name)


def terms_around(f: FunctionBuilder, local: LocalFunction, node: ast.AST) -> dict[str, Term]:
    """Return the current values of this function that a nested function uses."""
    if local.home != f.key:
        raise f.refused(node, "a function that was defined inside another one is called", "a method")
    found = {}
    for name in local.source.function.__code__.co_freevars:
        if name not in f.flow.names:
            raise f.refused(node, f"{name!r}: {NO_VALUE[0]}", NO_VALUE[1])
        found[name] = f.term(ast.copy_location(ast.Name(name, ast.Load()), node))
    return found
