"""The names that exist only while a machine runs: signals, tunable numbers, actions and alarms. The path of such a name
is not reported as a misspelt object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from umo.cycle.frame import signals_of, velocities
from umo.errors import PathError
from umo.objects import Compound, actions_of, atoms, numbers_of
from umo.objects.paths import find
from umo.operation.alarms.alarming import declared_alarms
from umo.text import did_you_mean

SIGNAL, TUNABLE, ALARM, ACTION = "a signal", "a tunable number", "an alarm", "an action"
COMMANDS = {
    TUNABLE: "umo tune number {name} {path}",
    ALARM: "umo alarm list {name}",
    ACTION: "umo do {name} call {path}",
}
"""The command for each kind of these names, if it is not `umo device get`."""


def object_of(machine: Compound, path: str, name: str) -> Any:
    """Return the object at a path of a machine that does not run. Raises PathError if there is none. The error has the
    meaning that the path has while the station runs, or the nearest path. `name`: the name of the station."""
    try:
        return find(machine, path)
    except PathError as error:
        known = _names_of(machine)
        if path in known:
            raise PathError(_only_running(path, known[path], name)) from error
        shown = (each for each, what in known.items() if what in (SIGNAL, TUNABLE))
        near = did_you_mean(path, [*(item.path for item in atoms(machine)), *shown])
        raise PathError(f"{str(error).partition(' (did you mean')[0]}{near}") from error


def _only_running(path: str, what: str, name: str) -> str:
    run = f"`umo run {name} --realtime`"
    command = COMMANDS.get(what, "umo device get {name} {path}").format(name=name, path=path)
    return f"{path} is {what}, which exists only while the station runs: start the station ({run}), then `{command}`"


def _names_of(machine: Compound) -> Mapping[str, str]:
    """Return the kind of each path."""
    numbers = numbers_of(machine)
    signals = [*signals_of(numbers), *velocities(list(atoms(machine)))]
    return {
        **dict.fromkeys(actions_of(machine), ACTION),
        **{each.path: ALARM for each in declared_alarms(machine)},
        **{each.path: SIGNAL for each in signals},
        **{path: TUNABLE for path, each in numbers.items() if each.declared.tunable},
    }


def not_an_object(path: str, layout: Any, name: str) -> str:
    """If a path of a running station is an action or an alarm, return a text that says so and names its command;
    otherwise return an empty text."""
    for what, entries in ((ACTION, layout.actions), (ALARM, layout.alarms)):
        if any(each["path"] == path for each in entries):
            return f"{path} is {what}: `{COMMANDS[what].format(name=name, path=path)}`"
    return ""
