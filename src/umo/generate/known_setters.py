"""Finds code of an application that sets values which translation takes as known. This is done before a controller is
generated.

A controller keeps the values that were known when its code was generated. So no code of the application may set them.
The modules of the station, and those of the classes of its machine, are searched for assignments to these names."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from umo.generate.function_source import parsed, shown_file
from umo.generate.known_containers import ChangedPlace, changed_in, is_changed
from umo.generate.known_values import KnownName, KnownValues, is_installed
from umo.generate.translation import Untranslatable
from umo.objects import Compound, walk
from umo.objects.numbers import numbers_of

BEFORE = "setup", "__init__", "__post_init__", "__new__", "__set_name__", "__init_subclass__"
"""Functions that run before a machine is translated."""
SETTERS = "setattr", "delattr", "__setattr__", "__delattr__"
NAMESPACES = "vars", "globals", "locals"
"""Functions that return a namespace as a dict."""
PARTS = "__dict__", "__class__", "__bases__", "__code__", "__defaults__", "__kwdefaults__", "cell_contents"
"""Attributes that change several names at once, or the behaviour of a function."""
RUNNERS = "exec", "eval"
UNFOLLOWED = *RUNNERS, "__set__", "__delete__", "__func__"
"""Functions that may set any name, or may call a method with another object."""
FOLLOWED_CALLED = (*SETTERS, *NAMESPACES)
"""Functions that are followed where they are called, and only there."""
ONLY_COMPARED = "isinstance", "issubclass", "super", "cast"
"""Functions that only compare a class argument."""
READERS = "print", "len", "dict", "list", "tuple", "set", "sorted", "repr", "str", "iter", "isinstance", "any", "all"
"""Functions that do not change a dict argument."""
READING = "items", "keys", "values", "get", "copy", "__contains__", "__getitem__", "__len__", "__iter__"
"""Methods of a dict that do not change it."""
READ_IN = (ast.Subscript, ast.Compare, ast.For, ast.AsyncFor, ast.comprehension, ast.Expr, ast.FormattedValue, ast.If,
           ast.While, ast.UnaryOp, ast.BinOp, ast.Starred, ast.YieldFrom)  # fmt: skip
"""The nodes in which a dict is only read, or only one name in it is set."""
ANY = ""
"""Stands for the name in a setting that may set any name."""


class Setting(NamedTuple):
    """A place in code that sets an attribute or a name of a module."""

    name: str
    """The name that is set; ANY if it is not known before run time."""
    kind: str
    """The class in whose method `self` is set, or "" for another object."""
    file: str
    line: int
    function: int
    """The first line of the function, or 0 if there is none."""
    method: str = ""
    """The name of the method in which `self` is set."""
    is_before: bool = False
    """True if the method runs before a machine is translated. The setting counts only if the method is called again."""
    setup: str = ""
    """The class in whose `setup` this setting is. `setup` runs before the translation if a part of the machine has this
    class."""
    base: str = ""
    """The last name in the expression for the object that an assignment changes."""


class Read(NamedTuple):
    """The settings and uses found in one file."""

    settings: tuple[Setting, ...]
    classes: frozenset[str] = frozenset()
    imported: frozenset[tuple[str, str]] = frozenset()
    """The names of imports, and their original names."""
    methods: frozenset[tuple[str, str]] = frozenset()
    """The method calls: the last name of the object, and the method that is called on it, except
    `Base.method(self)`."""
    values: frozenset[str] = frozenset()
    """Names that are used as values. If one of them is a class, its further use is not followed."""
    again: frozenset[str] = frozenset()
    """Functions of BEFORE that other code uses."""
    changed: frozenset[ChangedPlace] = frozenset()
    """The places where containers may be changed, by their names."""


def settings_of(known: KnownValues, machine: Compound) -> Iterator[Untranslatable]:
    """Return the known names that may change, because they are set somewhere, or are containers that are changed in
    place."""
    files = [(path, module, _read(path)) for path, module in _files(machine, known)]
    again = {name for *_, each in files for name in each.again}
    changed = frozenset(one.name for *_, each in files for one in each.changed if not one.before or one.before in again)
    for content in known.contents.values():
        is_keywords = content.container is getattr(content.name.owner, "__kwdefaults__", None)
        if not is_keywords and is_changed(content, changed):
            yield _untranslatable(content.name, f"{content.name.label} is a {_kind(content.container)}", "a tuple")
    for number in numbers_of(machine).values():
        if number.declared.tunable and (found := known.names.get((id(number.owner), number.name))) is not None:
            yield _untranslatable(
                found, f"{number.path} is taken as known, but clients may set it", "a lower-case name"
            )
    names = list(known.names.values())
    places = {(code.co_filename, code.co_firstlineno) for code in known.codes()}
    told = set[tuple[str, int]]()
    given = _ClassUses([each for *_, each in files])
    kinds = {kind for each in (machine, *walk(machine)) for kind in type(each).__mro__}
    setups = {(getattr(sys.modules.get(kind.__module__), "__file__", None), kind.__name__) for kind in kinds}
    for path, module, read in files:
        for each in read.settings:
            each = each._replace(kind="") if given.any_object(each) else each
            if (each.file, each.function) in places or (each.is_before and each.method not in again):
                continue
            if (each.file, each.setup) in setups and "setup" not in again:
                continue
            for name in names if each.name == ANY else (n for n in names if n.name == each.name):
                if (path, each.line) not in told and _is_meant(each, name) and not given.is_harmless(each, name):
                    told.add((path, each.line))
                    what = "may be set" if each.name == ANY else "is set"
                    at = f"{shown_file(path, module)}:{each.line}"
                    yield _untranslatable(
                        name, f"{name.label} is taken as known, and {what} in {at}", "a number in its place"
                    )


def root_of(part: Compound) -> Compound:
    """Return the machine that a part belongs to."""
    found: Any = part
    while found._parent is not None:
        found = found._parent
    return found  # type: ignore[no-any-return]


def _untranslatable(name: KnownName, reason: str, nearest: str) -> Untranslatable:
    return Untranslatable(name.file, name.line, name.name, reason, nearest)


def _kind(container: Any) -> str:
    return f"{type(container).__name__}, which code can change"


def _is_meant(setting: Setting, name: KnownName) -> bool:
    """True if the setting may concern the known name: `self` of a method is an object of its class."""
    if not setting.kind:
        return True
    kinds = (name.owner if isinstance(name.owner, type) else type(name.owner)).__mro__
    return any(each.__name__ == setting.kind for each in kinds)


def _files(machine: Any, known: KnownValues) -> Iterator[tuple[str, str]]:
    """Yield the files to search, with the names of their modules: all files of a station, or else the files of the
    classes."""
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
def _parsed(path: str, changed: float) -> Read:
    tree = parsed(Path(path).read_text("utf-8"))
    classes = frozenset(each.name for each in ast.walk(tree) if isinstance(each, ast.ClassDef))
    renamed = (each for each in ast.walk(tree) if isinstance(each, ast.alias) and each.asname is not None)
    imported = frozenset((str(each.asname), each.name) for each in renamed)
    methods, values, again = frozenset(_methods(tree)), frozenset(_values(tree, tree)), frozenset(_again(tree))
    containers = frozenset(changed_in(tree, BEFORE))
    return Read(tuple(_Search(path).of(tree)), classes, imported, methods, values, again, containers)


def _read(path: str) -> Read:
    """Return the results from one file; none for a file that is not Python."""
    try:
        return _parsed(path, Path(path).stat().st_mtime)
    except (OSError, SyntaxError, ValueError):
        return Read(())


class _Search:
    """The search for settings in one file."""

    def __init__(self, file: str) -> None:
        self._file = file

    def of(self, tree: ast.AST) -> Iterator[Setting]:
        yield from self._in(tree, "", "", 0, frozenset())

    def _in(self, node: ast.AST, kind: str, me: str, function: int, outer: frozenset[str]) -> Iterator[Setting]:
        """Yield the settings in a node. `me`: the name of `self`; `outer`: names of the module or of an enclosing
        function."""
        for each in ast.iter_child_nodes(node):
            if (_is_whole(each) and not _only_reads(node)) or _is_unfollowed(each, node):
                about = _is_of(each, me)
                yield Setting(ANY, kind if about else "", self._file, getattr(each, "lineno", 0), function)
            if isinstance(each, ast.ClassDef):
                yield from self._in(each, each.name, "", 0, frozenset())
            elif isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef):
                yield from self._in_function(each, kind if isinstance(node, ast.ClassDef) else "", function, me)
            elif isinstance(each, ast.Lambda):  # it runs later than what it stands in
                yield from self._in(each, kind, "" if _is_parameter(each, me) else me, each.lineno, outer)
            else:
                yield from self._of_node(each, kind, me, function, outer)
                yield from self._in(each, kind, me, function, outer)

    def _in_function(
        self, node: ast.FunctionDef | ast.AsyncFunctionDef, kind: str, function: int, me: str
    ) -> Iterator[Setting]:
        first = node.args.posonlyargs + node.args.args
        is_static = any(isinstance(each, ast.Name) and each.id == "staticmethod" for each in node.decorator_list)
        own = first[0].arg if kind and first and not is_static else ""
        if any(isinstance(each, ast.Name) and each.id == own and _is_set(each) for each in _own_nodes(node)):
            own = ""  # another object has this name now
        declared = (each for each in _own_nodes(node) if isinstance(each, ast.Global | ast.Nonlocal))
        outer = frozenset(name for each in declared for name in each.names)
        line = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        for each in self._in(node, kind, own, line, outer):
            if each.function != line:
                yield each
            else:
                method = node.name if each.kind else ""
                setup = kind if node.name == "setup" else ""
                yield each._replace(method=method, is_before=method in BEFORE, setup=setup)

    def _of_node(self, node: ast.AST, kind: str, me: str, function: int, outer: frozenset[str]) -> Iterator[Setting]:
        line = getattr(node, "lineno", 0)
        if isinstance(node, ast.Attribute) and _is_set(node):
            name = ANY if node.attr in PARTS else node.attr
            own, base = kind if _is_of(node.value, me) else "", _last(node.value) if name else ""
            yield Setting(name, own, self._file, line, function, base=base)
        elif isinstance(node, ast.Name) and _is_set(node) and node.id in outer:
            yield Setting(node.id, "", self._file, line, function)
        elif isinstance(node, ast.Call):
            for name, of in _called(node):
                yield Setting(name, kind if _is_of(of, me) else "", self._file, line, function)
        elif isinstance(node, ast.Subscript) and _is_set(node) and _is_whole(node.value):
            key = node.slice
            name = key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else ANY
            yield Setting(name, kind if _is_of(node.value, me) else "", self._file, line, function)


class _ClassUses:
    """The uses of the classes of some files: what they are passed to, and what is done with them."""

    def __init__(self, files: list[Read]) -> None:
        classes = {"type", "__class__", "cls", *(name for each in files for name in each.classes)}
        values = {name for each in files for name in each.values}
        imported = {pair for each in files for pair in each.imported}
        self._classes = classes | {name for name, of in imported if of in classes}
        self._values = values | {of for name, of in imported if name in values}
        self._methods = {method for each in files for of, method in each.methods if of in self._classes}

    def any_object(self, setting: Setting) -> bool:
        """True if `self` may be any object, because the method is called through the class (`Class.method(other)`) or
        is used as a value."""
        return setting.method in self._methods or setting.kind in self._values

    def is_harmless(self, setting: Setting, name: KnownName) -> bool:
        """Return True if an assignment does not change the name: the name is that of a part, which a machine does not
        give up, or that of a property, so that its setter is called."""
        owner = name.owner
        if not setting.base or setting.base in self._classes:
            return False
        if isinstance(owner, Compound):
            return name.name in owner._fixed and type(owner).__setattr__ is vars(Compound)["__setattr__"]
        is_set = isinstance(owner, type) and type(name.value) is property and name.value.fset is not None
        return is_set and owner.__name__ not in self._values


def _methods(tree: ast.AST) -> Iterator[tuple[str, str]]:
    above = {id(each) for kind in ast.walk(tree) if isinstance(kind, ast.ClassDef) for each in _of_bases(kind)}
    for each in ast.walk(tree):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Load) and id(each) not in above:
            yield _last(each.value), each.attr


def _values(node: ast.AST, around: ast.AST) -> Iterator[str]:
    """Yield the last names in expressions that may be classes used as values. Calls of a class, accesses to its
    attributes, base classes and annotations do not count."""
    if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
        is_called = isinstance(around, ast.Call) and around.func is node
        if not is_called and not isinstance(around, ast.Attribute | ast.ClassDef | ast.ExceptHandler):
            yield _last(node)
    for name, each in ast.iter_fields(node):
        if name in ("annotation", "returns") or (name == "args" and _called_name(node) in ONLY_COMPARED):
            continue
        for one in each if isinstance(each, list) else [each]:
            if isinstance(one, ast.AST):
                yield from _values(one, node)


def _again(node: ast.AST) -> Iterator[str]:
    """Yield the functions of BEFORE that code outside these functions uses."""
    for each in ast.iter_child_nodes(node):
        if isinstance(each, ast.FunctionDef) and each.name in BEFORE:
            continue
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Load) and each.attr in BEFORE:
            yield each.attr
        yield from _again(each)


def _of_bases(kind: ast.ClassDef) -> Iterator[ast.AST]:
    """Yield the calls of base class methods by methods of a class: `Base.method(self)`."""
    bases = set(map(_last, kind.bases))
    for each in ast.walk(kind):
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Attribute) and _last(each.func.value) in bases:
            first = each.args[0] if each.args else None
            if isinstance(first, ast.Name) and first.id == "self":
                yield each.func


def _last(node: ast.AST) -> str:
    """Return the last name of an expression whose attribute is read: `a.b` is b, `type(x)` is type; "" if it has
    none."""
    if isinstance(node, ast.Call):
        return "type" if isinstance(node.func, ast.Name) and node.func.id == "type" else ""
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _own_nodes(function: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a function, without those of functions inside it."""
    for each in ast.iter_child_nodes(function):
        yield each
        if not isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            yield from _own_nodes(each)


