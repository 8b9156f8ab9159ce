"""The suspension of actuators and axes while nothing controls them.

The work of the application is suspended when the mode becomes manual. The actuators and axes that the holder of a lease
still drives are suspended when the lease ends in manual mode. Each suspended compound is notified (`on_suspend`), axes
react as declared, and the laws run once more. An actuator that is then not at its default goes to its default, unless a
law or `on_suspend` has written it, a client holds it, or it is declared to hold its value. At the change back to
automatic mode the state that the application had left is restored, or the change is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from umo.cycle.columns import ASKED, FREE
from umo.cycle.directory import MotionAxis
from umo.cycle.events import Event, Paths
from umo.cycle.sequences import Sequences, one_period
from umo.cycle.to_defaults import ToDefault
from umo.errors import CommandRefused
from umo.objects import Actuator, Atomic, Compound, Node, atoms, walk
from umo.objects.paths import is_within
from umo.text import some
from umo.user_code import Raised, attempt

if TYPE_CHECKING:
    from umo.cycle.machine import ConnectedMachine


T = TypeVar("T")

STOPPED = "to the default"
"""The text for actuators that nothing controls."""
MANUAL = "manual mode"
"""Beginning of the event of a suspended application."""


class Suspension:
    """The suspensions of one connected machine."""

    def __init__(self, machine: ConnectedMachine) -> None:
        root, self._machine = machine.root, machine
        compounds = [root, *(node for node in walk(root) if isinstance(node, Compound))]
        self._told = [node for node in compounds if type(node).on_suspend is not Compound.on_suspend]
        self._resuming = [node for node in compounds if type(node).on_resume is not Compound.on_resume]
        self._axes = machine.directory.axes
        self._left_motions: dict[MotionAxis, Any] = {}
        """The motions that the application has left (`umo.control.axis.LeftMotion`)."""
        self._lost_motions: dict[MotionAxis, Any] = {}
        """The motions of the application that faults have ended."""
        self._actuators = {slot: cast(Actuator, machine.image.items[slot]) for slot in machine.claims.order}
        """The actuators by slot, in stop order."""
        self._order = np.array(machine.claims.order, np.intp)
        """The slots of these actuators."""
        self._defaults = machine.image.scales.defaults[self._order]
        self._holding = {slot for slot, item in self._actuators.items() if item._holds}
        """The actuators that are declared to hold."""
        self._by_others: set[int] = set()
        """The actuators that `on_suspend` and actions have written in this period."""
        self._failed: set[int] = set()
        """The actuators of compounds whose `on_suspend` failed."""
        self._cause = ""
        self._said: list[str] = []
        self.resuming: Sequences | None = None
        """The sequences of `on_resume`, while they run."""
        machine.sequences.end_within = self._end_within

    @property
    def _left(self) -> dict[int, float] | None:
        """Return the values that the application has left, by slot, without those of laws; None if it is not
        suspended."""
        return self._machine.claims.left.get(self)

    # Nobody is in charge -------------------------------------------------------------------------------

    def begin(self) -> None:
        """Suspend the application, because the mode becomes manual. This function raises no error."""
        self.cancel()
        self._machine.sequences.paused = True
        self._note_writes(MANUAL)
        if self._left is None:
            pending = self._machine.image.columns.pending[self._order]
            self._machine.claims.left[self] = dict(zip(self._actuators, pending.tolist(), strict=True))
            for axis in self._axes:
                if (left := self._ask(axis, axis._leave)) is not None:
                    self._left_motions[axis] = left
        for node in self._told:
            _, error = attempt(node.on_suspend)
            if error is not None:
                self._tell(f"{node._path}.on_suspend".lstrip("."), f"failed: {error}")
                slot_of = self._machine.image.slot_of
                self._failed.update(slot_of[id(item)] for item in atoms(node) if isinstance(item, Actuator))
        self._react()

    def lease_ended(self) -> None:
        """Handle the end of the lease in manual mode: actuators of its holder go to their defaults."""
        self._note_writes("the lease has ended")
        self._react()

    def commands_taken(self) -> None:
        """Note that the writes of this period until now come from `on_suspend` and actions, not from laws."""
        noted = self._machine.commands.noted
        if noted is not None:
            self._by_others |= noted
            noted.clear()

    def _note_writes(self, cause: str) -> None:
        """Note the writes of this period until its laws have acted."""
        self._cause = cause
        machine = self._machine
        if machine.commands.noted is None:
            machine.commands.note_writes(True)
        machine.phases.settle_once(self._settle)

    def _react(self) -> None:
        for axis in self._axes:
            if words := self._ask(axis, partial(axis._stop_as_declared, self._left_motions.get(axis))):
                self._said.append(f"{axis._path} {words}")

    def _ask(self, axis: MotionAxis, what: Callable[[], T]) -> T | None:
        """Return the answer of an axis. An axis that raises an error is disabled, and the others are still
        suspended."""
        answer, error = attempt(what)
        if error is not None:
            attempt(axis._let_go)
            self._tell(axis._path, f"disabled, as it could not be suspended: {error}")
        return cast("T | None", answer)

    def _settle(self) -> None:
        """Bring actuators that nothing controls to their defaults, after the laws have acted."""
        image, commands = self._machine.image, self._machine.commands
        noted, by_others, failed = commands.noted, self._by_others - self._failed, self._failed
        if noted is None:  # the application has gone on in the same period
            return
        by_laws = noted | {image.slot_of[id(item)] for axis in self._axes for item in axis._driven()}
        self._stop_noting()
        for slot in by_laws:
            (self._left or {}).pop(slot, None)
        found: dict[str, list[int]] = {what: [] for what in (STOPPED, "held", "its law writes", "just written")}
        for slot in self._away_from_defaults():
            if self._machine.claims.client_of(slot):
                continue
            if slot in by_laws:
                what = "its law writes"
            elif slot in by_others:
                what = "just written"
            elif slot in self._holding and slot not in failed:
                what = "held"
            else:
                what = STOPPED
            found[what].append(slot)
        image.settle(found[STOPPED], ToDefault.SEND)
        self._tell_what_drives(found)

    def _away_from_defaults(self) -> list[int]:
        """The actuators whose pending value is another than their default, in stop order."""
        pending = self._machine.image.columns.pending[self._order]
        away: list[int] = self._order[pending != self._defaults].tolist()
        return away

    def _stop_noting(self) -> None:
        self._machine.commands.note_writes(False)
        self._by_others, self._failed = set(), set()

    def _tell_what_drives(self, found: dict[str, list[int]]) -> None:
        axes, self._said = self._said, []
        if axes or found[STOPPED] or (any(found.values()) and self._cause == MANUAL):
            machine = self._machine
            told = partial(_what_drives, machine.clock.now, self._cause, axes, found, machine.image.items)
            machine.events.add(told)

    def _end_within(self, end: Callable[[], Any]) -> Any:
        """Sequences of the application are cancelled. The values that they write in their `finally` blocks replace
        those that the application has left; for an actuator that a client holds, the default does. The values before
        are not restored."""
        commands, left = self._machine.commands, self._left
        if left is None:
            return end()
        before = commands.noted
        commands.note_writes(True)
        try:
            return end()
        finally:
            written = commands.noted or set()
            commands.note_writes(before is not None)
            if before is not None:
                commands.noted = before | written
            for slot in written & left.keys():
                if self._machine.claims.client_of(slot):
                    del left[slot]
                else:
                    left[slot] = self._machine.image.pending[slot]

    def forget(self, compound: Compound) -> None:
        """Note that equipment is in fault: the motions of its axes have ended, and are not continued."""
        for axis in [each for each in self._left_motions if is_within(cast(Node, each), compound)]:
            self._lost_motions[axis] = self._left_motions.pop(axis)

    # The application goes on ---------------------------------------------------------------------------

    def check(self) -> None:
        """Check a change to automatic mode. Raises CommandRefused if the application cannot continue from the present
        state. The error has each reason with what to do."""
        faults = (each.error() for each in self._machine.equipment.all if each.in_fault and each.in_manual_only)
        found = [f"{error}; clear it" for error in faults]
        found += [reason for left in self._left_motions.values() if (reason := left.why_not())]
        restrictions = self._machine.image.restrictions
        for slot, value in self._changed().items():
            if restrictions[slot] in (FREE, ASKED):
                continue
            item = self._actuators[slot]
            if value != item._default_value() and not self._machine.claims.client_of(slot) and (why := item.inhibited):
                found.append(f"{item.path} is inhibited: {why}; remove the cause in manual mode")
        if lost := [
            f"{axis._path} was in fault: its motion has ended"
            for axis, left in self._lost_motions.items()
            if left.is_lost()
        ]:
            raise CommandRefused(f"the application cannot continue: {some(lost)}; stop the run, and start it again")
        if found:
            raise CommandRefused(f"the application cannot continue: {some(found)}, or stop the run")

    def _changed(self) -> dict[int, float]:
        """The values that the application has left, for the actuators that have another value now, the last of the stop
        order first."""
        pending = self._machine.image.pending
        changed = {slot: left for slot, left in (self._left or {}).items() if left != pending[slot]}
        place = self._machine.claims.place
        return {slot: changed[slot] for slot in sorted(changed, key=place.__getitem__, reverse=True)}

    def end(self) -> bool:
        """End the suspension, because the mode becomes automatic: restore the state of the application, run
        `on_resume`, then let the application continue. Return whether there is an `on_resume` to run."""
        if self._left is None:  # it has not begun yet
            self._note_writes("automatic mode")
            self._react()
            self._machine.sequences.paused = False
            return False
        if self._machine.commands.noted is not None:
            self._stop_noting()
        changed = self._changed()
        self._machine.commands.go_on(changed)
        for left in self._left_motions.values():
            left.restore()
        self.resuming = self._machine.sequences.others()
        if changed:
            self.resuming.start(_sent())
        nodes = [node for node in self._resuming if self._machine.equipment.fault_of(node) is None]
        for node in nodes:
            self.resuming.start(_resumed(node), node)
        return bool(nodes)

    def advance(self) -> Raised | None:
        """Advance the sequences of `on_resume` by one step. Return the reason if one of them failed."""
        assert self.resuming is not None
        _, error = attempt(self.resuming.advance, self._machine.clock)
        if error is None and not self.resuming.running:
            self.resuming = None
            del self._machine.claims.left[self]
            for left in self._left_motions.values():
                left.go_on()
            self._left_motions.clear()
            self._machine.sequences.paused = False
        return error

    def cancel(self) -> None:
        """Cancel the sequences of `on_resume`, because the machine stops or is in manual mode again."""
        resuming, self.resuming = self.resuming, None
        if resuming is not None:
            _, error = attempt(resuming.cancel)
            if error is not None:
                self._tell("", f"on_resume failed while cleaning up: {error}")

    def _tell(self, path: str, text: str) -> None:
        self._machine.events.add(Event(self._machine.clock.now, path, text))


def _what_drives(
    now: float, cause: str, axes: Sequence[str], found: Mapping[str, Sequence[int]], items: Sequence[Atomic]
) -> Event:
    """Return the event that says what is done with driven actuators."""
    said = [*axes, *(f"{what}: {some(Paths(items, slots))}" for what, slots in found.items() if slots)]
    return Event(now, "", f"{cause}: {'; '.join(said)}")


async def _sent() -> None:
    """Let the values that were restored be sent before the application reads them."""
    await one_period()


async def _resumed(node: Compound) -> None:
    """`on_resume`, called within a sequence: whatever it raises is an error of that."""
    await node.on_resume()
