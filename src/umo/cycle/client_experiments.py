"""Experiments of clients on the loops of laws: actions that no list shows, found when they are asked for.

`zones.3.experiment`: the loop may be named by its law (`heating.3`), its sensor or actuator, or the compound that it
alone is in.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from umo.errors import PathError
from umo.objects import Action, Compound, Node, find
from umo.objects.action import actions_on
from umo.objects.laws import laws_in
from umo.objects.paths import is_within
from umo.text import did_you_mean, some

NAMES = ("experiment", "law")
"""The names of these actions."""


class FoundLoop(NamedTuple):
    """A loop of a law."""

    part: Compound
    """The compound that has the law."""
    path: str
    law: Any
    name: str
    """Its name among `loops` of the law."""
    ends: tuple[Node, ...]
    """Its sensor and its actuator, if the law knows them."""


def loops_in(root: Compound) -> Iterator[FoundLoop]:
    """Every loop of a machine."""
    for part, path, law in laws_in(root):
        if callable(getattr(law.__class__, "experiments", None)) and callable(getattr(law.__class__, "loops", None)):
            for name, ends in law.loops().items():
                nodes = tuple(each for each in ends if isinstance(each, Node))  # the other end may be an inner law
                yield FoundLoop(part, f"{path}.{name}".rstrip("."), law, name, nodes)


def loop_at(root: Compound, place: str) -> FoundLoop:
    """The loop at this path; PathError names the nearest one, or those among which it does not choose."""
    known = {each.path: each for each in loops_in(root)}
    there = f"; there are: {some(list(known))}" if known else "; the machine has none that can be tuned"
    if place in known:
        return known[place]
    try:
        node = find(root, place)
    except PathError:
        raise PathError(f"no law {place!r}{did_you_mean(place, known) or there}") from None
    found = [each for each in known.values() if any(is_within(end, node) for end in (each.part, *each.ends))]
    if not found:
        raise PathError(f"{place} has no law{there}")
    if len(found) > 1:
        raise PathError(f"{place} has several laws; name one: {some([each.path for each in found])}")
    return found[0]


def experiments_on(root: Compound, path: str) -> Mapping[str, Action]:
    """The actions on the loop of which this is one, by their paths; none if the path is not that of such an action.
    PathError for a path that names no law."""
    place, _, name = path.rpartition(".")
    if name not in NAMES or not place:
        return {}
    loop = loop_at(root, place)
    return actions_on(loop.part, place, loop.law.experiments(loop.part, loop.path, loop.name))