def _called_name(node: ast.AST) -> str:
    return _last(node.func) if isinstance(node, ast.Call) else ""


def _called(node: ast.Call) -> Iterator[tuple[str, ast.AST | None]]:
    """Yield the names that a call sets, and the object, or None if the object is unknown."""
    if (called := _called_name(node)) in SETTERS:
        yield _named(called, node.func, node)
    elif called == "reload" and (isinstance(node.func, ast.Name) or _last(node.func.value) == "importlib"):  # type: ignore[attr-defined]
        yield ANY, None


def _is_unfollowed(node: ast.AST, around: ast.AST) -> bool:
    """True if this may set any name: a setter that is passed as a value, renamed, or named in a text."""
    if isinstance(node, ast.alias):
        return node.name in (*FOLLOWED_CALLED, *UNFOLLOWED)
    if isinstance(node, ast.Constant):
        plain = (*NAMESPACES, *RUNNERS) if _called_name(around) == "getattr" else ()
        return node.value in (*SETTERS, *UNFOLLOWED[len(RUNNERS) :], *PARTS, *plain)
    if not (isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load)):
        return False
    if isinstance(around, ast.Call) and around.func is node:
        return _last(node) in UNFOLLOWED
    return _last(node) in (*FOLLOWED_CALLED, *UNFOLLOWED)


