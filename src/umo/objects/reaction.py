"""Reactions of actuators and axes to a suspension: what becomes of what they do while nobody is in charge of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from umo.objects.node import Node

Reaction = Literal["default", "hold", "run on"]
"""Actuators go to their defaults, or keep their values ("hold" and "run on"). Axes are disabled; stop on their profiles
and stay under control; or their motions go on to their ends (homing and jogs stop)."""
REACTIONS: tuple[Reaction, ...] = ("default", "hold", "run on")
"""Reactions of a compound."""


def declared_reaction(node: Node | None) -> Reaction | None:
    """The reaction that the nearest compound declares, from this node up; None: there is none."""
    while node is not None:
        settings = getattr(node, "_settings", None)
        if settings is not None and settings.when_suspended is not None:
            return settings.when_suspended  # type: ignore[no-any-return]
        node = node._parent
    return None
