"""The source of a function: its tree, its file and what its names stand for."""

from __future__ import annotations

import ast
import builtins
import linecache
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType
from typing import Any, NamedTuple

ABSENT = object()
"""No such name."""


class SourcedFunction(NamedTuple):
    """A function with its tree."""

    function: Any
    """A function of Python."""
    tree: ast.FunctionDef | ast.Lambda
    file: str
    """The path from its package on."""
    text: list[str]
    """The lines of the file."""

    @property
    def name(self) -> str:
        return str(self.function.__qualname__).replace(".<locals>", "").replace("<lambda>", "condition")

    def meaning(self, name: str) -> Any:
        """What a name that is no local one stands for; ABSENT: nothing."""
        code = self.function.__code__
        if name in code.co_freevars and self.function.__closure__ is not None:
            try:
                return self.function.__closure__[code.co_freevars.index(name)].cell_contents
            except ValueError:  # not assigned yet
                return ABSENT
        return self.function.__globals__.get(name, getattr(builtins, name, ABSENT))

    def is_local(self, name: str) -> bool:
        """Whether the function itself assigns this name; functions within it may read it, too."""
        return name in self.function.__code__.co_varnames or name in self.function.__code__.co_cellvars

    @property
    def enclosed(self) -> tuple[Any, ...]:
        """What its names of enclosing functions stand for, ABSENT where they have no value: two functions of the same
        source differ in it."""
        return tuple(self.meaning(name) for name in self.function.__code__.co_freevars)

    def segment(self, node: ast.AST) -> str:
        """The source of a node, in one line."""
        first, last = getattr(node, "lineno", None), getattr(node, "end_lineno", None)
        if first is None or last is None:
            return " ".join(ast.unparse(node).split())
        lines = [line.encode() for line in self.text[first - 1 : last]]
        lines[-1] = lines[-1][: node.end_col_offset]  # type: ignore[attr-defined]
        lines[0] = lines[0][node.col_offset :]  # type: ignore[attr-defined]
        return " ".join(b"\n".join(lines).decode().split())


class BoundFunction(NamedTuple):
    """A function and the arguments that it already has."""

    source: SourcedFunction
    given: tuple[Any, ...]
    named: tuple[tuple[str, Any], ...] = ()


class NoSource(Exception):
    """A function has no source in Python that could be translated; the text says why."""


def bound(function: Callable[..., Any]) -> BoundFunction:
    """A function, a method or a partial of one. NoSource if it is not one of Python."""
    if isinstance(function, partial):
        inner = bound(function.func)
        return inner._replace(
            given=(*inner.given, *function.args), named=(*inner.named, *sorted(function.keywords.items()))
        )
    if isinstance(function, MethodType):
        inner = bound(function.__func__)
        return inner._replace(given=(function.__self__, *inner.given))
    if not isinstance(function, FunctionType):
        raise NoSource("it is not written in Python")
    return BoundFunction(sourced(function), ())


def sourced(function: FunctionType) -> SourcedFunction:
    code = function.__code__
    text = linecache.getlines(code.co_filename, function.__globals__)
    if not text:
        raise NoSource("it is not written in Python, or was made at run time")
    lines = [line.rstrip("\n") for line in text]
    found = [each for each in _functions("\n".join(lines)) if _is(each, code)]
    if len(found) != 1:
        raise NoSource("its source is not found, or has changed")
    return SourcedFunction(function, found[0], shown_file(code.co_filename, function.__module__ or ""), lines)


@cache
def _functions(text: str) -> list[ast.FunctionDef | ast.Lambda]:
    return [each for each in ast.walk(parsed(text)) if isinstance(each, ast.FunctionDef | ast.Lambda)]


def parsed(text: str) -> ast.Module:
    """The tree of a module, in which private names (`self.__count`) are what they are at run time."""
    tree = ast.parse(text)
    PrivateNames().visit(tree)
    return tree


class PrivateNames(ast.NodeVisitor):
    """Within a class `__name` is `_Class__name`."""

    def __init__(self) -> None:
        self._kind = ""

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        before, self._kind = self._kind, node.name.lstrip("_")
        self.generic_visit(node)
        self._kind = before

    def visit_Attribute(self, node: ast.Attribute) -> None:
        node.attr = self._private(node.attr)
        self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        node.id = self._private(node.id)

    def visit_arg(self, node: ast.arg) -> None:
        node.arg = self._private(node.arg)

    def visit_keyword(self, node: ast.keyword) -> None:
        node.arg = node.arg and self._private(node.arg)
        self.generic_visit(node)

    def _private(self, name: str) -> str:
        hidden = self._kind and name.startswith("__") and not name.endswith("__")
        return f"_{self._kind}{name}" if hidden else name


def _is(tree: ast.FunctionDef | ast.Lambda, code: CodeType) -> bool:
    if isinstance(tree, ast.FunctionDef):
        first = min([tree.lineno, *(each.lineno for each in tree.decorator_list)])
        return code.co_name == tree.name and code.co_firstlineno == first
    if code.co_name != "<lambda>" or code.co_firstlineno != tree.lineno:
        return False
    body = tree.body
    places = [each for each in code.co_positions() if each[0] is not None and each[2] is not None and each[3]]
    last = (body.end_lineno or body.lineno, body.end_col_offset or 0)
    inside = [(body.lineno, body.col_offset) <= (p[0], p[2]) and (p[1], p[3]) <= last for p in places]
    return bool(inside) and sum(inside) >= len(inside) - 1  # the first one is that of the whole function


def shown_file(file: str, module: str) -> str:
    """A file's path from its package on: it says nothing of the computer."""
    depth = module.count(".") + 1 + (Path(file).name == "__init__.py")
    return "/".join(Path(file).parts[-depth:])
