"""Finds the types of the expressions in a station's code, as far as they are certain, from annotations and from the
machine that the station declares. The code is not executed."""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
from collections.abc import Callable, Collection, Coroutine, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from importlib.util import resolve_name
from types import FunctionType, ModuleType, NoneType, UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

import umo
from umo.objects import Atomic, Compound, walk
from umo.objects.laws import laws_in
from umo.signature import evaluated, hints_of

FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef
ScopeNode = ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
MISSING = object()
"""The value that stands for an attribute that does not exist or is not certain."""
ENDS = (ast.Await, ast.AsyncWith, ast.AsyncFor, ast.Break, ast.Return, ast.Raise, ast.Yield, ast.YieldFrom)
"""Statements by which a loop may wait or end. A comprehension with `async for` may also do so."""


class ExactObject(NamedTuple):
    """An object that is known exactly: a module, a class, a function, or another value in a module."""

    value: Any


class Instance(NamedTuple):
    """An object of a class. `optional`: it may also be None."""

    kind: type
    optional: bool = False


class Holding(NamedTuple):
    """A container whose elements have the same kind. `keyed`: True for a mapping, whose values are the elements."""

    each: Thing | None
    keyed: bool = False


class MadeSequence(NamedTuple):
    """The result of calling a sequence. `result`: the result of awaiting it."""

    result: Thing | None


class InnerFunction(NamedTuple):
    """A function in another function."""

    node: FunctionNode


Remarks = Iterator[tuple[Any, str]]
"""Nodes, each with its remark; `{}` stands for the source of the node."""
Thing = ExactObject | Instance | Holding | MadeSequence | InnerFunction
"""The meaning of an expression; None if it is not certain."""


class Binding(NamedTuple):
    """A binding of a name in a function. `resolve` returns its value."""

    how: str
    node: Any


