"""Looks whether what translation has taken as known still is so: once a period, before the laws act."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from gc import get_referents
from operator import is_
from types import FunctionType
from typing import Any

from umo.cycle.conversion import extension
from umo.generate.bound_fields import class_below
from umo.generate.known_values import ABSENT, KnownName, KnownValues, elements_of, is_installed

VALID_VERSION = 1 << 19
"""Flag of a class whose attributes were looked up, and not changed since: neither its own nor those above it."""


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
        sized = {id(owner) for owner, _ in self._elsewhere}
        spaces = tuple(self._space(each.owner, each.names, id(each.owner) in sized) for each in self._spaces())
        types, of_classes = self._types()
        contents = tuple((each.container, each.elements) for each in self._known.contents.values())
        attributes = [(owner, name, value) for owner, name, value, _ in self._known.attributes.values()]
        in_turn = tuple(each for each in attributes if is_of_umo(each[0]))
        others = tuple(each for each in attributes if not is_of_umo(each[0]))
        native = getattr(extension, "Watch", _Watch)
        self.look = native((*spaces, *of_classes), tuple(types), contents, others, in_turn, ABSENT, self._changes).look

    def _spaces(self) -> Iterator[Any]:
        yield from self._known.objects.values()
        known = set(self._known.objects)
        for owner, _ in self._elsewhere:
            if id(owner) not in known:
                yield _Names(owner)

    @staticmethod
    def _space(owner: Any, names: dict[str, Any], complete: bool) -> tuple[Any, ...]:
        kind = None if type(owner) is dict else type(owner)
        size = len(vars(owner)) if complete else -1
        return owner, kind, size, tuple(names), tuple(names.values())

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
                dicts.append(self._space(behind, space.names, complete=False))
        return types, dicts


class _Names:
    """An object of whose attributes only the number counts."""

    def __init__(self, owner: Any) -> None:
        self.owner, self.names = owner, dict[str, Any]()


def is_of_umo(function: Any) -> bool:
    """Whether it is a function of umo or Python itself: nobody is expected to give it other code."""
    return isinstance(function, FunctionType) and is_installed(function.__module__ or "")


def _untouched(kind: type) -> type | None:
    """A class below another one, of which nobody ever looks an attribute up; None: there can be none."""
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
        types: Any,
        contents: Any,
        attributes: Any,
        in_turn: Any,
        absent: object,
        changed: Callable[[], bool],
    ) -> None:
        self._spaces, self._types, self._contents = spaces, types, contents
        self._attributes, self._absent, self._changed = (*attributes, *in_turn), absent, changed

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
            and all(_is_same(elements_of(container), elements) for container, elements in self._contents)
            and all(getattr(owner, name) is value for owner, name, value in self._attributes)
        )

    def _is_space(self, owner: Any, kind: type | None, size: int, names: Any, values: Any) -> bool:
        if kind is not None and type(owner) is not kind:
            return False
        now = owner if kind is None else vars(owner)
        if size >= 0 and len(now) != size:
            return False
        return all(now.get(name, self._absent) is value for name, value in zip(names, values, strict=True))


def _is_same(now: tuple[Any, ...], before: tuple[Any, ...]) -> bool:
    return len(now) == len(before) and all(map(is_, now, before))
