"""Code of an application that sets what translation takes as known: found by name, before a controller is generated.

A controller goes on with what was known when its code was made. So nothing of the application may set it: the modules
of the station, and those of the classes that its machine is made of, are read for assignments to these names.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from umo.generate.function_source import shown_file
from umo.generate.known_values import KnownName, KnownValues, is_installed
from umo.generate.translation import Untranslatable
from umo.objects import Compound
from umo.objects.numbers import numbers_of

BEFORE = "setup", "__init__", "__post_init__", "__new__", "__set_name__", "__init_subclass__"
"""Functions that run before a machine is translated."""
SETTERS = "setattr", "delattr", "__setattr__", "__delattr__"
WHOLE = "vars", "globals", "locals"
"""Functions that give a namespace as a dict."""
READERS = "print", "len", "dict", "list", "tuple", "set", "sorted", "repr", "str", "iter", "isinstance", "any", "all"
"""Functions that do not change the dict that they are given."""
KEEPERS = (ast.Assign, ast.AnnAssign, ast.NamedExpr, ast.Return, ast.Yield, ast.Tuple, ast.List, ast.Set, ast.Dict,
           ast.IfExp, ast.BoolOp, ast.Lambda, ast.withitem, ast.AugAssign)  # fmt: skip
ANY = ""
"""The name of a setting that may be of any name."""


class Setting(NamedTuple):
    """A place in code that sets an attribute or a name of a module."""

    name: str
    """What is set; ANY: it is not known before it is set."""
    kind: str
    """The class in whose method `self` is set; "": another object."""
    file: str
    line: int
    function: int
    """The first line of the function; 0: none."""


def settings_of(known: KnownValues, machine: Compound) -> Iterator[Untranslatable]:
    """What is taken as known, and can be another: it is set somewhere, or is a container that is changed in place."""
    for content in known.contents.values():
        if content.container is not getattr(content.name.owner, "__kwdefaults__", None):
            yield _untranslatable(content.name, f"{content.name.label} is a {_kind(content.container)}", "a tuple")
    for number in numbers_of(machine).values():
        if number.declared.tunable and (found := known.names.get((id(number.owner), number.name))) is not None:
            yield _untranslatable(
                found, f"{number.path} is taken as known, and clients may set it", "a lower-case name"
            )
    names = list(known.names.values())
    places = {(code.co_filename, code.co_firstlineno) for code in known.codes()}
    told = set[tuple[str, int]]()
    for path, module in _files(machine, known):
        for each in _settings(path):
            if (each.file, each.function) in places:
                continue
            for name in names if each.name == ANY else (n for n in names if n.name == each.name):
                if (path, each.line) not in told and _is_meant(each, name):
                    told.add((path, each.line))
                    what = "may be set" if each.name == ANY else "is set"
                    at = f"{shown_file(path, module)}:{each.line}"
                    yield _untranslatable(
                        name, f"{name.label} is taken as known, and {what} in {at}", "a number in its place"
                    )


def root_of(part: Compound) -> Compound:
    """The machine that a part belongs to."""
    found: Any = part
    while found._parent is not None:
        found = found._parent
    return found  # type: ignore[no-any-return]


def _untranslatable(name: KnownName, reason: str, nearest: str) -> Untranslatable:
    return Untranslatable(name.file, name.line, name.name, reason, nearest)


def _kind(container: Any) -> str:
    return f"{type(container).__name__}, which code can change"


def _is_meant(setting: Setting, name: KnownName) -> bool:
    """Whether this may be the name that is known: `self` of a method is an object of its class."""
    if not setting.kind:
        return True
    kinds = (name.owner if isinstance(name.owner, type) else type(name.owner)).__mro__
    return any(each.__name__ == setting.kind for each in kinds)


def _files(machine: Any, known: KnownValues) -> Iterator[tuple[str, str]]:
    """The files that are read, with the names of their modules: of a station all, else those of the classes."""
    owners = [machine, *(each.owner for each in known.objects.values())]
    modules = {kind.__module__ for each in owners for kind in type(each).__mro__ if not isinstance(each, dict)}
    modules |= {str(each.owner.get("__name__", "")) for each in known.objects.values() if isinstance(each.owner, dict)}
    found: dict[str, str] = {}
    for name in sorted(modules):
        module = sys.modules.get(name)
        file = getattr(module, "__file__", None)
        if file is None or not file.endswith(".py") or is_installed(name):
            continue
        folder = Path(file).parent
        if (folder / "objects.py").exists():
            package = name.rpartition(".")[0]
            for each in sorted(folder.rglob("*.py")):
                if "tests" not in each.relative_to(folder).parts:
                    found.setdefault(str(each), ".".join((package, *each.relative_to(folder).with_suffix("").parts)))
        else:
            found.setdefault(file, name)
    yield from found.items()


@cache
def _parsed(path: str, changed: float) -> tuple[Setting, ...]:
    tree = ast.parse(Path(path).read_text("utf-8"))
    return tuple(_Search(path).of(tree))


def _settings(path: str) -> tuple[Setting, ...]:
    """The settings of one file; none of one that is no Python."""
    try:
        return _parsed(path, Path(path).stat().st_mtime)
    except (OSError, SyntaxError, ValueError):
        return ()


class _Search:
    """The settings of one file."""

    def __init__(self, file: str) -> None:
        self._file = file

    def of(self, tree: ast.AST) -> Iterator[Setting]:
        others = _given_others(tree)
        for each in self._in(tree, "", "", 0, frozenset()):
            yield each._replace(kind="") if each.function in others else each

    def _in(self, node: ast.AST, kind: str, me: str, function: int, outer: frozenset[str]) -> Iterator[Setting]:
        """`me`: the name of `self`; `outer`: names of the module, or of an enclosing function."""
        for each in ast.iter_child_nodes(node):
            if _is_whole(each) and _keeps(node):
                about = _is_of(each, me)
                yield Setting(ANY, kind if about else "", self._file, getattr(each, "lineno", 0), function)
            if isinstance(each, ast.ClassDef):
                yield from self._in(each, each.name, "", 0, frozenset())
            elif isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
                yield from self._in_function(each, kind if isinstance(node, ast.ClassDef) else "", function, me)
            else:
                yield from self._of_node(each, kind, me, function, outer)
                yield from self._in(each, kind, me, function, outer)

    def _in_function(
        self, node: ast.FunctionDef | ast.AsyncFunctionDef, kind: str, function: int, me: str
    ) -> Iterator[Setting]:
        first = node.args.posonlyargs + node.args.args
        is_static = any(isinstance(each, ast.Name) and each.id == "staticmethod" for each in node.decorator_list)
        own = first[0].arg if kind and first and not is_static else ""
        declared = (each for each in _own_nodes(node) if isinstance(each, ast.Global | ast.Nonlocal))
        outer = frozenset(name for each in declared for name in each.names)
        line = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        for each in self._in(node, kind, own, line, outer):
            if not (node.name in BEFORE and each.kind and each.function == line):
                yield each

    def _of_node(self, node: ast.AST, kind: str, me: str, function: int, outer: frozenset[str]) -> Iterator[Setting]:
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store | ast.Del):
            yield Setting(node.attr, kind if _is_of(node.value, me) else "", self._file, line, function)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store | ast.Del) and node.id in outer:
            yield Setting(node.id, "", self._file, line, function)
        elif isinstance(node, ast.Call):
            for name, of in _called(node):
                yield Setting(name, kind if _is_of(of, me) else "", self._file, line, function)
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del) and _is_whole(node.value):
            key = node.slice
            name = key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else ANY
            yield Setting(name, kind if _is_of(node.value, me) else "", self._file, line, function)


def _given_others(tree: ast.AST) -> set[int]:
    """First lines of methods whose `self` may be any object: `Class.method(other)` calls them."""
    called = {
        (each.func.value.id, each.func.attr)
        for each in ast.walk(tree)
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Attribute) and isinstance(each.func.value, ast.Name)
        if not (each.args and isinstance(each.args[0], ast.Name) and each.args[0].id == "self")
    }
    methods = [
        (kind.name, each)
        for kind in ast.walk(tree)
        if isinstance(kind, ast.ClassDef)
        for each in kind.body
        if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    return {
        min([each.lineno, *(one.lineno for one in each.decorator_list)])
        for kind, each in methods
        if (kind, each.name) in called
    }


def _own_nodes(function: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a function, without those of functions in it."""
    for each in ast.iter_child_nodes(function):
        yield each
        if not isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            yield from _own_nodes(each)