class NameScope:
    """The names of a module or a function."""

    def __init__(self, node: ScopeNode, around: NameScope | None, code: ModuleCode, owner: type | None = None) -> None:
        self.node, self.around, self.code, self.owner = node, around, code, owner

    @cached_property
    def bindings(self) -> dict[str, list[Binding]]:
        found: dict[str, list[Binding]] = {}
        if not isinstance(self.node, ast.Module):
            for name, binding in _bindings(self.node):
                found.setdefault(name, []).append(binding)
        return found

    @property
    def is_control(self) -> bool:
        """True if the scope is the code of a sequence or a law."""
        is_law = getattr(self.node, "name", "") == "control" and self.owner is not None
        return is_law or (isinstance(self.node, ast.AsyncFunctionDef) and self._may_have_machine)

    @property
    def _may_have_machine(self) -> bool:
        """True if the function belongs to an object, or if one of its arguments may be an object. Other functions may
        belong to another program, such as a face, which runs in asyncio."""
        if self.owner is not None:
            return any(base is Compound or base.__module__.startswith("umo.operation.") for base in self.owner.__mro__)
        arguments = getattr(self.node, "args", None)
        if arguments is None:
            return False
        given = [self._argument(each) for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
        others = (isinstance(each, Instance) and not issubclass(each.kind, Compound | Atomic) for each in given)
        return not all(others) or (self.around is not None and self.around._may_have_machine)

    @property
    def is_own_method(self) -> bool:
        """True if the scope is a function whose first argument is `self`."""
        arguments = getattr(self.node, "args", None)
        return arguments is not None and [each.arg for each in arguments.args[:1]] == ["self"]

    def look_up(self, name: str) -> Thing | None:
        bindings = self.bindings.get(name)
        if bindings is not None:
            found = [self._bound(each, name) for each in bindings]
            return found[0] if all(_same(each, found[0]) for each in found) else None
        return self.code.of_module(name) if self.around is None else self.around.look_up(name)

    def _bound(self, binding: Binding, name: str) -> Thing | None:
        how, node = binding
        if how == "argument":
            return self._argument(node)
        if how == "value":
            return self.code.thing(node, self)
        if how == "element":
            found = self.code.thing(node, self)
            return found.each if isinstance(found, Holding) and not found.keyed else None
        if how == "annotation":
            return self.code.annotated(node, self)
        if how == "import":
            return self.code.imported(node, name)
        return InnerFunction(node) if how == "function" and not node.decorator_list else None

    def _argument(self, node: ast.arg) -> Thing | None:
        if node.annotation is not None:
            return self.code.annotated(node.annotation, self)
        first = [*self.node.args.posonlyargs, *self.node.args.args][:1] if hasattr(self.node, "args") else []
        if first != [node]:
            return None
        if self.owner is not None:
            return Instance(self.owner)
        return self.code.first_argument(self.node)


def _bindings(scope: Any) -> Iterator[tuple[str, Binding]]:
    """All names that a function binds, without those of functions inside it, unless they are bound there too."""
    arguments = scope.args
    for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
        yield each.arg, Binding("argument", each)
    for each in filter(None, (arguments.vararg, arguments.kwarg)):
        yield each.arg, Binding("", each)
    elsewhere = {name for node in within(scope) if isinstance(node, ast.Global | ast.Nonlocal) for name in node.names}
    for node in within(scope):
        yield from (each for each in _bound_by(node) if each[0] not in elsewhere)
        if isinstance(node, FunctionNode | ast.ClassDef):
            inner = (each.names for each in ast.walk(node) if isinstance(each, ast.Nonlocal))
            yield from ((name, Binding("", node)) for names in inner for name in names)


def _bound_by(node: ast.AST) -> Iterator[tuple[str, Binding]]:
    if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
        yield node.targets[0].id, Binding("value", node.value)
    elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        yield node.target.id, Binding("annotation", node.annotation)
    elif isinstance(node, ast.For | ast.comprehension) and isinstance(node.target, ast.Name):
        yield node.target.id, Binding("element", node.iter)
    elif isinstance(node, FunctionNode):
        yield node.name, Binding("function", node)
    elif isinstance(node, ast.ClassDef):
        yield node.name, Binding("", node)
    elif isinstance(node, ast.Import | ast.ImportFrom):
        for alias in node.names:
            yield (alias.asname or alias.name).partition(".")[0], Binding("import", node)
    elif isinstance(node, ast.ExceptHandler | ast.MatchAs | ast.MatchStar) and node.name:
        yield node.name, Binding("", node)
    elif isinstance(node, ast.MatchMapping) and node.rest:
        yield node.rest, Binding("", node)
    elif isinstance(node, _BINDING):
        for field in ("targets", "target", "optional_vars"):
            yield from ((each, Binding("", node)) for each in _names(getattr(node, field, None)))


_BINDING = ast.Assign | ast.AugAssign | ast.For | ast.AsyncFor | ast.comprehension | ast.NamedExpr | ast.withitem


def _same(one: Thing | None, other: Thing | None) -> bool:
    if isinstance(one, ExactObject) and isinstance(other, ExactObject):
        return one.value is other.value
    return type(one) is type(other) and one == other


def _names(target: Any) -> Iterator[str]:
    for one in target if isinstance(target, list) else [target] if target is not None else []:
        yield from (each.id for each in ast.walk(one) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))


def _loaded(path: str, attribute: str | None = None) -> ExactObject | None:
    """A module that has been imported, or something in it."""
    module = sys.modules.get(path)
    if module is None or attribute is None:
        return None if module is None else ExactObject(module)
    return _of_module(module, attribute)


def _of_module(module: ModuleType, name: str) -> ExactObject | None:
    """Return the object with this name in a module. umo imports its own names when they are first read."""
    if module is umo and name in umo.__all__:
        return ExactObject(getattr(umo, name))
    return ExactObject(vars(module)[name]) if name in vars(module) else None


