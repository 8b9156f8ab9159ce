"""Checks that are made when a class of states is defined. Without these checks an error would appear only when the
state concerned is reached."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Mapping
from typing import Any

from umo.errors import DeclarationError
from umo.operation.model import ABORT, CLEAR, EXECUTE, STOP, StateModel, UnitMode, sequence_name, title
from umo.text import did_you_mean


def check_sequences(cls: type, model: StateModel) -> None:
    """Check the sequences. Raises DeclarationError for a sequence of an acting state that is not an `async def`
    function, and for a sequence whose name is misspelt, because it would never be called."""
    known = [sequence_name(model, state) for state in model.acting]
    for name, value in vars(cls).items():
        if name in known and not inspect.iscoroutinefunction(value):
            raise DeclarationError(f"{cls.__name__}.{name} must be a sequence: `async def {name}(self)`")
        if name in known or not inspect.iscoroutinefunction(value) or name.startswith("_"):
            continue
        meant = EXECUTE if name == title(model.execute) else did_you_mean(name, known)
        if meant:
            hint = meant if meant.startswith(" ") else f" (did you mean {meant!r}?)"
            raise DeclarationError(f"{cls.__name__}.{name} is not a state of {model.name} with a sequence{hint}")


def check_excluded(cls: type, model: StateModel, excluded: Mapping[Any, Any]) -> None:
    """Check the excluded states. Raises DeclarationError for an object that is not a mode or a state, and for an
    excluded state that every mode must have."""
    led_to = {target for name in (STOP, ABORT, CLEAR) for target in model.commands[name].values()}
    needed = led_to | {model.acting.get(each, each) for each in led_to} | {model.first}
    for mode, states in excluded.items():
        where = f"{cls.__name__}.excluded[{mode!r}]"
        if not isinstance(mode, UnitMode) or not isinstance(states, Collection):
            raise DeclarationError(f"{where}: it must be a UnitMode with a list of states, not {states!r}")
        for state in states:
            if not isinstance(state, type(model.first)):
                raise DeclarationError(f"{where}: {state!r} is not a state of {model.name}")
            if state in needed:
                raise DeclarationError(f"{where}: every mode has the state {title(state)}")
