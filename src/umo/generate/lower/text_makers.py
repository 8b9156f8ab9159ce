"""Texts and errors that Python makes for compiled laws, from the variables that C passes."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from umo.generate.c_types import ArrayType, CType, MixedNumber, NumpyNumber, OptionalType, TupleType
from umo.generate.function_source import SourcedFunction


def evaluated(
    source: SourcedFunction, node: ast.expr, known: Mapping[str, Any], given: Sequence[str]
) -> Callable[..., Any]:
    """Return a function that evaluates an expression of another function. `known` has the values of known names,
    `given` the names of its arguments."""
    tree = ast.parse("lambda: 0", mode="eval")
    assert isinstance(tree.body, ast.Lambda)
    tree.body.args.args = [ast.arg(name) for name in (*known, *given)]
    tree.body.body = node
    function = eval(compile(ast.fix_missing_locations(tree), source.file, "eval"), source.function.__globals__)

    def make(*values: Any) -> Any:
        return function(*known.values(), *values)

    return make


def error_as_written(kind: type[BaseException], text: str) -> BaseException:
    """Return an error with the text as written in the code. If its class takes no text, return a RuntimeError."""
    try:
        return kind(text)
    except TypeError:
        return RuntimeError(f"{kind.__name__}: {text}")


def is_certain(of: CType) -> bool:
    """True if all values of this type have the same known class in Python."""
    if isinstance(of, MixedNumber) or (isinstance(of, NumpyNumber) and not of.sure):
        return False
    if isinstance(of, ArrayType):
        return not of.loose and is_certain(of.of)
    if isinstance(of, TupleType):
        return all(is_certain(each) for _, each in of.members)
    return is_certain(of.of) if isinstance(of, OptionalType) else True
