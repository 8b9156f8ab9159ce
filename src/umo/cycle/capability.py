"""What may be attached to a machine beside objects, laws and sequences: the contract.

A capability has these calls, made in this order:

    attach(machine)  the machine is laid out, no driver was called yet: add to the phases of its period
    begin()          every object is initialised; the first sample follows
    end()            the sequences are cancelled; nothing is reset yet; what it raises is told and hinders no reset
    refuse(instead)  this process is to reach no device any longer: call `instead`, which does not return, in its place

`attach` may use:

    machine.phases      a list for each phase: `before_tick`, `receiving`, `commanding`, `before_send`, `showing`; and
                        `before_laws`, which may replace the laws
    machine.image       `items`, `slot_of`; `columns`: values, pending, quality of all objects by slot; `scales`
    machine.commands    `watch(call)`: the function is told of each write; one that fails is called no more
    machine.claims      `claim(slot)`: who drives an actuator
    machine.clock       `now` and `dt`, s
    machine.directory   actions, numbers, axes, laws by their paths
    machine.events      `add(Event(time, path, text))`
    machine.states      what was kept of the last run, or what a recording has: alarms go on with theirs

and, where it carries out what the machine itself would do:

    machine.acting_laws         `replace(laws)`: other functions for the same laws; `leave_out(part)`: it has those
    machine.at_work             the sequences that what is started at this moment joins
    machine.is_manual           whether somebody operates it by hand, in place of the application
    machine.under_way           lists of functions: `noting` are told which equipment has come into fault, before what
                                is under way in it ends; `others` end what they have under way; `before_cancel` are
                                called when the machine stops, before its sequences are cancelled
    machine.facts               functions that give facts of the run, in words by their names

What is called in a phase is to raise nothing: an error ends the run. What a phase costs is part of every period.

A machine gets its capabilities in four ways. A part of it whose class is a `Capability` is one
(`umo.capabilities.AttachedPart` is a base); what it declares in `numbers` and `alarms`, and its actions, are those of
any compound: shown, kept, tuned, called. A law brings one with its class (`_capability`), which is made once, of all
the laws that name it, each with its path. A class keyword brings another (`BY_KEYWORD`). A program attaches more to a
connected machine (`machine.attach`), which add to `commanding`, `before_laws` and `showing` only.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NoReturn

from umo.objects import Compound, walk
from umo.objects.laws import laws_in

BY_KEYWORD = {"alarms": "umo.alarms.alarming"}
"""The module whose `attached(root)` gives the capability for a class keyword, or None: imported where a class has
that."""


class Capability:
    """What a machine may have beside objects, laws and sequences."""

    alarm_rows: int = 0
    """The number of its rows in the column `alarms` of the shown memory (`umo.cycle.columns`). What else is to be shown
    of a part is one of its `numbers`."""

    def attach(self, machine: Any) -> None:
        """`machine` (`umo.cycle.machine.ConnectedMachine`) is laid out: add to its phases. No driver was called yet."""
        raise NotImplementedError(f"{type(self).__name__}.attach")

    def begin(self) -> None:
        """Every object is initialised; the first sample follows."""

    def end(self) -> None:
        """The sequences are cancelled; nothing is reset yet."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """This process is to reach no device any longer: in place of that `instead` is called, which does not
        return."""


def declared_capabilities(root: Compound) -> list[Capability]:
    """Those that a machine declares: by class keywords, by its laws, then its parts, in the order of their
    declaration."""
    compounds = [node for node in (root, *walk(root)) if isinstance(node, Compound)]
    named = (module for word, module in BY_KEYWORD.items() if any(getattr(each._settings, word) for each in compounds))
    brought: dict[Any, list[tuple[str, Any]]] = {}
    for _, path, law in laws_in(root):
        if (kind := getattr(type(law), "_capability", None)) is not None:
            brought.setdefault(kind, []).append((path, law))
    by_laws = [kind(laws) for kind, laws in brought.items()]
    parts: list[Any] = [node for node in compounds if isinstance(node, Capability)]
    return [*filter(None, [import_module(module).attached(root) for module in named]), *by_laws, *parts]
