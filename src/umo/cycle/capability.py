"""The contract of capabilities: what may be attached to a machine in addition to objects, laws and sequences.

A capability has these calls, made in this order:

    attach(machine)  the machine is laid out, no driver was called yet: add to the phases of its period
    begin()          every object is initialised; the first sample follows
    end() the sequences are cancelled; nothing is reset yet; what it raises is told and hinders no reset refuse(instead)
    this process is to reach no device any more: call `instead`, which does not return, in its place

`attach` may use:

    machine.phases      a list for each phase: `before_tick`, `receiving`, `commanding`, `before_send`, `showing`; and
                        `before_laws`, which may replace the laws
    machine.image       `items`, `slot_of`; `columns`: values, pending, quality of all objects by slot; `scales`
    machine.commands    `watch(call)`: the function is told of each write; one that fails is called no more
    machine.claims      `claim(slot)`: who drives an actuator
    machine.clock       `now` and `dt`, s
    machine.directory   actions, numbers, axes, laws by their paths
    machine.events      `add(Event(time, path, text))`
    machine.states what was kept of the last run, or what a recording has: alarms continue with theirs

and, where it carries out what the machine itself would do:

    machine.acting_laws         `replace(laws)`: other functions for the same laws; `leave_out(part)`: it has those
    machine.at_work             the sequences that what is started at this moment joins
    machine.is_manual           whether somebody operates it by hand, in place of the application
    machine.under_way lists of functions: `noting` are told which equipment has come into fault, before what is in
    progress in it ends; `others` end what they have in progress; `before_cancel` are called when the machine stops,
    before its sequences are cancelled machine.facts functions that give facts of the run, as text by their names

A function in a phase must not raise an error, because an error ends the run. What a phase costs is part of every
period.

A machine gets its capabilities in four ways. A part of the machine whose class is a `Capability` is attached
(`umo.operation.capabilities.AttachedPart` is a base). Its `numbers`, `alarms` and actions are shown, kept, tuned and
called like those of any compound. A law brings one with its class (`_capability`), which is made once, of all the laws
that name it, each with its path. A class keyword brings another (`BY_KEYWORD`). A program attaches more to a connected
machine (`machine.attach`), which add to `commanding`, `before_laws` and `showing` only.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NoReturn

from umo.objects import Compound, walk
from umo.objects.laws import laws_in

BY_KEYWORD = {"alarms": "umo.operation.alarms.alarming"}
"""The module whose `attached(root)` gives the capability for a class keyword, or None. The module is imported when a
class has the keyword."""


class Capability:
    """An addition to the objects, laws and sequences of a machine."""

    alarm_rows: int = 0
    """The number of its rows in the column `alarms` of the shown memory (`umo.cycle.columns`). Other values of a part
    are shown as its `numbers`."""

    def attach(self, machine: Any) -> None:
        """`machine` (`umo.cycle.machine.ConnectedMachine`) is laid out, and no driver was called yet; add functions to
        its phases."""
        raise NotImplementedError(f"{type(self).__name__}.attach")

    def begin(self) -> None:
        """Called when every object is initialised, before the first sample."""

    def end(self) -> None:
        """Called when the sequences are cancelled, before anything is reset."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """This process must not use any device from now on: calls of devices are replaced by `instead`, which does not
        return."""


def declared_capabilities(root: Compound) -> list[Capability]:
    """Return the capabilities that a machine declares: by class keywords, by its laws, then its parts, in the order of
    their declaration."""
    compounds = [node for node in (root, *walk(root)) if isinstance(node, Compound)]
    named = (module for word, module in BY_KEYWORD.items() if any(getattr(each._settings, word) for each in compounds))
    brought: dict[Any, list[tuple[str, Any]]] = {}
    for _, path, law in laws_in(root):
        if (kind := getattr(type(law), "_capability", None)) is not None:
            brought.setdefault(kind, []).append((path, law))
    by_laws = [kind(laws) for kind, laws in brought.items()]
    parts: list[Any] = [node for node in compounds if isinstance(node, Capability)]
    return [*filter(None, [import_module(module).attached(root) for module in named]), *by_laws, *parts]
