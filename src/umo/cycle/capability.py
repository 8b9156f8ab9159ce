"""The contract of capabilities: parts that may be attached to a machine in addition to objects, laws and sequences.

umo makes these calls of a capability, in this order:

    attach(machine)  Add functions to the phases of the period. The machine is laid out, no driver was called yet.
    begin()          Every object is initialised; the first sample follows.
    end()            The sequences are cancelled; nothing is reset yet. An error that `end` raises is reported and
                     prevents no reset.
    refuse(instead)  This process must reach no device any more: in place of every call of a device, call `instead`,
                     which does not return.

`attach` may use:

    machine.phases      a list for each phase: `before_tick`, `receiving`, `commanding`, `before_send`, `showing`; and
                        `before_laws`, which may replace the laws
    machine.image       `items`, `slot_of`; `columns`: values, pending, quality of all objects by slot; `scales`
    machine.commands    `watch(call)`: the function is called for each write; a function that fails is no longer called
    machine.claims      `claim(slot)`: the claim in force for an actuator
    machine.clock       `now` and `dt`, s
    machine.directory   actions, numbers, axes, laws by their paths
    machine.events      `add(Event(time, path, text))`
    machine.states      the states that the last run has kept, or those in a recording: alarms continue from these

A capability that carries out work in place of the machine may also use:

    machine.acting_laws  `replace(laws)`: call other functions for the same laws; `leave_out(part)`: do not call the
                         laws of this part, which the capability carries out
    machine.at_work      the group of sequences that a sequence joins if it is started now
    machine.is_manual    whether clients operate the machine in place of the application
    machine.under_way    lists of functions: `noting` are called with the equipment that has entered a fault, before the
                         work in it ends; `others` end the work of the capability; `before_cancel` are called when the
                         machine stops, before its sequences are cancelled
    machine.facts        functions that return facts of the run as text, by their names

A function in a phase must not raise an error, because an error ends the run. The time that a phase takes is part of
every period.

A machine gets its capabilities in four ways:

- A part of the machine whose class is a `Capability` is attached (`umo.operation.capabilities.AttachedPart` is a base).
  Its `numbers`, `alarms` and actions are shown, kept, tuned and called like those of any compound.
- The class of a law names a capability (`_capability`). It is made once, from all the laws that name it, each with its
  path.
- A class keyword adds a capability (`BY_KEYWORD`).
- A program attaches a capability to a connected machine (`machine.attach`). It may add only to `commanding`,
  `before_laws` and `showing`.
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
    """The number of its rows in the column `alarms` of the shown memory (`umo.cycle.columns`). Other values of a
    capability that is a part are shown as its `numbers`."""

    def attach(self, machine: Any) -> None:
        """Add functions to the phases of `machine` (`umo.cycle.machine.ConnectedMachine`), which is laid out. No driver
        was called yet."""
        raise NotImplementedError(f"{type(self).__name__}.attach")

    def begin(self) -> None:
        """Begin. Called when every object is initialised, before the first sample."""

    def end(self) -> None:
        """End. Called when the sequences are cancelled, before anything is reset."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Use no device from now on: replace calls of devices by `instead`, which does not return."""


def declared_capabilities(root: Compound) -> list[Capability]:
    """Return the capabilities that a machine declares: first those of class keywords, then those of its laws, then its
    parts, each in the order of declaration."""
    compounds = [node for node in (root, *walk(root)) if isinstance(node, Compound)]
    named = (module for word, module in BY_KEYWORD.items() if any(getattr(each._settings, word) for each in compounds))
    brought: dict[Any, list[tuple[str, Any]]] = {}
    for _, path, law in laws_in(root):
        if (kind := getattr(type(law), "_capability", None)) is not None:
            brought.setdefault(kind, []).append((path, law))
    by_laws = [kind(laws) for kind, laws in brought.items()]
    parts: list[Any] = [node for node in compounds if isinstance(node, Capability)]
    return [*filter(None, [import_module(module).attached(root) for module in named]), *by_laws, *parts]
