"""Finds by trial where this Python stores the references of an object and the version of a dict, because Python's
stable interface does not report that. With these addresses C compares known values without calling Python
(`known_watch.py`)."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from ctypes import c_uint64, c_void_p, cast, py_object, pythonapi
from functools import cache, lru_cache
from gc import get_referents
from types import CellType, FunctionType, MemberDescriptorType, ModuleType
from typing import Any, TypeAlias

from umo.cycle.conversion import extension
from umo.generate.bound_fields import class_below

WORD = 8
"""Size of a reference, and of a version, in bytes."""
WATCHES_DICTS = (3, 12)
"""The version from which on Python reports each change of a dict. In earlier versions each dict has a version number
(PEP 509)."""
Change: TypeAlias = Callable[[], object]


class _Mark:
    """A unique value."""


def place_of(owner: Any, name: str, value: Any) -> int:
    """Return the address at which an object stores its reference to the value of this attribute, or 0 if it is not
    known."""
    if sys.implementation.name != "cpython" or sys.maxsize < 2**32:
        return 0
    at = _place_of(owner, name)
    absent = value is None and isinstance(owner, FunctionType)
    return at if at and _word(at) == (0 if absent else id(value)) else 0


def _place_of(owner: Any, name: str) -> int:
    if name == "__class__":
        return id(owner) + WORD
    if name == "__dict__":
        return _place_of_dict(owner)
    if isinstance(owner, type):
        offset = _of_classes().get(name, 0)
    elif isinstance(owner, FunctionType):
        offset = _of_functions().get(name, 0)
    elif isinstance(owner, CellType):
        offset = _of_cells()
    else:
        found = next((vars(each)[name] for each in type(owner).__mro__ if name in vars(each)), None)
        offset = _of_slot(found) if isinstance(found, MemberDescriptorType) else 0
    return id(owner) + offset if offset else 0


def _place_of_dict(owner: Any) -> int:
    find = getattr(pythonapi, "_PyObject_GetDictPtr", None)
    if find is None:
        return 0
    find.restype, find.argtypes = c_void_p, (py_object,)
    return int(find(owner) or 0)


def _word(at: int) -> int:
    return int(c_uint64.from_address(at).value)


def _words(owner: Any) -> list[int]:
    """Return the words in the memory of an object."""
    return [_word(id(owner) + at) for at in range(0, type(owner).__basicsize__ // WORD * WORD, WORD)]


def _offset(owner: Any, value: Any, put: Callable[[], object]) -> int:
    """Return the offset of a reference to a value after it was set; 0 if it is found nowhere or more than once."""
    put()
    words = _words(owner)
    return words.index(id(value)) * WORD if words.count(id(value)) == 1 else 0


@cache
def _of_functions() -> dict[str, int]:
    def probe() -> None:
        """Do nothing."""

    def other() -> None:
        """Do nothing, like `probe`."""

    values = {"__code__": other.__code__, "__defaults__": (_Mark(),), "__kwdefaults__": {"mark": _Mark()}}
    return {name: _offset(probe, value, lambda: setattr(probe, name, value)) for name, value in values.items()}  # noqa: B023


@cache
def _of_classes() -> dict[str, int]:
    kind = type("_Probed", (), {})
    return {"__mro__": _offset(kind, kind.__mro__, lambda: None)}


@cache
def _of_cells() -> int:
    cell, mark = CellType(), _Mark()
    return _offset(cell, mark, lambda: setattr(cell, "cell_contents", mark))


@lru_cache(maxsize=1024)
def _of_slot(descriptor: MemberDescriptorType) -> int:
    """Return the offset of a slot, found with an object of a subclass."""
    mark = _Mark()
    try:
        probe: Any = object.__new__(class_below(descriptor.__objclass__, {"__del__": lambda self: None}))
        return _offset(probe, mark, lambda: descriptor.__set__(probe, mark))
    except Exception:  # a class that is final or abstract, or of another language; or a slot that is only read
        return 0


# The version of a dict ------------------------------------------------------------------------------------


def place_of_version(names: dict[str, Any]) -> int:
    """Return the address of a number that differs after each change of a dict, or 0 if there is no such number."""
    return _place_of_version(names) if _is_each_change_told() else 0


def _place_of_version(names: dict[str, Any]) -> int:
    if sys.version_info >= WATCHES_DICTS:
        return int(extension.count_changes(names, *_watchers()))
    return id(names) + _version_offset()


@cache
def _watchers() -> tuple[int, ...]:
    return tuple(cast(getattr(pythonapi, name), c_void_p).value or 0 for name in ("PyDict_AddWatcher", "PyDict_Watch"))


@cache
def _version_offset() -> int:
    """Return the offset of a number that differs if a dict has another value."""
    probe = {"name": 0}
    before = _words(probe)
    probe["name"] = 1
    changed = [place * WORD for place, (old, new) in enumerate(zip(before, _words(probe), strict=True)) if old != new]
    return changed[0] if len(changed) == 1 else 0


@cache
def _is_each_change_told() -> bool:
    if sys.implementation.name != "cpython" or extension is None:
        return False
    try:
        return all(_is_told(_place_of_version(names), change) for names, change in _changes())
    except Exception:  # another Python, or eight others watch dicts
        return False


def _is_told(place: int, change: Change) -> bool:
    """True if the number differs after a change, also after Python has specialised the code."""
    seen = {_word(place)}
    for _ in range(64):
        change()
        if _word(place) in seen:
            return False
        seen.add(_word(place))
    return True


class _Probe:
    """An object for trials with attributes."""

    name: Any

    def change(self) -> None:
        self.name = _Mark()

    def renew(self) -> None:
        del self.name
        self.name = _Mark()


def _changes() -> Iterator[tuple[dict[str, Any], Change]]:
    """Dicts of each kind, and changes that do not alter their size."""
    one, other, late = _Probe(), _Probe(), _Probe()
    late.name = 0
    kind, module = type("_Probed", (), {"name": 0}), ModuleType("_probed")
    (of_kind,) = get_referents(vars(kind))
    exec("name = 0\ndef change():\n    global name\n    name = object()", vars(module))
    for each in (one, late):
        yield vars(each), each.change
        yield vars(each), each.renew
    yield vars(other), lambda: object.__setattr__(other, "name", _Mark())
    yield vars(other), lambda: setattr(other, "name", _Mark())
    yield of_kind, lambda: setattr(kind, "name", _Mark())
    yield vars(module), vars(module)["change"]
    yield vars(module), lambda: setattr(module, "name", _Mark())
    plain: dict[str, Any] = {"name": 0, "other": 0}
    for names in (plain, vars(other), vars(module)):
        yield from ((names, each) for each in _ways(names))


def _ways(names: dict[str, Any]) -> list[Change]:
    """Return the ways to change a dict."""

    def change(way: Callable[[], object]) -> Change:
        def done() -> None:
            way()
            names["name"] = _Mark()

        return done

    return [
        lambda: names.update(name=_Mark()),
        lambda: names.__ior__({"name": _Mark()}),
        lambda: names.__setitem__("name", _Mark()),
        lambda: (names.pop("name"), names.setdefault("name", _Mark())),
        change(lambda: names.__delitem__("name")),
        change(names.popitem),
        change(names.clear),
    ]
