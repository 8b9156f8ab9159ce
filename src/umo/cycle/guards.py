"""Guards: the interlocks of a machine, and the times after which its commands expire. They are evaluated in the phase
GUARD."""

from __future__ import annotations

from collections.abc import Container, Sequence
from functools import partial
from math import inf

from umo.cycle.claim_table import Claims
from umo.cycle.events import Event, Paths, of_several
from umo.cycle.image import Image
from umo.cycle.inhibition import QUIET_TIME, Inhibition
from umo.cycle.journal import Kind
from umo.cycle.to_defaults import ToDefault
from umo.drivers.contract import Direction
from umo.duration import lasting
from umo.objects import Atomic
from umo.objects.claims import Rank

MOST_LOGGED = 3
"""Largest number of beginnings of one interlock that are logged, until it has not begun for `QUIET_TIME`. All are
events."""


class Guards:
    """The guards of one machine."""

    def __init__(self, claims: Claims, image: Image) -> None:
        self._claims, self._image = claims, image
        self._expiring = [command for command in claims.by_slot.values() if command.expires < inf]
        self._inhibiting: list[tuple[Inhibition, str]] = []
        """The interlocks that inhibited actuators at the last evaluation, with their reasons."""
        self._untold: dict[tuple[int, Inhibition], None] = {}
        """The slots that an interlock has begun to inhibit during a fault of their equipment, with these interlocks."""

    @property
    def any(self) -> bool:
        """True if there are guards, or asynchronous actuators whose defaults may still have to be sent."""
        items = self._image.items
        return bool(self._claims.by_slot) or any(
            item.direction is Direction.OUTPUT and not item.synchronous for item in items
        )

    def evaluate(self) -> None:
        """Evaluate interlocks and expiries after `sample`, and reset the actuators concerned in stop order. Raises
        DriverError if a device did not accept its default; the reset is retried in every period."""
        if not (self._claims.by_slot or self._image.owed):
            return
        due = self._image.owed | self._interlocked()
        due |= self._expired(due)
        if due:
            self._image.reset_some([slot for slot in self._claims.order if slot in due])

    def _interlocked(self) -> set[int]:
        """Return the actuators that are inhibited from now on. All conditions are evaluated before anything is reset.
        No interlock latches before the first period, because an actuator that is inhibited while the machine is being
        connected has not acted yet."""
        latch = self._image.clock.number > 0
        begun = [each for each in self._claims.inhibitions if each.ask(latch)]
        if begun or self._inhibiting:
            inhibiting = [(each, each.reason) for each in self._claims.inhibitions if each.reason is not None]
            if begun or inhibiting != self._inhibiting:
                self._inhibiting = inhibiting
                self._claims.interlocked(begun)
        inhibited: list[int] = []
        any_fault = bool(begun) and self._claims.any_fault
        for each in begun:
            outranked = [slot for slot in each.slots if self._is_outranked(slot)] if any_fault else ()
            self._untold |= {(slot, each): None for slot in outranked}
            if slots := [slot for slot in each.slots if slot not in outranked] if outranked else each.slots:
                inhibited += slots
                self._tell_inhibited(slots, each)
        self._image.transfer.note_each(inhibited, Kind.INTERLOCKED)
        return {slot for each in begun for slot in each.slots}

    def _is_outranked(self, slot: int) -> bool:
        """Return True if the rank that decides about the actuator is above that of any interlock."""
        return self._claims.by_slot[slot].rank > Rank.INTERLOCK

    def _tell_inhibited(self, slots: Sequence[int], each: Inhibition) -> None:
        """Report that one interlock inhibits these objects. An interlock that begins again and again in the normal work
        of the machine does not fill the log. A latched interlock is always logged."""
        waits = each.interlock.latched and each.held  # its reason says so itself once its condition is false
        what = "inhibited until acknowledged" if waits else "inhibited"
        event = partial(_inhibited, self._image.clock.now, self._image.items, slots, what, str(each.reason))
        count = 0 if each.interlock.latched else each.count(self._image.clock.now)
        self._image.events.add(event, logged=count <= MOST_LOGGED)
        if count == MOST_LOGGED:
            self._image.events.log(partial(_further, each.interlock.reason))

    def _expired(self, due: Container[int]) -> set[int]:
        """Handle the expired commands. Return the asynchronous actuators among them, which must be reset now; the
        defaults of the others are sent with `update`."""
        sent, found = list[int](), set[int]()
        told: dict[float, list[int]] = {}
        now, pending = self._image.clock.now, self._image.pending
        for command in self._expiring:
            slot = command.slot
            if slot not in due and command.has_expired(now):
                if pending[slot] != command.default:  # where it is, nothing happens that is to be told
                    told.setdefault(command.expires, []).append(slot)
                if command.synchronous:
                    sent.append(slot)
                else:
                    found.add(slot)
        for expires, slots in told.items():
            self._image.transfer.note_each(slots, Kind.EXPIRED)
            self._image.events.add(partial(_commands_expired, now, self._image.items, slots, expires), logged=True)
        if sent:
            self._image.settle(sent, ToDefault.SEND)
        return found

    def expire(self) -> None:
        """Replace expired commands by the defaults, before the outputs that have waited for the tick are sent."""
        self._expired({command.slot for command in self._expiring if not command.synchronous})

    def free(self, faults: Sequence[Inhibition]) -> None:
        """Allow writes to the actuators of cleared equipment again, unless an interlock inhibits them. An interlock
        that began during the fault gets its event now."""
        self._claims.free(faults)
        begun: dict[Inhibition, list[int]] = {}
        for slot, each in [key for key in self._untold if not self._is_outranked(key[0])]:
            del self._untold[slot, each]
            if each.reason is not None:
                begun.setdefault(each, []).append(slot)
        for each, slots in begun.items():
            self._image.transfer.note_each(slots, Kind.INTERLOCKED)
            self._tell_inhibited(slots, each)


def _inhibited(now: float, items: Sequence[Atomic], slots: Sequence[int], what: str, reason: str) -> Event:
    paths = Paths(items, slots)
    return of_several(now, paths, f"{what}: {reason}", f"{reason}: {len(paths):,} actuators {what}")


def _further(reason: str) -> str:
    until = f"until it has not begun for {lasting(QUIET_TIME)}"
    return f"interlock {reason!r}: its further beginnings are events without a line, {until}"


def _commands_expired(now: float, items: Sequence[Atomic], slots: Sequence[int], expires: float) -> Event:
    paths = Paths(items, slots)
    alone = f"command expired: not written for {expires:g} s, default sent"
    return of_several(
        now, paths, alone, f"{len(paths):,} commands expired: not written for {expires:g} s, defaults sent"
    )
