"""Attributes that no class declares: an assignment to such an attribute is a misspelling that would have no effect
(decision 83)."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import lru_cache
from types import FrameType
from typing import TYPE_CHECKING, Any, ClassVar

from umo.objects.stored_names import MAKING, is_slip, refuse_slips, stores_in
from umo.text import did_you_mean
from umo.user_code import abstract_names

FIRST = "; give a new attribute its first value in the class or in `setup`"
"""The part of a message that says what to do if a new attribute was meant."""
OBJECTS = "umo.objects."
assign = object.__setattr__
"""Assignment without a check. A lookup by this name is faster, and a machine of 10,000 objects makes 200,000
assignments."""


class DeclaredAttributes:
    """Base of objects that can have only the attributes that their class declares. A type checker accepts the same
    attributes.

    These are the names in the body of the class and of its bases (fields, annotations, values, functions), the
    attributes that a function in it assigns to its own object (`self.started = ...`), and the attributes that are
    assigned while `__init__` or `setup` runs, of the object itself or of an object that contains it. Names that begin
    with _ are not checked: a descriptor may keep its value there. Any other assignment raises AttributeError with the
    nearest name."""

    __slots__ = ()

    _class_names: ClassVar[frozenset[str]] = frozenset()
    _stored: ClassVar[frozenset[str]] = frozenset()
    """The names that the functions of this class assign to their own object."""
    _abstract: ClassVar[frozenset[str]] = frozenset()
    """The names of the functions that an object must have and that this class lacks."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        stores = [*stores_in(cls)]
        for base in cls.__mro__[1:-1]:
            stores += () if issubclass(base, DeclaredAttributes) else stores_in(base)
        cls._stored = shared(each.name for each in stores if each.function in MAKING)
        refuse_slips(cls, stores, own_names(cls))
        cls._stored = shared(each.name for each in stores)
        cls._class_names = shared(names_in(cls))
        cls._abstract = abstract_names(cls)

    if not TYPE_CHECKING:  # typed, any attribute could be assigned

        def __setattr__(self, name, value):
            if name not in self._class_names:
                check_declared(self, name)
            assign(self, name, value)


def names_in(cls: type) -> set[str]:
    """Return the names that a class and its bases declare."""
    found: set[str] = set()
    for each in cls.__mro__:
        found.update(vars(each), vars(each).get("__annotations__", ()), vars(each).get("_stored", ()))
    return found


def own_names(cls: type) -> set[str]:
    """Return the names except those that every object has."""
    return names_in(cls).difference(*(names_in(each) for each in cls.__mro__ if each.__module__.startswith(OBJECTS)))


def shared(names: Iterable[str]) -> frozenset[str]:
    """Return these names as a set that exists only once, because many objects have the same names."""
    return _the_same(frozenset(names))


@lru_cache(maxsize=10_000)
def _the_same(names: frozenset[str]) -> frozenset[str]:
    return names


def check_declared(owner: Any, name: str, instead: str = "") -> None:
    """Check an assignment. Raises AttributeError if no class declares the attribute. `instead`: advice on what to
    write; default: the nearest name."""
    if name.startswith("_") or name in getattr(owner, "__dict__", ()) or _is_made(owner, name, sys._getframe(2)):
        return
    if name not in names_in(type(owner)):  # a class may have got it since it was made
        where = getattr(owner, "_path", "") or type(owner).__name__
        raise AttributeError(f"{where} has no attribute {name!r}{instead or _nearest(owner, name) + FIRST}")


def _nearest(owner: Any, name: str) -> str:
    known = own_names(type(owner)).union(vars(owner))
    return did_you_mean(name, [each for each in known if not each.startswith("_")])


def _is_made(owner: Any, name: str, frame: FrameType | None) -> bool:
    """Return True if `__init__` or `setup` of this object, or of an object that contains it, is running. A part can
    then get a new attribute, but not a misspelt one."""
    around = owner
    while around is not None:
        if _is_making(around, frame):
            return around is owner or not any(is_slip(name, each) for each in own_names(type(owner)))
        around = getattr(around, "_parent", None)
    return False


def _is_making(owner: Any, frame: FrameType | None) -> bool:
    while frame is not None:
        code = frame.f_code
        if code.co_name in MAKING and code.co_argcount and frame.f_locals.get(code.co_varnames[0]) is owner:
            return True
        frame = frame.f_back
    return False