def waits_or_ends(node: ast.AST) -> bool:
    """True if a loop that contains this node may wait or end."""
    return isinstance(node, ENDS) or (isinstance(node, ast.comprehension) and bool(node.is_async))


def within(scope: ast.AST) -> Iterator[ast.AST]:
    """Return all nodes that belong to a function or module itself. These include nested functions, but not their
    bodies."""
    body = scope.body if isinstance(scope.body, list) else [scope.body]  # type: ignore[attr-defined]
    waiting: list[ast.AST] = body[::-1]
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, FunctionNode | ast.Lambda | ast.ClassDef):
            waiting += list(ast.iter_child_nodes(node))[::-1]


def inside_of(statements: list[ast.stmt]) -> Iterator[ast.AST]:
    """Return all nodes of statements, without the nodes of functions inside them."""
    yield from within(ast.Module(statements, []))


class ModuleCode:
    """One module of a station. `machine`: the machine that the station declares. `main`: its application."""

    def __init__(self, module: ModuleType, tree: ast.Module, known: Objects, main: Any = None) -> None:
        self._module, self.tree, self._known, self._main = module, tree, known, main
        self._changing = {name for each in ast.walk(tree) if isinstance(each, ast.Global) for name in each.names}
        """The names of the module that functions bind."""
        self._at_work: set[int] = set()
        self.gives_seed = any(isinstance(each, ast.Attribute) and each.attr == "seed" for each in ast.walk(tree))
        """True if the module seeds a generator of random numbers, or may do so."""

    def of_module(self, name: str) -> Thing | None:
        """Return the meaning of a name of the module, or of Python. A name that is imported only for type checkers is
        searched for in the other modules."""
        if name in self._changing:
            return None
        for names in (vars(self._module), vars(builtins)):
            if name in names:
                return ExactObject(names[name])
        found = self._known.classes.get(name)
        return None if found is None else ExactObject(found)

    def imported(self, node: ast.Import | ast.ImportFrom, name: str) -> Thing | None:
        """Return the meaning of a name after an import within a function, without importing anything."""
        for alias in node.names:
            if (alias.asname or alias.name).partition(".")[0] != name:
                continue
            if isinstance(node, ast.Import):
                return _loaded(alias.name if alias.asname else name)
            with suppress(ImportError):  # the name leads out of the package: a run reports this
                path = resolve_name("." * node.level + (node.module or ""), self._module.__package__)
                return _loaded(path, alias.name)
        return None

    def class_at(self, node: ast.ClassDef) -> type | None:
        """Return the class that a statement of this module defines."""
        found = vars(self._module).get(node.name)
        own = isinstance(found, type) and found.__module__ == self._module.__name__ and found.__name__ == node.name
        return found if own else None

    def first_argument(self, node: Any) -> Thing | None:
        """Return the meaning of a function's first argument. For the application it is the machine."""
        is_main = getattr(getattr(self._main, "__code__", None), "co_firstlineno", 0) == node.lineno
        here = getattr(self._main, "__module__", "") == self._module.__name__
        return Instance(type(self._known.machine)) if is_main and here else None

    def annotated(self, node: ast.expr, scope: NameScope) -> Thing | None:
        """Return the meaning of a name that has this annotation."""
        names = {**self._known.classes, **vars(self._module)}
        return of_hint(evaluated(ast.unparse(node), names))

    def thing(self, node: ast.expr, scope: NameScope) -> Thing | None:
        """Return the meaning of an expression."""
        work = _EXPRESSIONS.get(type(node))
        if work is None or id(node) in self._at_work:  # a name whose binding contains the name itself
            return None
        self._at_work.add(id(node))
        try:
            return work(self, node, scope)
        finally:
            self._at_work.discard(id(node))

    def value(self, node: ast.expr, scope: NameScope) -> Any:
        """Return the object that an expression refers to, or None if that is not certain."""
        found = self.thing(node, scope)
        return found.value if isinstance(found, ExactObject) else None

    def atomic(self, node: ast.expr, scope: NameScope) -> type[Atomic] | None:
        """Return the class of an expression that is an actuator or a sensor."""
        found = self.thing(node, scope)
        return found.kind if isinstance(found, Instance) and issubclass(found.kind, Atomic) else None

    def _name(self, node: ast.Name, scope: NameScope) -> Thing | None:
        return scope.look_up(node.id)

    def _attribute(self, node: ast.Attribute, scope: NameScope) -> Thing | None:
        of = self.thing(node.value, scope)
        if isinstance(of, ExactObject):
            if isinstance(of.value, ModuleType):
                return _of_module(of.value, node.attr)
            if isinstance(of.value, type):
                found = inspect.getattr_static(of.value, node.attr, None)
                return None if found is None else ExactObject(_plain(found))
            of = Instance(type(of.value))
        return self._known.attribute(of.kind, node.attr) if isinstance(of, Instance) else None

    def _subscript(self, node: ast.Subscript, scope: NameScope) -> Thing | None:
        of = self.thing(node.value, scope)
        if isinstance(of, Holding):
            return of if isinstance(node.slice, ast.Slice) else of.each
        return None

    def _await(self, node: ast.Await, scope: NameScope) -> Thing | None:
        of = self.thing(node.value, scope)
        return of.result if isinstance(of, MadeSequence) else None

    def _call(self, node: ast.Call, scope: NameScope) -> Thing | None:
        if isinstance(node.func, ast.Attribute) and node.func.attr == "values":  # of a mapping of parts
            of = self.thing(node.func.value, scope)
            return Holding(of.each) if isinstance(of, Holding) and of.keyed else None
        function = self.thing(node.func, scope)
        if isinstance(function, InnerFunction):
            returns = function.node.returns
            returned = None if returns is None else self.annotated(returns, scope)
            return MadeSequence(returned) if isinstance(function.node, ast.AsyncFunctionDef) else returned
        if not isinstance(function, ExactObject):
            return None
        if isinstance(function.value, type):
            return Instance(function.value)
        if not isinstance(function.value, FunctionType):
            return None
        returned = of_hint(_returned(function.value))
        return MadeSequence(returned) if inspect.iscoroutinefunction(function.value) else returned


