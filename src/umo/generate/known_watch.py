"""Looks whether what translation has taken as known still is so: once a period, before the laws act."""

from __future__ import annotations

from abc import ABCMeta
from collections.abc import Callable, Sequence
from ctypes import c_void_p, cast, pythonapi
from gc import get_referents
from types import CellType, FunctionType, MappingProxyType
from typing import Any

from umo.cycle.conversion import extension
from umo.generate.bound_fields import class_below
from umo.generate.known_values import ABSENT, KnownName, KnownValues, elements_of, is_installed, same_all
from umo.objects.atomic import Atomic

VALID_VERSION = 1 << 19
"""Flag of a class whose attributes were looked up, and not changed since: neither its own nor those above it."""
PARTS = "__code__", "__defaults__", "__kwdefaults__"
"""What a function may be given anew."""
ADDRESSES = tuple(
    cast(getattr(pythonapi, name), c_void_p).value
    for name in ("PyCell_Get", "PyFunction_GetCode", "PyFunction_GetDefaults", "PyFunction_GetKwDefaults")
)
"""The functions of Python in C that give what is in a cell, and these."""


class KnownWatch:
    """`changed` is called with the names whose values are others now."""

    def __init__(
        self,
        known: KnownValues,
        changed: Callable[[list[KnownName]], None],
        elsewhere: Sequence[tuple[Any, frozenset[str]]] = (),
    ) -> None:
        """`elsewhere`: objects, and names of their attributes that are not in the objects: nobody is to put them
        there."""
        self._known, self._changed, self._elsewhere = known, changed, elsewhere
        self._below: dict[type, type | None] = {}
        self.look: Callable[[], bool] = self._changes
        """Whether everything is as it was: the cheapest way to find out."""
        self.on_renewal: Callable[[], None] = lambda: None
        """Called when `look` is another."""
        self._changes()

    def _changes(self) -> bool:
        """Something may be another object: compare by value, and begin anew."""
        found = list(self._known.changes())
        for owner, names in self._elsewhere:
            found += [KnownName(owner, name, None, "", 0) for name in names & vars(owner).keys()]
        if found:
            self._changed(found)
            return False
        self._renew()
        return True

    def _renew(self) -> None:
        """Look at the objects that are there now."""
        always, in_turn = self._spaces()
        types, of_classes = self._types()
        always += of_classes
        contents = tuple((_behind(each.container), each.elements) for each in self._known.contents.values())
        read = [each[:3] for each in self._known.attributes.values()]
        others = tuple(each for each in read if not isinstance(each[0], FunctionType | CellType))
        cells = tuple((cell, value) for cell, _, value in read if isinstance(cell, CellType))
        functions = self._functions()
        own = tuple(each for each in functions if not is_installed(each[0].__module__ or ""))
        rest = tuple(each for each in functions if is_installed(each[0].__module__ or ""))
        given = (*always, *in_turn), len(always), tuple(types), contents, others, cells, own, rest
        native = getattr(extension, "Watch", _Watch)
        self.look = native(*given, ADDRESSES, CellType, FunctionType, ABSENT, self._changes).look
        self.on_renewal()

    def _functions(self) -> list[tuple[Any, ...]]:
        """The functions with what they were, in the order of PARTS."""
        found: dict[int, list[Any]] = {}
        for owner, name, value, _ in self._known.attributes.values():
            if isinstance(owner, FunctionType):
                found.setdefault(id(owner), [owner, None, None, None])[1 + PARTS.index(name)] = value
        return list(map(tuple, found.values()))

    def _spaces(self) -> tuple[list[tuple[Any, ...]], list[tuple[Any, ...]]]:
        """The names of objects and modules: those that are looked at each time, and those of which one is. The latter
        are modules of umo and Python; sensors and actuators, whose numbers nobody can set; and what is not to be in
        objects that tell it by themselves (`bound_fields.BoundFields`)."""
        always, in_turn = [], []
        told = {id(owner): owner for owner, _ in self._elsewhere}
        for key, each in self._known.objects.items():
            if key in told:
                there = {name: value for name, value in each.names.items() if value is not ABSENT}
                always.append(_space(vars(told.pop(key)), there, complete=True))
                in_turn.append(_space(each.owner, each.names))
            elif isinstance(each.owner, Atomic) or (
                isinstance(each.owner, dict) and is_installed(str(each.owner.get("__name__", "")))
            ):
                in_turn.append(_space(each.owner, each.names))
            else:
                always.append(_space(each.owner, each.names))
        return always + [_space(vars(each), {}, complete=True) for each in told.values()], in_turn

    def _types(self) -> tuple[list[type], list[tuple[Any, ...]]]:
        """Classes of our own below those that are watched; and the dicts of classes that can have none."""
        types, dicts = [], []
        for kind, space in self._known.classes.items():
            if kind not in self._below:
                self._below[kind] = _untouched(kind)
            below = self._below[kind]
            if below is not None and is_valid(below):
                types.append(below)
            else:
                (behind,) = get_referents(vars(kind))
                dicts.append(_space(behind, space.names))
        return types, dicts