def _named(called: str, func: ast.AST, node: ast.Call) -> tuple[str, ast.AST | None]:
    """Return the name that a setter sets (the argument before the value, or the last one) and the object before it."""
    place = len(node.args) - (2 if "set" in called else 1)
    if node.keywords or place < 0 or any(isinstance(each, ast.Starred) for each in node.args):
        return ANY, None
    of = node.args[place - 1] if place else func.value if isinstance(func, ast.Attribute) else None
    name = node.args[place]
    return (name.value if isinstance(name, ast.Constant) and isinstance(name.value, str) else ANY), of


def _is_of(node: ast.AST | None, me: str) -> bool:
    """True if this is `self` or its namespace."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "vars" and node.args:
        node = node.args[0]
    elif isinstance(node, ast.Attribute) and node.attr == "__dict__":
        node = node.value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "super":
        return me != ""
    return isinstance(node, ast.Name) and node.id == me != ""


def _is_set(node: ast.Name | ast.Attribute | ast.Subscript) -> bool:
    return isinstance(node.ctx, ast.Store | ast.Del)


def _is_parameter(function: ast.Lambda, name: str) -> bool:
    """True if this is the parameter of a function on one line."""
    return any(each.arg == name for each in function.args.args)


def _only_reads(node: ast.AST) -> bool:
    """True if a dict at this place is only read and gets no other name."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in READERS
    if isinstance(node, ast.Attribute):
        return node.attr in READING
    if isinstance(node, ast.keyword):
        return node.arg is None
    return isinstance(node, READ_IN)


def _is_whole(node: ast.AST) -> bool:
    """True if this is a namespace as a dict."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id in NAMESPACES
    return isinstance(node, ast.Attribute) and node.attr == "__dict__"
