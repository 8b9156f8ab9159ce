"""The state on which the verbs of clients act: one connected machine, its lease, its mode, and the clients' holds.

A verb (`umo.operation.commands.verbs`) gets this state as its argument. `umo.operation.commands.client_control` checks
once per period for commands."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from umo.cycle.equipment import Equipment
from umo.cycle.events import CommandState
from umo.cycle.machine import ConnectedMachine
from umo.cycle.sequences import Sequences
from umo.errors import CommandRefused, PathError, TaskFailed
from umo.objects import Actuator, Atomic, Compound, atoms, walk
from umo.operation.commands.client_actions import ClientActions
from umo.operation.commands.client_commands import (
    DEAD_MAN_REASON,
    ClientCommand,
    Commanding,
    Inbox,
    Lease,
    Levels,
    Mode,
)
from umo.operation.commands.suspension import Suspension

log = logging.getLogger("umo")

VerbAnswer = tuple[CommandState, str]
"""The answer to a command: its state, and its content as JSON, or "" if there is none."""
DONE: VerbAnswer = CommandState.DONE, ""
BEGUN: VerbAnswer = CommandState.BEGUN, ""


class Commanded(Commanding):
    """A connected machine that clients command. `clock`: the clock of the heartbeats, in s."""

    def __init__(
        self,
        inbox: Inbox,
        levels: Levels,
        mode: Mode = Mode.AUTOMATIC,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.inbox, self.levels, self.clock = inbox, levels, clock
        self.lease = Lease()
        self.mode = mode
        self._changing: ClientCommand | None = None
        """The change to automatic mode that has begun: `on_resume` runs."""

    def attach(self, machine: ConnectedMachine) -> None:
        self.machine = machine
        self._objects: dict[str, Atomic | Compound] = {
            node._path: node for node in (machine.root, *walk(machine.root)) if isinstance(node, Atomic | Compound)
        }
        """The objects by path; "" means the machine."""
        self._actuators = {item.path: item for item in atoms(machine.root) if isinstance(item, Actuator)}
        self.actions = ClientActions(machine)
        (
            machine.parts.of(machine.root).actuators,
            machine.directory.actions,
            machine.directory.loops,
        )  # known from now on: they take long
        self.suspension = Suspension(machine)
        machine.sequences.paused = machine.is_manual = self.mode is Mode.MANUAL
        machine.under_way.others.append(self.end_in)
        machine.under_way.before_cancel.append(self.cancel)

    # What a verb asks for ------------------------------------------------------------------------------

    def object(self, path: str) -> Atomic | Compound:
        """Return the object at a path. Raises PathError if there is none."""
        found: Atomic | Compound = known(self._objects, path, "object", f" in {type(self.machine.root).__name__}")
        return found

    def actuator(self, path: str) -> Actuator:
        """Return the actuator at a path. Raises PathError if there is none."""
        found: Actuator = known(self._actuators, path, "actuator")
        return found

    def check_manual(self, what: str) -> None:
        """Raise CommandRefused in automatic mode. `what`: the subject and verb of the message, such as "z.jog can be
        called"."""
        if self.mode is not Mode.MANUAL:
            raise CommandRefused(
                f"{what} in manual mode only; the machine runs in automatic mode "
                '(change it: `umo do STATION mode manual`, in Python `station.mode = "manual"`)'
            )

    def last_sign(self, path: str, lasts: float) -> float:
        """Return the time of the last heartbeat for the hold of a command, or for the lease if that is later: the
        former holder of the lease may have written over the heartbeat at the path. Raises CommandRefused if this time
        is too long ago, because in a long period the client may have died after it sent the command."""
        signed = max(self.levels.signed(path, self.lease.number), self.lease.signed)
        if not 0.0 <= self.clock() - signed <= lasts:
            raise CommandRefused(f"{path}: {DEAD_MAN_REASON}: no heartbeat from its client for {lasts:g} s")
        return signed

    # The lease and the mode ----------------------------------------------------------------------------

    def end_lease(self, why: str) -> None:
        """End the lease and all holds under it."""
        self.actions.drop(why)
        self.lease.end()
        if self.mode is Mode.MANUAL:
            self.suspension.lease_ended()

    def change_mode(self, mode: Mode, command: ClientCommand) -> VerbAnswer:
        """Change the mode. The answer is BEGUN if `on_resume` runs before the mode is automatic. Raises CommandRefused
        if the application cannot continue."""
        if mode is self.mode:
            if self._changing is not None:
                raise CommandRefused("the change to automatic mode has not ended yet")
            return DONE
        if mode is Mode.AUTOMATIC:
            self.suspension.check()
        why = f"the mode has changed to {mode}"
        self.actions.drop(why)
        if mode is Mode.MANUAL:
            self._end_change(CommandState.CANCELLED, why)
            self._suspend()
            return DONE
        try:
            begun = self.suspension.end()
        except BaseException:  # a device that did not accept a value
            self._suspend()
            raise
        self.mode, self.machine.is_manual = mode, False
        if not begun:
            return DONE
        self._changing = command
        return BEGUN

    def _suspend(self) -> None:
        self.mode, self.machine.is_manual = Mode.MANUAL, True
        self.suspension.begin()

    def resume(self, resuming: Sequences) -> None:
        """Run the sequences that must end before the application continues. Return to manual mode if one fails."""
        error = self.actions.within(resuming, self.suspension.advance)
        if error is not None:
            text = f"back to manual mode: on_resume failed: {error}"
            log.warning("%s", text)
            self.actions.note(text)
            self._end_change(CommandState.FAILED, text)
            self._suspend()
        elif self.suspension.resuming is None:
            self._end_change(CommandState.DONE, "")

    def _end_change(self, state: CommandState, text: str) -> None:
        """The change to automatic mode has ended, if one had begun."""
        command, self._changing = self._changing, None
        if command is not None:
            self.actions.tell(command, state, text)

    # Ends ----------------------------------------------------------------------------------------------

    def cancel(self) -> None:
        """Cancel running actions and sequences because the machine stops. Raises TaskFailed with the first error of the
        `finally` blocks."""
        self.suspension.cancel()
        self._end_change(CommandState.CANCELLED, "the machine stops")
        if errors := self.actions.cancel("the machine stops"):
            raise TaskFailed(str(errors[0]))

    def end_in(self, equipment: Equipment, fault: Callable[[], BaseException]) -> list[BaseException]:
        """End the actions and sequences of one equipment, and return the errors of their `finally` blocks."""
        self.suspension.forget(equipment.compound)
        resuming = self.suspension.resuming
        errors = [] if resuming is None else resuming.end_in(equipment.nodes, fault)
        return errors + self.actions.end_in(equipment, fault)


def known(table: Mapping[str, Any], path: str, what: str, where: str = "") -> Any:
    """Return the entry of a table for this path. Raises PathError if there is none; the client suggests the nearest
    path."""
    if path not in table:
        raise PathError(f"there is no {what} {path!r}{where}")
    return table[path]