def _space(owner: Any, names: dict[str, Any], complete: bool = False) -> tuple[Any, ...]:
    """`complete`: the owner is to have as many names as now."""
    kind = None if type(owner) is dict else type(owner)
    return owner, kind, len(owner) if complete else -1, tuple(names), tuple(names.values())


def _behind(container: Any) -> Any:
    """The dict of which a proxy is a view: it is compared element by element."""
    if isinstance(container, MappingProxyType):
        (found,) = get_referents(container)
        return found if type(found) is dict else container
    return container


def _untouched(kind: type) -> type | None:
    """A class below another one, of which nobody ever looks an attribute up; None: there can be none."""
    if type(kind) not in (type, ABCMeta):
        return None  # its metaclass may do something with each class
    try:
        return class_below(kind, {})
    except Exception:  # a class that is final, or whose metaclass refuses
        return None


def is_valid(kind: type) -> bool:
    """Look an attribute up: from now on the flag of the class tells whether one above it is changed."""
    getattr(kind, "__no_such_attribute__", None)
    return bool(kind.__flags__ & VALID_VERSION)


class _Watch:
    """As umo.cycle._columns.Watch, in Python."""

    def __init__(
        self,
        spaces: Any,
        always: object,
        types: Any,
        contents: Any,
        attributes: Any,
        cells: Any,
        functions: Any,
        in_turn: Any,
        addresses: object,
        of_cells: object,
        of_functions: object,
        absent: object,
        changed: Callable[[], bool],
    ) -> None:
        self._spaces, self._types, self._contents = spaces, types, contents
        self._functions = (*functions, *in_turn)
        self._attributes = (*attributes, *((cell, "cell_contents", value) for cell, value in cells))
        self._absent, self._changed = absent, changed

    def look(self) -> bool:
        try:
            same = self._is_all()
        except Exception:  # what can no longer be read is not what it was
            same = False
        return True if same else self._changed()

    def _is_all(self) -> bool:
        return (
            all(self._is_space(*each) for each in self._spaces)
            and all(each.__flags__ & VALID_VERSION for each in self._types)
            and all(same_all(elements_of(container), elements) for container, elements in self._contents)
            and all(getattr(owner, name) is value for owner, name, value in self._attributes)
            and all(getattr(each[0], name) is each[n] for each in self._functions for n, name in enumerate(PARTS, 1))
        )

    def _is_space(self, owner: Any, kind: type | None, size: int, names: Any, values: Any) -> bool:
        if kind is not None and type(owner) is not kind:
            return False
        now = owner if kind is None else vars(owner)
        if size >= 0 and len(now) != size:
            return False
        return all(now.get(name, self._absent) is value for name, value in zip(names, values, strict=True))
