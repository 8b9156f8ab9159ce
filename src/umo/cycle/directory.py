"""The directory of a connected machine: everything that clients, frames and pages look up by path. It does not call
drivers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol

from umo.cycle.law_loops import Loops
from umo.cycle.restoring import kept_kind
from umo.objects import Action, Actuator, Compound, actions_of, numbers_of, walk
from umo.objects.laws import has_loops, laws_in

DATA = ("builtins", "numpy")
"""The modules whose objects are not laws, but data for the law that has them."""


class MotionAxis(Protocol):
    """A compound that is an axis of motion (`umo.control.Axis`): it moves by itself and controls its motion."""

    @property
    def _path(self) -> str: ...

    def shown_state(self) -> int:
        """Return the state of the axis for frames, as the number of one of its states. The function must not raise an
        error."""

    def describe_axis(self) -> Mapping[str, Any]:
        """Return the path, states, position, limits and actions of the axis, as plain data."""

    def _leave(self) -> Any:
        """Store the motion of the axis, so that it can continue later, and free the axis for other work. Return the
        stored motion (`umo.control.axis.LeftMotion`)."""

    def _stop_as_declared(self, left: Any) -> str:
        """Carry out the declared reaction, because nothing controls the part any more. Return the reaction as a text;
        "" if nothing changes. `left`: the motion that `_leave` has stored."""

    def _let_go(self) -> None:
        """Stop controlling the part, because leaving or stopping it has failed."""

    def _driven(self) -> tuple[Actuator, ...]:
        """Return the actuators that the law of the axis controls, including those not written in this period."""


class Book(Protocol):
    """A law that offers recipes from which a client chooses one for the next batch (`umo.operation.recipe_book`)."""

    def choose(self, name: str, content: str = "") -> str:
        """Choose a recipe by its name."""

    def describe(self) -> Mapping[str, Any]:
        """Return the choices as plain data: `fields` (name, unit, bounds) and `recipes` (name, hash, values)."""


class Directory:
    """The parts of a connected machine."""

    def __init__(self, root: Compound) -> None:
        self._root = root
        self.numbers = numbers_of(root)
        """The numbers of the machine, by path."""
        self.kept = {path: kept_kind(each) for path, each in self.numbers.items() if each.declared.kept}
        """The values that are kept across a restart: the type of each as plain data, by path."""
        self.tunables = {path: each for path, each in self.numbers.items() if each.declared.tunable}
        """The numbers that may be changed from outside, by path."""
        self.axes = axes_in(root)
        self.units: list[Any] = []
        """The laws that implement the states of a part. The list is set by `umo.operation.supervisors`."""
        self._laws = [each for each in laws_in(root) if type(each[2]).__module__ not in DATA]
        self.laws = [each for each in self._laws if has_loops(each[2])]
        """The laws of the machine that have loops, each with the compound that has it and its path."""

    @cached_property
    def actions(self) -> dict[str, Action]:
        """The actions that may be called from outside, by path."""
        return actions_of(self._root)

    def action_at(self, path: str) -> Action | None:
        """Return an action by its path; the action may belong to a loop. Raises PathError if the path names no law."""
        return self.actions.get(path) or self.loops.action(path)

    @cached_property
    def loops(self) -> Loops:
        """The loops of the laws of the machine."""
        return Loops(self._root, self.laws)

    @cached_property
    def books(self) -> dict[str, Book]:
        """The laws that offer recipes to clients, by path."""
        return dict(self.having("choose", "next", "describe"))

    def having(self, *names: str) -> list[tuple[str, Any]]:
        """Return the laws whose class has all of these methods, each with its path."""
        found = ((path, law, type(law)) for _, path, law in self._laws)
        return [(path, law) for path, law, kind in found if all(callable(getattr(kind, each, None)) for each in names)]


def axes_in(root: Compound) -> list[MotionAxis]:
    """Return the axes of a machine, in the order of frames."""
    nodes: list[Any] = [root, *walk(root)]
    return [each for each in nodes if callable(getattr(each.__class__, "describe_axis", None))]
