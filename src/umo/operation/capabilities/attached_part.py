"""The base of parts that are capabilities."""

from __future__ import annotations

from umo.cycle.capability import Capability
from umo.objects import Compound, Node
from umo.objects.node import outwards


class AttachedPart(Capability, Compound):
    """A part that works on the whole machine: in `attach`, a subclass attaches itself to the period of the machine. The
    contract is that of `umo.cycle.capability`."""

    @property
    def _root(self) -> Node:
        """The machine."""
        *_, root = outwards(self)
        return root
