"""The base of every object: a named place in the tree of the machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NoReturn, SupportsIndex

from umo.errors import DeclarationError
from umo.objects.attributes import DeclaredAttributes
from umo.states import is_plain, shown
from umo.text import some


class Node(DeclaredAttributes):
    """An object with one parent and a path. Base of the atomic objects and of `Compound`.

    A node is equal only to itself. A comparison with a number, a string or a state raises TypeError, which names what
    to compare instead."""

    __slots__ = ("__weakref__", "_name", "_parent")

    _name: str
    _parent: Node | None
    _children: Mapping[str, Node] = MappingProxyType({})

    @property
    def _path(self) -> str:
        """The place of the object in the machine, without the root: `z.motor`, `axes.0.motor`; the root's is ''."""
        names = []
        node: Node = self
        while node._parent is not None:
            names.append(node._name)
            node = node._parent
        return ".".join(reversed(names))

    if not TYPE_CHECKING:  # typed, mypy would not look at `m.valve == 1`

        def __eq__(self, other):
            if self is not other and is_plain(other):
                raise TypeError(self._compared("==", other))
            return True if self is other else NotImplemented

        def __lt__(self, other):
            raise TypeError(self._compared("<", other))

        def __le__(self, other):
            raise TypeError(self._compared("<=", other))

        def __gt__(self, other):
            raise TypeError(self._compared(">", other))

        def __ge__(self, other):
            raise TypeError(self._compared(">=", other))

        __hash__ = object.__hash__

    def _compared(self, sign: str, other: object) -> str:
        """Return why the object cannot be compared with a value, and what to write instead."""
        name = self._path or type(self).__name__
        return f"`{name} {sign} {shown(other)}` compares an object, not a value; {self._meant(name, sign, other)}"

    def _meant(self, name: str, sign: str, other: object) -> str:
        """Return what to write instead of such a comparison."""
        return (
            f"a {type(self).__name__} has no value: compare the value of an object in it ({some(list(self._children))})"
        )

    def control(self) -> None:
        """Override this method to implement control. It is called once per period, for a parent before its children."""

    def acknowledge(self) -> bool:
        """Acknowledge latched interlocks: free the actuators of this object if the conditions that inhibited them are
        no longer true.

        Return True if none of the object's actuators is inhibited any more.
        """
        raise NotImplementedError

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        """Make `copy` and `pickle` raise DeclarationError, because an object belongs to one place in one machine."""
        name = f"{self._path} ({type(self).__name__})" if self._path else type(self).__name__
        raise DeclarationError(f"{name} cannot be copied or pickled; call machine() to declare another one")

    def _adopt(self, parent: Node, name: str) -> None:
        if self._parent is not None:
            raise DeclarationError(
                f"{type(parent).__name__}.{name} is already {type(self._parent).__name__}.{self._name}: "
                "an object has one parent"
            )
        self._parent = parent
        self._name = name


def outwards(node: Node | None) -> Iterator[Node]:
    """Return an object and the compounds around it, the innermost first."""
    while node is not None:
        yield node
        node = node._parent
