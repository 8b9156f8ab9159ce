"""The values that translation takes as known: all values that control code reads, except tracked numbers.

Each name is kept with its value and the line that reads it: attributes of objects, classes and modules, names of
enclosing functions, elements of containers, the code and the defaults of functions. A change of one of them makes the
translation wrong: compiled laws and hosts of controllers watch them (`known_watch.py`), and the generator looks for
code that sets them (`known_setters.py`)."""

from __future__ import annotations

import builtins
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property, partial
from types import CodeType, FunctionType, MappingProxyType, MemberDescriptorType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from umo.generate.function_source import shown_file
from umo.generate.value_kinds import is_fixed_ring
from umo.objects import Node

ABSENT = object()
"""The value of a name that does not exist."""
MUTABLE = list, dict, set, deque, MappingProxyType, bytearray, np.ndarray
"""Containers whose elements are compared individually."""
PLAIN = str, bytes, bool, int, float, complex, type(None)
"""Types whose values are equal if their `repr` is equal."""
MOST_ELEMENTS = 4096
HEAP_TYPE = 1 << 9
"""The flag of a class made by a `class` statement. Other classes do not change."""
OF_MEMBERS = {"name": "_name_", "value": "_value_"}
"""Attributes of the members of each Enum, and the attributes that store them."""
FUNCTIONS = FunctionType, staticmethod, classmethod, property, cached_property


class Unwatchable(Exception):
    """Raised if a value depends on something whose changes cannot be detected. The message says why."""


class KnownName(NamedTuple):
    """A name whose value was taken as known, and the first line that reads it."""

    owner: Any
    """The object, class or module, or the function for a name of an enclosing function."""
    name: str
    value: Any
    file: str
    line: int

    @property
    def label(self) -> str:
        """The name in messages, such as `Tank.mode_name` or `zones.3.mode_name`."""
        if isinstance(self.owner, dict | ModuleType):
            module = vars_of(self.owner)
            return f"{self.name} of {shown_file(module.get('__file__') or '', module.get('__name__') or '')}"
        if isinstance(self.owner, FunctionType):
            return f"{self.name} of {self.owner.__qualname__.replace('.<locals>', '')}"
        if isinstance(self.owner, Node) and self.owner._path:
            return f"{self.owner._path}.{self.name}"
        return f"{(self.owner if isinstance(self.owner, type) else type(self.owner)).__qualname__}.{self.name}"

    @property
    def place(self) -> str:
        return f"{self.file}:{self.line}"

    @property
    def is_worth_noting(self) -> bool:
        """True if this name is of interest to a user: it is not a function, class or module, not a part of the machine
        at its place, and not a constant of umo or Python."""
        if isinstance(self.value, type | ModuleType | property) or callable(self.value):
            return False
        if isinstance(self.owner, dict | ModuleType):
            return not is_installed(str(vars_of(self.owner).get("__name__", "")))
        return not isinstance(self.value, Node) or (self.name != "self" and self.value._path != self.label)

    def __str__(self) -> str:
        return f"`{self.label}` is {_text_of(self.value)} ({self.place})"


@dataclass
class Namespace:
    """The names of one object, class or module, with their values; ABSENT if the name must not exist."""

    owner: Any
    """The object or class, or the dict of a module."""
    names: dict[str, Any] = field(default_factory=dict)
    kind: type | None = None
    """The class that the object must have; None means any."""

    @property
    def now(self) -> Any:
        return vars_of(self.owner)


class Content(NamedTuple):
    """A container and its elements."""

    container: Any
    elements: tuple[Any, ...]
    name: KnownName

    def holds(self) -> bool:
        return same_all(self.elements, elements_of(self.container))


