"""The directory of a connected machine: what clients, frames and pages look up by its path. It moves nothing."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol

from umo.cycle.law_loops import Loops
from umo.cycle.restoring import kept_kind
from umo.objects import Action, Actuator, Compound, actions_of, numbers_of, walk
from umo.objects.laws import has_loops, laws_in

DATA = ("builtins", "numpy")
"""Modules whose objects are no laws, but what a law calculates with: nobody but the law is to have them."""


class MotionAxis(Protocol):
    """A compound that is an axis of motion (`umo.control.Axis`): it moves by itself, under its own control."""

    @property
    def _path(self) -> str: ...

    def shown_state(self) -> int:
        """What it does, for frames: the number of one of its states. It raises nothing."""

    def describe_axis(self) -> Mapping[str, Any]:
        """Its path, states, position, limits and actions, as plain data."""

    def _leave(self) -> Any:
        """What it does, to go on with it later (`umo.control.axis.LeftMotion`): it is free for others."""

    def _stop_as_declared(self, left: Any) -> str:
        """Nobody is in charge: the declared reaction, in words; "": nothing changes. `left`: what it has left."""

    def _let_go(self) -> None:
        """It could not be left, or stopped: it is controlled no longer."""

    def _driven(self) -> tuple[Actuator, ...]:
        """What its law is in charge of, also if it has not written it in this period."""


class Book(Protocol):
    """A law from which a client chooses what comes next, such as a book of recipes (`umo.operation.recipe_book`)."""

    def choose(self, name: str, content: str = "") -> str:
        """Choose one by its name."""

    def describe(self) -> Mapping[str, Any]:
        """What can be chosen, as plain data: `fields` (name, unit, bounds) and `recipes` (name, hash, values)."""


class Directory:
    """What one machine has when it is connected."""

    def __init__(self, root: Compound) -> None:
        self._root = root
        self.numbers = numbers_of(root)
        """Its numbers, by path."""
        self.kept = {path: kept_kind(each) for path, each in self.numbers.items() if each.declared.kept}
        """What is kept over a restart, by path: its type as plain data."""
        self.tunables = {path: each for path, each in self.numbers.items() if each.declared.tunable}
        """The numbers that may be changed from outside, by path."""
        self.axes = axes_in(root)
        self.units: list[Any] = []
        """The laws that are states of a part, told by what carries them out (`umo.operation.supervisors`)."""
        self._laws = [each for each in laws_in(root) if type(each[2]).__module__ not in DATA]
        self.laws = [each for each in self._laws if has_loops(each[2])]
        """Its laws with loops, each with the compound that has it and its path."""

    @cached_property
    def actions(self) -> dict[str, Action]:
        """The actions that may be called from outside, by path."""
        return actions_of(self._root)

    def action_at(self, path: str) -> Action | None:
        """An action by its path, also one on a loop. PathError for one on no law."""
        return self.actions.get(path) or self.loops.action(path)

    @cached_property
    def loops(self) -> Loops:
        """The loops of its laws."""
        return Loops(self._root, self.laws)

    @cached_property
    def books(self) -> dict[str, Book]:
        """The laws from which clients choose what comes next, by path."""
        return dict(self.having("choose", "next", "describe"))

    def having(self, *names: str) -> list[tuple[str, Any]]:
        """Its laws whose class has all of these methods, each with its path."""
        found = ((path, law, type(law)) for _, path, law in self._laws)
        return [(path, law) for path, law, kind in found if all(callable(getattr(kind, each, None)) for each in names)]


def axes_in(root: Compound) -> list[MotionAxis]:
    """The axes of a machine, in the order of frames."""
    nodes: list[Any] = [root, *walk(root)]
    return [each for each in nodes if callable(getattr(each.__class__, "describe_axis", None))]