def _called(node: ast.Call) -> Iterator[tuple[str, ast.AST | None]]:
    """The names that a call sets, and of what; None: it is not seen."""
    func = node.func
    called = func.id if isinstance(func, ast.Name) else func.attr if isinstance(func, ast.Attribute) else ""
    if called in SETTERS:
        yield _named(called, func, node)
    elif called == "exec":
        yield ANY, None
    elif isinstance(func, ast.Attribute) and _is_whole(func.value) and _changes(func.attr):
        yield ANY, func.value


def _named(called: str, func: ast.AST, node: ast.Call) -> tuple[str, ast.AST | None]:
    """The name that a setter sets: the one before the value, or the last; what stands before it is the object."""
    place = len(node.args) - (2 if "set" in called else 1)
    if node.keywords or place < 0 or any(isinstance(each, ast.Starred) for each in node.args):
        return ANY, None
    of = node.args[place - 1] if place else func.value if isinstance(func, ast.Attribute) else None
    name = node.args[place]
    return (name.value if isinstance(name, ast.Constant) and isinstance(name.value, str) else ANY), of


def _is_of(node: ast.AST | None, me: str) -> bool:
    """Whether this is `self`, or its namespace."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "vars" and node.args:
        node = node.args[0]
    elif isinstance(node, ast.Attribute) and node.attr == "__dict__":
        node = node.value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super":
        return me != ""
    return isinstance(node, ast.Name) and node.id == me != ""


def _keeps(node: ast.AST) -> bool:
    """Whether what stands in this node is known under another name after it."""
    if isinstance(node, ast.Call):
        return not (isinstance(node.func, ast.Name) and node.func.id in READERS)
    if isinstance(node, ast.keyword):
        return node.arg is not None
    return isinstance(node, KEEPERS)


def _changes(method: str) -> bool:
    """Whether a method of a dict changes it."""
    return method in ("update", "pop", "popitem", "setdefault", "clear", "__setitem__", "__delitem__", "__ior__")


def _is_whole(node: ast.AST) -> bool:
    """Whether this is a namespace as a dict."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id in WHOLE
    return isinstance(node, ast.Attribute) and node.attr == "__dict__"
