"""What a machine has only while it runs: signals, tunable numbers, actions and alarms, so that a path of one is not
taken for a misspelt object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from umo.alarms.alarming import declared_alarms
from umo.cycle.frame import signals_of, velocities
from umo.errors import PathError
from umo.objects import Compound, actions_of, atoms, numbers_of
from umo.objects.paths import find
from umo.text import did_you_mean

SIGNAL, TUNABLE, ALARM, ACTION = "a signal", "a tunable number", "an alarm", "an action"
COMMANDS = {TUNABLE: "umo tune {name} {path}", ALARM: "umo alarms {name}", ACTION: "umo call {name} {path}"}
"""The command that is for each of them, where it is not `umo get`."""


def object_of(machine: Compound, path: str, name: str) -> Any:
    """The object at a path of a machine that does not run. PathError where there is none: with what the path is while
    the station runs, or the nearest of all that there is. `name`: of the station."""
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
    command = COMMANDS.get(what, "umo get {name} {path}").format(name=name, path=path)
    return f"{path} is {what}, which is there only while the station runs: start it ({run}), then `{command}`"


def _names_of(machine: Compound) -> Mapping[str, str]:
    """What each path is."""
    numbers = numbers_of(machine)
    signals = [*signals_of(numbers), *velocities(list(atoms(machine)))]
    return {
        **dict.fromkeys(actions_of(machine), ACTION),
        **{each.path: ALARM for each in declared_alarms(machine)},
        **{each.path: SIGNAL for each in signals},
        **{path: TUNABLE for path, each in numbers.items() if each.declared.tunable},
    }


def not_an_object(path: str, layout: Any, name: str) -> str:
    """What a path of a running station is, if an action or an alarm, and the command for it; else empty."""
    for what, entries in ((ACTION, layout.actions), (ALARM, layout.alarms)):
        if any(each["path"] == path for each in entries):
            return f"{path} is {what}: `{COMMANDS[what].format(name=name, path=path)}`"
    return ""