_EXPRESSIONS: Mapping[type[ast.AST], Callable[..., Thing | None]] = {
    ast.Name: ModuleCode._name,
    ast.Attribute: ModuleCode._attribute,
    ast.Subscript: ModuleCode._subscript,
    ast.Await: ModuleCode._await,
    ast.Call: ModuleCode._call,
}


class Objects:
    """The objects of the station's machine, and the classes of its modules by name. `changing`: the attributes that
    code outside `setup` assigns, so that their values may differ when the machine runs."""

    def __init__(self, machine: Compound, modules: list[ModuleType], changing: Collection[str]) -> None:
        self.machine, self._changing = machine, changing
        laws = [law for _, _, law in laws_in(machine)]
        self._all: list[Any] = [machine, *walk(machine), *laws]
        found: dict[str, set[type]] = {}
        for module in modules:
            for name, value in vars(module).items():
                if isinstance(value, type):
                    found.setdefault(name, set()).add(value)
        self.classes = {name: kinds.pop() for name, kinds in found.items() if len(kinds) == 1}
        self._attributes: dict[tuple[type, str], Thing | None] = {}

    def of(self, kind: type) -> list[Any]:
        """Return the objects of this class and of its subclasses."""
        return [each for each in self._all if isinstance(each, kind)]

    def own(self, item: Any, name: str) -> Any:
        """Return the value of an attribute that an object itself always has; MISSING if that is not certain."""
        is_fixed = name not in self._changing or name in getattr(item, "_fixed", ())
        return getattr(item, "__dict__", {}).get(name, MISSING) if is_fixed else MISSING

    def attribute(self, kind: type, name: str) -> Thing | None:
        """Return the meaning of an attribute of an object of this class."""
        if (kind, name) not in self._attributes:
            self._attributes[kind, name] = self._find(kind, name)
        return self._attributes[kind, name]

    def _find(self, kind: type, name: str) -> Thing | None:
        of_class = inspect.getattr_static(kind, name, None)
        if isinstance(of_class, property):
            return of_hint(_returned(of_class.fget))
        function = _plain(of_class)
        if isinstance(function, FunctionType):
            return ExactObject(function) if self._always(kind, name, function) else None
        of_objects = {_of_value(value) for value in self._values(kind, name)} if name not in self._changing else set()
        if len(of_objects) == 1:
            return of_objects.pop()
        return of_hint(hints_of(kind).get(name))

    def _always(self, kind: type, name: str, function: FunctionType) -> bool:
        """True if neither a subclass nor an object replaces this method by something of another kind."""
        is_sequence = inspect.iscoroutinefunction(function)
        others = [_plain(inspect.getattr_static(each, name)) for each in below(kind)]
        if any(inspect.iscoroutinefunction(each) != is_sequence for each in others):
            return False
        return name == "control" or not self._values(kind, name)

    def _values(self, kind: type, name: str) -> list[Any]:
        """Return the values of an attribute for all objects of a class that have this attribute themselves."""
        own = (getattr(each, "__dict__", {}) for each in self.of(kind))
        return [each[name] for each in own if name in each]