class KnownValues:
    """The values that one translation has taken as known."""

    def __init__(self) -> None:
        self.names: dict[tuple[int, str], KnownName] = {}
        self.objects: dict[int, Namespace] = {}
        """Objects and modules, by their ids."""
        self.classes: dict[type, Namespace] = {}
        self.contents: dict[int, Content] = {}
        self.attributes: dict[tuple[int, str], tuple[Any, str, Any, KnownName]] = {}
        """Values from other places: the object, its attribute, the value, and the name used in messages."""
        self.fields: dict[tuple[int, str], KnownName] = {}
        """Tracked numbers that are class attributes, as long as the object has no attribute of this name of its own."""
        self._told: dict[tuple[int, str], KnownName] = {}
        """The names of a namespace as used in messages."""
        self._read: set[tuple[int, str]] = set()
        """Objects and their attributes that were already read."""

    # What translated code reads ------------------------------------------------------------------------

    def attribute(self, owner: Any, name: str, at: tuple[str, int]) -> None:
        """Record an attribute of a live object, class or module, or record that it does not exist. Raises Unwatchable
        if its changes cannot be detected."""
        if (id(owner), name) in self._read:
            return
        if isinstance(owner, type) and issubclass(owner, Enum) and _is_member(owner, name):
            return  # nobody can set it
        known = self._named(owner, name, getattr(owner, name, ABSENT), at)
        if isinstance(owner, ModuleType):
            if name not in vars(owner) and known.value is not ABSENT:
                raise Unwatchable(f"{known.label} is computed where it is read")
            self._module(vars(owner), name, known)
        elif isinstance(owner, type):
            if name not in vars(type):
                self._class(owner, name, known)
        elif isinstance(owner, Enum) and name in OF_MEMBERS:
            self._own(owner, OF_MEMBERS[name], known)
        else:
            self._instance(owner, name, known)
        self._content(known.value, known)
        self._read.add((id(owner), name))

    def variable(self, function: FunctionType, name: str, at: tuple[str, int]) -> None:
        """Record a name of a function that is not local."""
        code = function.__code__
        if name in code.co_freevars and function.__closure__ is not None:
            cell = function.__closure__[code.co_freevars.index(name)]
            known = self._named(function, name, cell.cell_contents, at)
            self.attributes[id(cell), name] = cell, "cell_contents", known.value, known
        else:
            scope = function.__globals__
            home = scope if name in scope else vars(builtins)
            known = self._named(scope, name, home.get(name, ABSENT), at)
            self._module(scope, name, known)
            if home is not scope:
                self._module(home, name, known)
        self._content(known.value, known)

    def function(self, function: FunctionType, at: tuple[str, int]) -> None:
        """Record the code of a function and its defaults."""
        for name in ("__code__", "__defaults__", "__kwdefaults__"):
            known = KnownName(function, name, getattr(function, name), *at)
            self.attributes[id(function), name] = function, name, known.value, known
            if name != "__code__" and not is_installed(function.__module__ or ""):
                self._content(known.value, known)

    def tracked(self, owner: Any, name: str, at: tuple[str, int]) -> None:
        """Record a tracked number: an attribute of the object or of its class."""
        found = _in_classes(type(owner), name)
        if isinstance(found, MemberDescriptorType) or name in getattr(owner, "__dict__", {}):
            return
        if hasattr(type(found), "__get__") or found is ABSENT:
            raise Unwatchable(f"{name!r} of a {type(owner).__name__} is computed where it is read")
        known = KnownName(owner, name, found, *at)
        self.fields[id(owner), name] = known
        self._class(type(owner), name, known)

    def codes(self) -> Iterator[CodeType]:
        """Return the code of the translated functions."""
        return (value for owner, name, value, _ in self.attributes.values() if name == "__code__")

    def names_of(self, owner: Any) -> frozenset[str]:
        """Return the attributes of one object that are taken as known."""
        return frozenset(name for each, name in self.names if each == id(owner))

    # Where it is ---------------------------------------------------------------------------------------

    def _named(self, owner: Any, name: str, value: Any, at: tuple[str, int]) -> KnownName:
        return self.names.setdefault((id(owner), name), KnownName(owner, name, value, *at))

    def _instance(self, owner: Any, name: str, known: KnownName) -> None:
        own, found = getattr(owner, "__dict__", None), _in_classes(type(owner), name)
        if isinstance(own, dict):
            self._own(owner, name, known)
            self._class(type(owner), name, known)
            if name in own and not hasattr(type(found), "__set__"):
                return
        if isinstance(found, MemberDescriptorType):
            self.attributes[id(owner), name] = owner, name, known.value, known
        elif found is ABSENT and known.value is not ABSENT:
            raise Unwatchable(f"{name!r} of a {type(owner).__name__} is not an attribute that can be set")
        elif hasattr(type(found), "__get__") and not isinstance(found, FUNCTIONS) and _changes(type(owner)):
            raise Unwatchable(f"{name!r} of a {type(owner).__name__} is computed where it is read")

    def _own(self, owner: Any, name: str, known: KnownName) -> None:
        """Record the object's own attribute of this name."""
        self.objects.setdefault(id(owner), Namespace(owner)).names.setdefault(name, vars(owner).get(name, ABSENT))
        self._told.setdefault((id(owner), name), known)

    def _class(self, kind: type, name: str, known: KnownName) -> None:
        self.attributes[id(kind), "__mro__"] = kind, "__mro__", kind.__mro__, known
        for each in kind.__mro__:
            if _changes(each):
                self.classes.setdefault(each, Namespace(each)).names.setdefault(name, vars(each).get(name, ABSENT))
                self._told.setdefault((id(each), name), known)
            if name in vars(each):
                return

    def _module(self, scope: dict[str, Any], name: str, known: KnownName) -> None:
        self.objects.setdefault(id(scope), Namespace(scope)).names.setdefault(name, scope.get(name, ABSENT))
        self._told.setdefault((id(scope), name), known)

    def _content(self, value: Any, known: KnownName, depth: int = 0) -> None:
        """Record the elements of containers, and of the containers in them."""
        if isinstance(value, np.ndarray) and not value.flags.c_contiguous:
            raise Unwatchable(f"{known.label} is a view of another array")
        if isinstance(value, partial):
            for name in ("func", "args", "keywords"):
                part = getattr(value, name)
                self.attributes[id(value), name] = value, name, part, known
                self._content(part, known, depth + 1)
            return
        if isinstance(value, MUTABLE) and not is_fixed_ring(value):
            if id(value) in self.contents:
                return
            elements = elements_of(value)
            self.contents[id(value)] = Content(value, elements, known)
        elif isinstance(value, tuple | frozenset):
            elements = tuple(value)
        else:
            self._class_of(value)
            return
        if len(elements) > MOST_ELEMENTS or depth > 8:
            raise Unwatchable(f"{known.label} has {len(elements)} elements; at most {MOST_ELEMENTS} are watched")
        for each in elements:
            self._content(each, known, depth + 1)

    def _class_of(self, value: Any) -> None:
        """Record the class of an object, which code may test or somebody may set."""
        if (
            _changes(type(value))
            and not isinstance(value, type | Enum)
            and isinstance(getattr(value, "__dict__", 0), dict)
        ):
            self.objects.setdefault(id(value), Namespace(value)).kind = type(value)

    # Whether it still is -------------------------------------------------------------------------------

    def changes(self) -> Iterator[KnownName]:
        """Return the names whose values have changed. A new object with an equal value does not count as a change, nor
        does a change that no code reads."""
        for space in (*self.objects.values(), *self.classes.values()):
            if space.kind is not None and type(space.owner) is not space.kind:
                yield KnownName(space.owner, "__class__", space.kind, "", 0)
            now = space.now
            for name, value in space.names.items():
                found = now.get(name, ABSENT)
                if found is value:
                    continue
                if same(value, found) or self._is_hidden(space.owner, name):
                    space.names[name] = found
                else:
                    yield self._told[id(space.owner), name]
        for key, content in self.contents.items():
            if not content.holds():
                yield content.name
            else:
                self.contents[key] = content._replace(elements=elements_of(content.container))
        for place, (owner, name, value, known) in self.attributes.items():
            found = getattr(owner, name, ABSENT)
            if not same(value, found):
                yield known
            else:
                self.attributes[place] = owner, name, found, known

    def bind(self, owners: Iterable[Any]) -> None:
        """Record that these objects have a subclass of their class from now on."""
        for owner in owners:
            if id(owner) in self.objects:
                self.objects[id(owner)].kind = type(owner)

    def settle(self) -> None:
        """Stop watching attributes of classes that are now hidden by an attribute of the object."""
        own = [key for key, each in self.fields.items() if each.name in vars(each.owner)]
        for key in own:
            del self.fields[key]

    def _is_hidden(self, kind: Any, name: str) -> bool:
        """True if nothing reads this attribute of a class because its objects have their own."""
        if not isinstance(kind, type):
            return False
        if any(each.name == name and _reads(each.owner, kind) for each in self.names.values()):
            return False
        fields = (each for each in self.fields.values() if each.name == name and isinstance(each.owner, kind))
        return all(name in vars(each.owner) for each in fields)


