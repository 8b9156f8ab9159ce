"""The loops of the laws of a machine, and the experiments of clients on these loops. The experiments are actions that
appear in no list. Such an action is found when it is requested. In the path of an action, such as `zones.3.experiment`,
the loop may be named by its law (`heating.3`), its sensor or actuator, or a compound that contains no other loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from umo.errors import PathError
from umo.objects import Action, Compound, Node, walk
from umo.objects.action import actions_on
from umo.objects.laws import has_loops, law_named, laws_in, laws_of
from umo.objects.node import outwards
from umo.text import did_you_mean, some

NAMES = ("experiment", "law")
"""The names of the actions on loops."""


class FoundLoop(NamedTuple):
    """A loop of a law."""

    part: Compound
    """The compound that has the law."""
    path: str
    law: Any
    name: str
    """The name of the loop in `loops` of the law."""
    ends: tuple[Node, ...]
    """The sensor and the actuator of the loop, if the law names them."""


class Loops:
    """The present loops of one machine, by the paths of their compounds. Loops that are made later are found by their
    paths and by the compounds that have them. A client's request starts no search."""

    def __init__(self, root: Compound, laws: Iterable[tuple[Compound, str, Any]]) -> None:
        """`laws`: the laws of the machine, each with its compound and its path."""
        self._root = root
        self._objects = {node._path: node for node in walk(root)}
        self._known = [loop for part, path, law in laws for loop in _loops_of(part, path, law)]
        self._around: dict[str, list[FoundLoop]] = {}
        """The loops whose compound, sensor or actuator is at or below a path."""
        for loop in self._known:
            for path in dict.fromkeys(each._path for node in (loop.part, *loop.ends) for each in outwards(node)):
                self._around.setdefault(path, []).append(loop)
        self._actions: dict[str, tuple[Any, Mapping[str, Action]]] = {}
        """The actions that were requested, by path, with the law of each."""
        for loop in self._known[:1]:
            self._on(loop, loop.path)  # what is imported and kept for this takes long at the first time

    @property
    def paths(self) -> list[str]:
        """The paths of the laws that can be tuned."""
        return [each.path for each in self._known]

    def at(self, place: str) -> FoundLoop:
        """Return the loop at this path. Raises PathError with the nearest path or, if several loops fit, with the
        candidates."""
        if (named := self._named(place)) is not None:
            return named
        known = self.paths
        there = f"; there are: {some(known)}" if known else "; the machine has no law that can be tuned"
        node = self._objects.get(place)
        if node is None:
            raise PathError(f"there is no law {place!r}{did_you_mean(place, known) or there}")
        found = {each.path: each for each in self._around.get(place, ())}
        if len(found) == 1:  # another law may be there since
            found = {path: loop for path in found if (loop := self._named(path)) is not None}
        if len(found) <= 1 and isinstance(node, Compound):
            of_node = (each for name, law in laws_of(node) for each in _loops_of(node, f"{place}.{name}", law))
            found |= {each.path: each for each in of_node}
        if not found:
            raise PathError(f"{place} has no law{there}")
        if len(found) > 1:
            raise PathError(f"{place} has several laws; name one: {some(list(found))}")
        return next(iter(found.values()))

    def _named(self, path: str) -> FoundLoop | None:
        """Return the loop that has this path now, or None."""
        place, part = path, None
        while part is None:
            place = place.rpartition(".")[0]
            part = self._objects.get(place) if place else self._root
        if not isinstance(part, Compound):
            return None
        name = path[len(place) + 1 :] if place else path
        for law_name, loop_name in ((name, ""), name.rpartition(".")[::2]):
            law = law_named(part, law_name)
            if has_loops(law) and loop_name in (loops := law.loops()):
                return _found(part, path, law, loop_name, loops[loop_name])
        return None

    def action(self, path: str) -> Action | None:
        """Return the action on a loop that has this path; None if the path is not the path of such an action. Raises
        PathError for a path that names no law."""
        place, _, name = path.rpartition(".")
        if name not in NAMES or not place:
            return None
        return self._on(self.at(place), place)[path]

    def _on(self, loop: FoundLoop, place: str) -> Mapping[str, Action]:
        law, actions = self._actions.get(place, (None, {}))
        if law is not loop.law:  # another one is there since
            actions = actions_on(loop.part, place, loop.law.experiments(loop.part, loop.path, loop.name))
            self._actions[place] = loop.law, actions
        return actions


def _loops_of(part: Compound, path: str, law: Any) -> list[FoundLoop]:
    """Return every loop of the law at a path."""
    loops = law.loops().items() if has_loops(law) else ()
    return [_found(part, f"{path}.{name}".rstrip("."), law, name, ends) for name, ends in loops]


def _found(part: Compound, path: str, law: Any, name: str, ends: Iterable[Any]) -> FoundLoop:
    nodes = tuple(each for each in ends if isinstance(each, Node))  # the other end may be an inner law
    return FoundLoop(part, path, law, name, nodes)


def loop_at(root: Compound, place: str) -> FoundLoop:
    """Return the loop at this path in a machine; raises PathError in the cases of `Loops.at`."""
    return Loops(root, laws_in(root)).at(place)
