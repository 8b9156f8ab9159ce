"""What every object is: a named place in the tree of the machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn, SupportsIndex

from umo.errors import DeclarationError

if TYPE_CHECKING:
    from umo.objects.compound import Compound


class Node:
    """An object with one parent and a path. Base of the atomic objects and of `Compound`."""

    __slots__ = ("__weakref__", "_name", "_parent")

    _name: str
    _parent: Compound | None

    @property
    def path(self) -> str:
        """Where the object is in the machine, without the root: `z.motor`, `axes.0.motor`; the root's is ''."""
        names = []
        node: Node = self
        while node._parent is not None:
            names.append(node._name)
            node = node._parent
        return ".".join(reversed(names))

    def control(self) -> None:
        """Acts once per period; overridden by classes that have something to do. A parent acts before its children."""

    def acknowledge(self) -> bool:
        """Free the actuators of this object that a latched interlock still inhibits though its condition has gone.

        True: none of them is inhibited any more.
        """
        raise NotImplementedError

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        """An object is one place of one machine, so `copy` and `pickle` are refused: DeclarationError."""
        name = f"{self.path} ({type(self).__name__})" if self.path else type(self).__name__
        raise DeclarationError(f"{name} cannot be copied or pickled; declare another one, as machine() does")

    def _adopt(self, parent: Compound, name: str) -> None:
        if self._parent is not None:
            raise DeclarationError(
                f"{type(parent).__name__}.{name} is already {type(self._parent).__name__}.{self._name}: "
                "an object has one parent"
            )
        self._parent = parent
        self._name = name
