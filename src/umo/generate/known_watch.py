"""Checks once per period, before the laws act, that the values which translation took as known have not changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from gc import get_referents
from types import FunctionType, MappingProxyType
from typing import Any, TypeAlias

from umo.cycle.conversion import extension
from umo.generate.known_values import ABSENT, KnownName, KnownValues, elements_of, is_installed, same_all
from umo.generate.python_memory import place_of, place_of_version
from umo.objects.atomic import Atomic

Space: TypeAlias = tuple[dict[str, Any], tuple[str, ...], tuple[Any, ...], int]
"""The dict of an object, class or module, names in it, their values (ABSENT if the name does not exist), and the
address of its version; 0 if not known."""
Attribute: TypeAlias = tuple[Any, str, Any, int]
"""An object, the name and value of an attribute, and the address of the reference; 0 if not known."""


class KnownWatch:
    """Watches known values. `changed` is called with the names whose values have changed."""

    def __init__(
        self,
        known: KnownValues,
        changed: Callable[[list[KnownName]], None],
        elsewhere: Sequence[tuple[Any, frozenset[str]]] = (),
    ) -> None:
        """`elsewhere`: objects, each with the names of attributes that are stored outside the object. No code may add
        these names to the object itself."""
        self._known, self._changed, self._elsewhere = known, changed, elsewhere
        self.look: Callable[[], bool] = self._changes
        """Returns True if nothing has changed. It is replaced by a faster check after a renewal."""
        self.on_renewal: Callable[[], None] = lambda: None
        """Called when `look` is replaced."""
        self._changes()

    def _changes(self) -> bool:
        """Compare by value, because something may be another object, and start again. Return True if something has
        changed."""
        found = list(self._known.changes())
        for owner, names in self._elsewhere:
            found += [KnownName(owner, name, None, "", 0) for name in names & vars(owner).keys()]
        if found:
            self._changed(found)
            return False
        self._renew()
        return True

    def _renew(self) -> None:
        """Watch the objects that exist now."""
        spaces, in_turn = self._spaces()
        attributes, rarely = self._attributes()
        contents = tuple((behind(each.container), each.elements) for each in self._known.contents.values())
        given = (*spaces, *in_turn), len(spaces), (*attributes, *rarely), len(attributes), contents
        native = getattr(extension, "Watch", _Watch)
        self.look = native(*given, ABSENT, self._changes).look
        self.on_renewal()

    def _attributes(self) -> tuple[list[Attribute], list[Attribute]]:
        """Return the attributes that are not names in a dict: those checked in each period, and those checked in turn.
        The latter belong to functions of umo and Python, and include the dicts and classes of sensors and actuators."""
        always, in_turn = list[Attribute](), list[Attribute]()
        for owner, name, value, _ in self._known.attributes.values():
            rarely = isinstance(owner, FunctionType) and is_installed(owner.__module__ or "")
            (in_turn if rarely else always).append(_attribute(owner, name, value))
        told = {id(owner): owner for owner, _ in self._elsewhere}
        objects = {key: each.owner for key, each in self._known.objects.items() if not isinstance(each.owner, dict)}
        for owner in (told | objects).values():
            places = in_turn if isinstance(owner, Atomic) else always
            places += [_attribute(owner, "__class__", type(owner)), _attribute(owner, "__dict__", vars(owner))]
        return always, in_turn

    def _spaces(self) -> tuple[list[Space], list[Space]]:
        """Return the names of objects, classes and modules: those checked in each period, and those checked in turn.
        The latter belong to modules of umo and Python, and to sensors and actuators, whose numbers cannot be set."""
        always, in_turn = list[Space](), list[Space]()
        told = {id(owner): (owner, dict.fromkeys(names, ABSENT)) for owner, names in self._elsewhere}
        for key, each in self._known.objects.items():
            _, elsewhere = told.pop(key, (None, {}))
            rarely = isinstance(each.owner, Atomic) or (
                isinstance(each.owner, dict) and is_installed(str(each.owner.get("__name__", "")))
            )
            (in_turn if rarely else always).append(_space(each.now, each.names | elsewhere))
        always += [_space(vars(owner), names) for owner, names in told.values()]
        return always + [_space(behind(each.now), each.names) for each in self._known.classes.values()], in_turn


def _space(names: dict[str, Any], known: dict[str, Any]) -> Space:
    return names, tuple(known), tuple(known.values()), place_of_version(names)


def _attribute(owner: Any, name: str, value: Any) -> Attribute:
    return owner, name, value, place_of(owner, name, value)


def behind(container: Any) -> Any:
    """Return the dict behind a proxy, so that it can be compared element by element."""
    if isinstance(container, MappingProxyType):
        (found,) = get_referents(container)
        return found if type(found) is dict else container
    return container


class _Watch:
    """As umo.cycle._columns.Watch, in Python."""

    def __init__(
        self,
        spaces: Any,
        always: object,
        attributes: Any,
        attributes_always: object,
        contents: Any,
        absent: object,
        changed: Callable[[], bool],
    ) -> None:
        self._spaces, self._attributes, self._contents = spaces, attributes, contents
        self._absent, self._changed = absent, changed

    def look(self) -> bool:
        try:
            same = self._is_all()
        except Exception:  # what can no longer be read is not what it was
            same = False
        return True if same else self._changed()

    def _is_all(self) -> bool:
        return (
            all(self._is_space(*each[:3]) for each in self._spaces)
            and all(getattr(owner, name) is value for owner, name, value, _ in self._attributes)
            and all(same_all(elements_of(container), elements) for container, elements in self._contents)
        )

    def _is_space(self, now: dict[str, Any], names: Any, values: Any) -> bool:
        return all(now.get(name, self._absent) is value for name, value in zip(names, values, strict=True))
