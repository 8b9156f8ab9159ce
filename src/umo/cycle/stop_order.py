"""The order in which a machine is brought to its safe values."""

from __future__ import annotations

from umo.drivers.contract import Direction
from umo.objects import Atomic, Compound


def stop_sequence(root: Compound) -> list[Atomic]:
    """The machine's actuators: those that the root's `stop_order` names, in its order, then the rest as declared."""
    order: dict[int, Atomic] = {}
    for path in root.stop_order:
        node = root.find(path)
        for item in [node] if isinstance(node, Atomic) else node.atoms():  # type: ignore[attr-defined]
            order.setdefault(id(item), item)
    for item in root.atoms():
        order.setdefault(id(item), item)
    return [item for item in order.values() if item.direction is Direction.OUTPUT]