def vars_of(owner: Any) -> Any:
    return owner if isinstance(owner, dict) else vars(owner)


def is_installed(module: str) -> bool:
    """True if a module belongs to Python, umo or an installed package. Stations of umo do not count as installed."""
    first = module.partition(".")[0]
    if first == "umo":
        return not module.startswith("umo.stations.")
    file = str(getattr(sys.modules.get(module), "__file__", ""))
    return first in sys.stdlib_module_names or "site-packages" in file


def elements_of(container: Any) -> tuple[Any, ...]:
    """Return the elements in their order. For a dict they are alternately its keys and values; for an array, its
    bytes."""
    if isinstance(container, np.ndarray | bytearray):
        return (container.tobytes() if isinstance(container, np.ndarray) else bytes(container),)
    if isinstance(container, dict | MappingProxyType):
        return tuple(each for pair in container.items() for each in pair)
    return tuple(container)


def _text_of(value: Any) -> str:
    """Return a value as text that is the same in each run."""
    if value is ABSENT:
        return "not there"
    if isinstance(value, Node):
        return f"the object `{value._path}`" if value._path else f"the machine, a {type(value).__name__}"
    if isinstance(value, tuple | list):
        ends = "()" if isinstance(value, tuple) else "[]"
        return f"{ends[0]}{', '.join(map(_text_of, value[:8]))}{', ...' if len(value) > 8 else ''}{ends[1]}"
    if isinstance(value, (*PLAIN, np.generic)):
        return f"`{str(value) if isinstance(value, Enum) else repr(value)[:80]}`"
    return f"a {type(value).__name__}" + (f", `{value}`" if isinstance(value, Enum) else "")


def same(before: Any, now: Any) -> bool:
    """True if both are the same object, or plain values with the same `repr`."""
    return before is now or (type(before) is type(now) and isinstance(now, PLAIN) and repr(before) == repr(now))


def same_all(before: tuple[Any, ...], now: tuple[Any, ...]) -> bool:
    return len(before) == len(now) and all(map(same, before, now))


def _reads(owner: Any, kind: type) -> bool:
    """True if what was read of this owner may come from a class."""
    return issubclass(owner, kind) if isinstance(owner, type) else isinstance(owner, kind)


def _in_classes(kind: type, name: str) -> Any:
    return next((vars(each)[name] for each in kind.__mro__ if name in vars(each)), ABSENT)


def _changes(kind: type) -> bool:
    """True if attributes of a class can be set."""
    return bool(kind.__flags__ & HEAP_TYPE)


def _is_member(kind: type[Enum], name: str) -> bool:
    return name in kind.__members__