def below(kind: type) -> Iterator[type]:
    """Return the classes that are derived from a class."""
    each: type
    for each in type.__subclasses__(kind):
        yield each
        yield from below(each)


def _plain(found: Any) -> Any:
    """Return the function of a method, also of a static method or a class method."""
    return found.__func__ if isinstance(found, staticmethod | classmethod) else found


def _returned(function: Any) -> Any:
    annotations = getattr(function, "__annotations__", {})
    names = vars(sys.modules.get(getattr(function, "__module__", ""), object))
    return evaluated(annotations["return"], names) if "return" in annotations else None


def _of_value(value: Any) -> Thing | None:
    """Return the value of an attribute as data that can be compared."""
    if value is None or isinstance(value, FunctionType):
        return None
    if isinstance(value, tuple | list):
        kinds = {type(each) for each in value}
    elif isinstance(value, Mapping):
        kinds = {type(each) for each in value.values()}
    else:
        return Instance(type(value))
    return Holding(Instance(kinds.pop()) if len(kinds) == 1 else None, isinstance(value, Mapping))


def _is_protocol(kind: type) -> bool:
    """True if a type is a protocol: it says which attributes an object has, not to which class the object belongs."""
    return bool(getattr(kind, "_is_protocol", False))


def of_hint(hint: Any) -> Thing | None:
    """Return the meaning of a name that has this annotation."""
    if isinstance(hint, TypeVar):
        return of_hint(hint.__bound__)
    if isinstance(hint, type) and get_origin(hint) is None:
        return None if hint in (Any, NoneType, object) or _is_protocol(hint) else Instance(hint)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return of_hint(arguments[0])
    if origin in (Union, UnionType):
        others = [each for each in arguments if each is not NoneType]
        found = of_hint(others[0]) if len(others) == 1 else None
        return found._replace(optional=True) if isinstance(found, Instance) else found
    if not isinstance(origin, type) or _is_protocol(origin):
        return None
    if issubclass(origin, Coroutine):
        return MadeSequence(of_hint(arguments[-1]) if arguments else None)
    if issubclass(origin, Iterable) and origin.__module__ in ("collections.abc", "builtins", "types"):
        keyed, is_plain = issubclass(origin, Mapping), arguments and (origin is not tuple or arguments[1:] == (...,))
        return Holding(of_hint(arguments[-1 if keyed else 0]) if is_plain else None, keyed)
    return Instance(origin)
