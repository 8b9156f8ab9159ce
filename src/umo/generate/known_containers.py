"""Finds code of an application that may change a list, dict or set that translation takes as known.

Any code that has a reference to a container may change it, so each use of the container's name is checked. The use may
read elements, or fill the container before a machine is translated, but may not give the container another name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from types import ModuleType
from typing import Any, NamedTuple

from umo.generate.known_values import Content, is_installed, vars_of

ANY = ""
"""Stands for the name of a container if that name is not known before run time."""
FRESH = (ast.List, ast.ListComp, ast.Dict, ast.DictComp, ast.Set, ast.SetComp, ast.BinOp, ast.Tuple, ast.Constant)
"""Expressions that give a new container without another reference, or an immutable one."""
MAKERS = "list", "dict", "set", "sorted", "tuple"
READERS = ("print", "len", "dict", "list", "tuple", "set", "frozenset", "sorted", "repr", "str", "isinstance", "any",
           "all", "sum", "min", "max", "enumerate", "zip", "reversed")  # fmt: skip
"""Functions that do not change a container argument, and keep only its elements."""
READING = "items", "keys", "values", "get", "copy", "index", "count"
"""Methods of a container that do not change it."""
TESTED = ast.If, ast.While, ast.IfExp, ast.Assert
LOOPS = ast.For, ast.AsyncFor, ast.comprehension
READ_IN = ast.Compare, ast.UnaryOp, ast.BinOp, ast.Starred, ast.FormattedValue, ast.Expr
PLACES_OF_NAMES = {"getattr": 1, "setattr": -2, "__setattr__": -2}
"""The index of the name among the arguments of each of these functions."""
BY_NAME = *PLACES_OF_NAMES, "attrgetter", "__getattribute__", "vars", "globals", "locals", "__dict__"
"""Functions that read or set attributes whose names are given as strings."""


class ChangedPlace(NamedTuple):
    """A place at which a container may be changed, or may get another name."""

    name: str
    """The name of an attribute after a dot, or ANY."""
    before: str = ""
    """The function that runs before a machine is translated and only fills containers of `self`; "" for another
    place."""


def is_changed(content: Content, changed: frozenset[str]) -> bool:
    """True if a known container may be changed through one of these names."""
    name, owner = content.name, content.name.owner
    if content.container is not name.value or type(content.container) not in (list, dict, set):
        return True
    is_module = isinstance(owner, dict | ModuleType)
    kind = owner if isinstance(owner, type) else type(owner)
    home = vars_of(owner).get("__name__") if is_module else kind.__module__
    if is_installed(str(home)) or ANY in changed:
        return True
    return f".{name.name}" in changed or (is_module and name.name in changed)


def changed_in(tree: ast.AST, befores: tuple[str, ...]) -> Iterator[ChangedPlace]:
    """Return the places in one file that may change containers."""
    yield from _Places(tree, befores).of(tree, "", "", False)


class _Places:
    """The places of one file."""

    def __init__(self, tree: ast.AST, befores: tuple[str, ...]) -> None:
        self._befores = befores
        self._around = {id(each): node for node in ast.walk(tree) for each in ast.iter_child_nodes(node)}
        self._fresh = {id(each) for node in ast.walk(tree) for each in _fresh_targets(node)}
        self._imported = {each.asname or each.name for each in ast.walk(tree) if isinstance(each, ast.alias)}
        self._own = self._imported | {*_defined(tree)}

    def of(self, node: ast.AST, before: str, me: str, in_function: bool) -> Iterator[ChangedPlace]:
        """Yield the places in a node. `before`: the function that contains the node and runs before translation; `me`:
        that function's name for `self`."""
        for each in ast.iter_child_nodes(node):
            if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                first = each.args.posonlyargs + each.args.args
                named = isinstance(node, ast.ClassDef) and getattr(each, "name", "") in self._befores and first
                yield from self.of(each, each.name if named else "", first[0].arg if named else "", True)  # type: ignore[union-attr]
                continue
            yield from self._of_one(each, before, me, in_function)
            yield from self.of(each, before, me, in_function)

    def _of_one(self, node: ast.AST, before: str, me: str, in_function: bool) -> Iterator[ChangedPlace]:
        if _last(node) in BY_NAME:
            yield from self._by_name(node)
        if isinstance(node, ast.Attribute):
            fills = isinstance(node.value, ast.Name) and node.value.id == me != "" and self._is_filled(node)
            if not self._only_reads(node):
                yield ChangedPlace(f".{node.attr}", before if fills else "")
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            imported = node.id in self._imported or "*" in self._imported  # `from x import *`: any name may be of x
            fills = not in_function and not imported and self._is_filled(node)
            if not self._only_reads(node) and not fills:
                yield ChangedPlace(node.id)
        elif isinstance(node, ast.Name) and not in_function and not self._only_reads(node):
            yield from (ChangedPlace(node.id), ChangedPlace(f".{node.id}"))
        elif isinstance(node, ast.keyword) and node.arg and not _is_fresh(node.value):
            yield ChangedPlace(f".{node.arg}")
        elif isinstance(node, ast.alias) and node.asname is not None:
            yield ChangedPlace(node.name)

    def _only_reads(self, node: ast.Name | ast.Attribute) -> bool:
        """True if a container at this place is only read or created."""
        around = self._around[id(node)]
        if not isinstance(node.ctx, ast.Load):
            return id(node) in self._fresh
        if isinstance(around, ast.Subscript):
            return around.value is node and isinstance(around.ctx, ast.Load)
        if isinstance(around, ast.Call):
            called = around.func.id if isinstance(around.func, ast.Name) else ""
            return node in around.args and called in READERS and called not in self._own
        if isinstance(around, ast.Attribute):
            return self._is_called(around) and around.attr in READING
        if isinstance(around, LOOPS):
            return around.iter is node
        return (isinstance(around, TESTED) and around.test is node) or isinstance(around, READ_IN)

    def _is_filled(self, node: ast.AST) -> bool:
        """True if this sets an element, adds to the container, or calls a method of it."""
        around = self._around[id(node)]
        return isinstance(around, ast.Subscript | ast.AugAssign) or (
            isinstance(around, ast.Attribute) and self._is_called(around)
        )

    def _is_called(self, node: ast.AST) -> bool:
        around = self._around[id(node)]
        return isinstance(around, ast.Call) and around.func is node

    def _by_name(self, node: ast.AST) -> Iterator[ChangedPlace]:
        """Yield the attributes that are accessed by name: `getattr(m, "name")`, `vars(m)["name"]`."""
        around: Any = self._around[id(node)]
        if _last(node) in PLACES_OF_NAMES and self._is_called(node):
            key = around.args[PLACES_OF_NAMES[_last(node)]] if len(around.args) > 1 else None
        else:
            dict_of = around if self._is_called(node) else node
            of = self._around[id(dict_of)]
            key = of.slice if isinstance(of, ast.Subscript) and of.value is dict_of else None
        yield ChangedPlace(f".{key.value!s}" if isinstance(key, ast.Constant) else ANY)


def _defined(tree: ast.AST) -> Iterator[str]:
    """Yield the names that a file redefines."""
    for each in ast.walk(tree):
        if isinstance(each, ast.FunctionDef | ast.ClassDef):
            yield each.name
        elif isinstance(each, ast.arg):
            yield each.arg
        elif isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
            yield each.id


def _fresh_targets(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the targets of assignments of a new container, which has no other reference."""
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Attribute) and _is_fresh(node.value):
        yield node.target
    if isinstance(node, ast.AnnAssign) and "ClassVar" in ast.dump(node.annotation) and _is_fresh(node.value):
        yield node.target
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        (target,) = node.targets
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=False))
        yield from (one for one, value in pairs if _is_fresh(value))


def _is_fresh(value: ast.AST | None) -> bool:
    if isinstance(value, ast.IfExp):
        return _is_fresh(value.body) and _is_fresh(value.orelse)
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
        return value.func.id in MAKERS
    return isinstance(value, FRESH)


def _last(node: Any) -> str:
    return getattr(node, "id", getattr(node, "attr", ""))
