"""The base of parts that are capabilities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

from umo.objects import Compound, Node
from umo.objects.node import outwards


class AttachedPart(Compound):
    """A part that looks at the whole machine: a subclass attaches itself to its period in `attach`. The contract is
    that of `umo.cycle.capability`."""

    def attach(self, machine: Any) -> None:
        """The machine (`umo.cycle.machine.ConnectedMachine`) is laid out; no driver was called yet."""
        raise NotImplementedError(f"{type(self).__name__}.attach")

    def begin(self) -> None:
        """Every object is initialised."""

    def end(self) -> None:
        """The sequences are cancelled; nothing is reset yet."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """This process is to reach no device any longer."""

    @property
    def _root(self) -> Node:
        """The machine."""
        *_, root = outwards(self)
        return root
