"""Functions within a function, which only it calls: what they have of it is given to them at each call, as Python looks
it up then."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from types import CellType, CodeType, FunctionType
from typing import Any

from umo.generate.function_source import SourcedFunction
from umo.generate.lower.function_builder import FunctionBuilder
from umo.generate.lower.terms import NO_VALUE, Known, Term


@dataclass(frozen=True, eq=False)
class LocalFunction:
    """A function that was made in the function of this key."""

    source: SourcedFunction
    home: Any


def local_function(f: FunctionBuilder, node: ast.FunctionDef) -> Known:
    """What the name of a function within a function stands for."""
    inner = [each for each in ast.walk(node) if each is not node]
    if node.decorator_list or any(isinstance(each, ast.Yield | ast.YieldFrom) for each in inner):
        raise f.refused(node, "a function in a function that is decorated, or a generator", "a method")
    arguments = node.args
    defaults = [f.term(each) for each in arguments.defaults]
    if any(arguments.kw_defaults) or not all(isinstance(each, Known) for each in defaults):
        raise f.refused(node, "a default of a function in a function that is computed", "an argument")
    outer = f.source.function
    codes = [each for each in outer.__code__.co_consts if isinstance(each, CodeType)]
    code = next(each for each in codes if (each.co_name, each.co_firstlineno) == (node.name, node.lineno))
    given = tuple(each.value for each in defaults)  # type: ignore[union-attr]
    cells = tuple(CellType() for _ in code.co_freevars)
    function = FunctionType(code, outer.__globals__, node.name, given, cells)
    return Known(LocalFunction(f.source._replace(function=function, tree=node), f.key), name=node.name)


def terms_around(f: FunctionBuilder, local: LocalFunction, node: ast.AST) -> dict[str, Term]:
    """What a function within this one has of it now."""
    if local.home != f.key:
        raise f.refused(node, "a function that was made in another one is called", "a method")
    found = {}
    for name in local.source.function.__code__.co_freevars:
        if name not in f.flow.names:
            raise f.refused(node, f"{name!r}: {NO_VALUE[0]}", NO_VALUE[1])
        found[name] = f.term(ast.copy_location(ast.Name(name, ast.Load()), node))
    return found
