"""The source of a function: its syntax tree, its file and the meaning of its names."""

from __future__ import annotations

import ast
import builtins
import linecache
import re
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType
from typing import Any, NamedTuple

ABSENT = object()
"""The value of a name that does not exist."""
PRIVATE = re.compile(r"\b__\w+(?<!__)\b")
"""Names that are mangled within a class."""


class SourcedFunction(NamedTuple):
    """A function with its syntax tree."""

    function: Any
    """A function written in Python."""
    tree: ast.FunctionDef | ast.Lambda
    file: str
    """The path relative to the package."""
    text: list[str]
    """The lines of the file."""

    @property
    def name(self) -> str:
        return str(self.function.__qualname__).replace(".<locals>", "").replace("<lambda>", "condition")

    def meaning(self, name: str) -> Any:
        """Return the value of a name that is not local, or ABSENT if the name has none."""
        code = self.function.__code__
        if name in code.co_freevars and self.function.__closure__ is not None:
            try:
                return self.function.__closure__[code.co_freevars.index(name)].cell_contents
            except ValueError:  # not assigned yet
                return ABSENT
        return self.function.__globals__.get(name, getattr(builtins, name, ABSENT))

    def is_local(self, name: str) -> bool:
        """True if the function itself assigns this name. Nested functions may also read such a name."""
        return name in self.function.__code__.co_varnames or name in self.function.__code__.co_cellvars

    @property
    def enclosed(self) -> tuple[Any, ...]:
        """The values of the function's names from enclosing functions; ABSENT if unset. Two functions with the same
        source may differ in these values."""
        return tuple(self.meaning(name) for name in self.function.__code__.co_freevars)

    def segment(self, node: ast.AST) -> str:
        """Return the source of a node on one line."""
        first, last = getattr(node, "lineno", None), getattr(node, "end_lineno", None)
        if first is None or last is None:
            return " ".join(ast.unparse(node).split())
        lines = [line.encode() for line in self.text[first - 1 : last]]
        lines[-1] = lines[-1][: node.end_col_offset]  # type: ignore[attr-defined]
        lines[0] = lines[0][node.col_offset :]  # type: ignore[attr-defined]
        return " ".join(b"\n".join(lines).decode().split())


class BoundFunction(NamedTuple):
    """A function and the arguments that are bound to it."""

    source: SourcedFunction
    given: tuple[Any, ...]
    named: tuple[tuple[str, Any], ...] = ()


class NoSource(Exception):
    """Raised if a function has no Python source that could be translated. The message says why."""


def bound(function: Callable[..., Any]) -> BoundFunction:
    """Return a function, method or partial with its bound arguments. Raises NoSource if it is not written in Python."""
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
        raise NoSource("it is not written in Python, or was created at run time")
    source = _source(tuple(text))
    found = [each for each in source.functions.get(code.co_firstlineno, ()) if _is(each, code)]
    if len(found) != 1:
        raise NoSource("its source is not found, or has changed")
    return SourcedFunction(function, found[0], shown_file(code.co_filename, function.__module__ or ""), source.lines)


class SourceText(NamedTuple):
    """The lines of a file and the functions that begin in each line."""

    lines: list[str]
    functions: Mapping[int, list[ast.FunctionDef | ast.Lambda]]


@cache
def _source(text: tuple[str, ...]) -> SourceText:
    lines = [line.rstrip("\n") for line in text]
    functions = defaultdict(list)
    for each in nodes_of(parsed("\n".join(lines))):
        if isinstance(each, ast.FunctionDef | ast.Lambda):
            functions[_first_line(each)].append(each)
    return SourceText(lines, functions)


def nodes_of(tree: ast.AST) -> list[ast.AST]:
    """Return the nodes of a tree without the contexts of names. The function is faster than `ast.walk`."""
    found = [tree]
    for node in found:
        for name in node._fields:
            part = getattr(node, name, None)
            if isinstance(part, list):
                found += [each for each in part if isinstance(each, ast.AST)]
            elif isinstance(part, ast.AST) and name != "ctx":
                found.append(part)
    return found


def parsed(text: str) -> ast.Module:
    """Return the tree of a module in which private names (`self.__count`) are mangled as at run time."""
    tree = ast.parse(text)
    if PRIVATE.search(text):
        PrivateNames().visit(tree)
    return tree


class PrivateNames(ast.NodeVisitor):
    """Replaces `__name` within a class by `_Class__name`."""

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


def _first_line(tree: ast.FunctionDef | ast.Lambda) -> int:
    """Return the first line of a function, including its decorators."""
    above = () if isinstance(tree, ast.Lambda) else tree.decorator_list
    return min([tree.lineno, *(each.lineno for each in above)])


def _is(tree: ast.FunctionDef | ast.Lambda, code: CodeType) -> bool:
    """True if this tree is the source of a code object that begins in the same line."""
    if isinstance(tree, ast.FunctionDef):
        return code.co_name == tree.name
    if code.co_name != "<lambda>":
        return False
    body = tree.body
    places = [each for each in code.co_positions() if each[0] is not None and each[2] is not None and each[3]]
    last = (body.end_lineno or body.lineno, body.end_col_offset or 0)
    inside = [(body.lineno, body.col_offset) <= (p[0], p[2]) and (p[1], p[3]) <= last for p in places]
    return bool(inside) and sum(inside) >= len(inside) - 1  # the first one is that of the whole function


@cache
def shown_file(file: str, module: str) -> str:
    """Return a file's path relative to its package, so that it does not depend on the computer."""
    depth = module.count(".") + 1 + (Path(file).name == "__init__.py")
    return "/".join(Path(file).parts[-depth:])
