"""A state machine as data: its states, and the next states after commands and after the end of sequences."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

CLEAR, ABORT, STOP = "clear", "abort", "stop"
"""Commands that every model has."""
EXECUTE = "execute"
"""Name of the sequence of the state in which a part does its work."""


class UnitMode(IntEnum):
    """The modes of a unit (ISA-TR88.00.02); the numbers are those of PackTags."""

    PRODUCTION = 1
    MAINTENANCE = 2
    MANUAL = 3


@dataclass(frozen=True)
class StateModel:
    """The states of one standard. States are members of one IntEnum."""

    name: str
    first: IntEnum
    """The state when the machine is connected."""
    execute: IntEnum
    """The state in which the part does its work."""
    acting: Mapping[IntEnum, IntEnum]
    """The acting states (in ISA-88: transient states), each with the state that follows when its sequence has ended."""
    commands: Mapping[str, Mapping[IntEnum, IntEnum]]
    """The target of each command, by the states in which the command is possible."""
    waiting: Collection[IntEnum]
    """The states in which the sequence of `execute` waits to be resumed."""
    stopped: IntEnum
    aborting: IntEnum
    aborted: IntEnum
    """The state of equipment in fault."""

    places: Mapping[IntEnum, tuple[int, int]]
    """Column and row of each state in a diagram."""

    def possible(self, state: IntEnum) -> list[str]:
        """Return the commands that are possible in a state."""
        return [name for name, targets in self.commands.items() if state in targets]

    def describe(self) -> dict[str, Any]:
        """Return the model as plain data: states by their numbers."""
        return {
            "model": self.name,
            "states": {str(int(each)): title(each) for each in type(self.first)},
            "places": {str(int(state)): list(place) for state, place in self.places.items()},
            "acting": {str(int(state)): int(then) for state, then in self.acting.items()},
            "commands": {
                name: {str(int(state)): int(then) for state, then in targets.items()}
                for name, targets in self.commands.items()
            },
        }


def title(state: IntEnum) -> str:
    """Return the name of a state as it is shown, such as `unholding`."""
    return state.name.lower().replace("_", " ")


def sequence_name(model: StateModel, state: IntEnum) -> str:
    """Return the name of the method that is the sequence of an acting state."""
    return EXECUTE if state is model.execute else state.name.lower()
