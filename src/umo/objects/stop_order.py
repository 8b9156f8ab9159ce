"""The order in which a machine is brought to its safe values."""

from __future__ import annotations

from collections.abc import Iterator

from umo.drivers.contract import Direction
from umo.objects.atomic import Atomic
from umo.objects.compound import Compound
from umo.objects.node import Node
from umo.objects.paths import children, named


def stop_sequence(root: Compound) -> list[Atomic]:
    """Return the machine's actuators in the order in which they are brought to their defaults.

    At every level of the tree, the parts that `stop_order` names come first, in the order given there; the other parts
    follow as declared. Each part is ordered in the same way. The order of a compound further up takes precedence for
    the objects that it names.
    """
    order = dict.fromkeys(_in_order(root))  # of an object that is met twice the first place counts
    return [item for item in order if item.direction is Direction.OUTPUT]


def _in_order(node: Node) -> Iterator[Atomic]:
    """Return the atomic objects in stop order. An object that `stop_order` names appears a second time, among the
    rest."""
    if isinstance(node, Atomic):
        yield node
        return
    assert isinstance(node, Compound)
    for path in node._settings.stop_order:
        for each in named(node, path):
            yield from _in_order(each)
    for child in children(node).values():
        yield from _in_order(child)
