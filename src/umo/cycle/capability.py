"""What may be attached to a machine beside objects, laws and sequences: the contract.

A capability has four calls, made in this order:

    attach(machine)  the machine is laid out, no driver was called yet: add to the phases of its period
    begin()          every object is initialised; the first sample follows
    end()            the sequences are cancelled; nothing is reset yet
    refuse(instead)  this process is to reach no device any longer: call `instead`, which does not return, in its place

`attach` may use:

    machine.phases      a list for each phase: `before_tick`, `receiving`, `commanding`, `before_send`, `showing`
    machine.image       `items`, `slot_of`; `columns`: values, pending, quality of all objects by slot
    machine.commands    `watch(call)`: the function is told of each write; `claim(slot)`: who drives it
    machine.clock       `now` and `dt`, s
    machine.directory   actions, numbers, axes, laws by their paths
    machine.events      `add(Event(time, path, text))`
    machine.fault_ends  lists of functions: `noting` are told which equipment has come into fault, before what is under
                        way in it ends; `others` end what they have under way

What is called in a phase is to raise nothing: an error ends the run. What a phase costs is part of every period.
A part of the machine whose class has the four calls is a capability (`umo.capabilities.AttachedPart` is a base). What
it declares in `numbers` and `alarms`, and its actions, are those of any compound: shown, kept, tuned, called. A law
brings one with its class (`_capability`), which is made once, of all the laws that name it, each with its path.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, Protocol

from umo.objects import Compound, walk
from umo.objects.laws import laws_in

CALLS = ("attach", "begin", "end", "refuse")


class Capability(Protocol):
    """What a machine may have beside objects, laws and sequences."""

    def attach(self, machine: Any) -> None:
        """`machine` (`umo.cycle.machine.ConnectedMachine`) is laid out: add to its phases. No driver was called yet."""

    def begin(self) -> None:
        """Every object is initialised; the first sample follows."""

    def end(self) -> None:
        """The sequences are cancelled; nothing is reset yet."""

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """This process is to reach no device any longer: in place of that `instead` is called, which does not
        return."""


def capabilities_in(root: Compound) -> list[Any]:
    """Those that a machine declares: what its laws bring, then its parts, in the order of their declaration."""
    brought: dict[Any, list[tuple[str, Any]]] = {}
    for _, path, law in laws_in(root):
        if (kind := getattr(type(law), "_capability", None)) is not None:
            brought.setdefault(kind, []).append((path, law))
    parts = (node for node in walk(root) if isinstance(node, Compound))
    own = [node for node in parts if all(callable(getattr(type(node), call, None)) for call in CALLS)]
    return [*(kind(laws) for kind, laws in brought.items()), *own]
