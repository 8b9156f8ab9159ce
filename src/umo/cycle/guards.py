"""Guards on what is commanded: commands that expire, limits of their rate, interlocks.

An actuator with a guard is connected to a `Guard` that stands before the image and sees its writes; all others are
connected to the image itself and pay nothing.
"""

from __future__ import annotations

import logging
from collections import deque
from math import copysign
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from umo.cycle.journal import Kind
from umo.errors import DriverError, Failure, Interlocked
from umo.objects import Atomic, BinaryActuator, Compound, DigitalActuator, Interlock
from umo.objects.interlock import interlocks_of
from umo.objects.scaling import to_raw

if TYPE_CHECKING:
    from umo.cycle.image import Image

log = logging.getLogger("umo")
EVENTS = 1000
A_TICK = 1e-9
"""s by which a sum of periods may fall short of the time that it stands for."""


class Event(NamedTuple):
    """A guard acted: when (s on the cycle's clock), on which actuator, why."""

    time: float
    path: str
    text: str


class Guard:
    """One guarded actuator's view of the image: everything is the image's own, but writes are looked at."""

    def __init__(self, image: Image, slot: int) -> None:
        self.whole = image
        self.slot = slot
        self.item = cast("BinaryActuator[Any] | DigitalActuator", image.items[slot])
        self.default = self.item._default_value()
        self.expires = self.item._expires
        self.rate = self.item._max_rate if isinstance(self.item, DigitalActuator) else None
        self.reason: str | None = None
        """Why nothing but its default may be written now."""
        self.values, self.raws = image.values, image.raws
        self.pending_raws, self.quality, self.times = image.pending_raws, image.quality, image.times
        self.pending = self
        self.written: float | None = None
        """When it was last written, if that has not expired."""
        self.rest()
        self.item._connect(self, slot)  # type: ignore[arg-type]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)

    def __getitem__(self, slot: int) -> float:
        return self.target

    def __setitem__(self, slot: int, value: float) -> None:
        """What `write` does with `pending`, before anything else has changed."""
        self.check(value)
        self.whole.pending[slot] = value
        self.take(value)

    def check(self, value: float) -> None:
        """Interlocked if this must not be written now."""
        if self.reason is not None and value != self.default:
            raise Interlocked(self.item.path, self.reason)

    def take(self, value: float) -> None:
        """This was written."""
        self.target = value
        self.written = self.whole.clock.now

    def rest(self) -> None:
        """At the default: after connecting, and with a reset, which passes over every guard."""
        self.target = self._planned = self.default
        self.written = None
        self._resetting = True
        self._slewed = self.whole.clock.now

    def lapse(self) -> list[Failure]:
        """Its default as if written, whatever a subclass makes of `write`; sent with `update`, asynchronous at once."""
        self.target, self.written = self.default, None
        self.whole._set_default(self.slot)
        try:
            if not self.item.synchronous:
                self.whole.send(self.slot)
        except DriverError as error:
            return list(error.failures)
        return []

    def slew(self) -> None:
        """Pending becomes what the rate allows in this period, from what the hardware last accepted.

        One step a period, however often this is called. A reset that the device did not take is made up whole.
        """
        image, slot, now = self.whole, self.slot, self.whole.clock.now
        accepted = image.values[slot]
        if self._resetting and accepted != self.default:
            self._planned, self._slewed = self.default, now
        elif now > self._slewed:
            assert self.rate is not None
            step = self.rate * (image.clock.dt or now - self._slewed)
            self._planned = _towards(self.target, accepted, step)
            self._resetting = False
            self._slewed = now
        image.pending[slot] = self._planned
        image.pending_raws[slot] = to_raw(self._planned, *image.wires[slot].scale)


class Guards:
    """All guards of one connected machine."""

    def __init__(self, root: Compound, image: Image) -> None:
        self._image = image
        self.events: deque[Event] = deque(maxlen=EVENTS)
        """The last thousand."""
        self._interlocks = interlocks_of(root)
        self._forbids = [_slots(interlock, image) for interlock in self._interlocks]
        self._reasons: list[str | None] = [None] * len(self._interlocks)
        named = {slot for slots in self._forbids for slot in slots}
        own = {slot for slot, item in enumerate(image.items) if _is_guarded(item)}
        image.guards = {slot: Guard(image, slot) for slot in sorted(named | own)}
        image.slewed = [guard for guard in image.guards.values() if guard.rate is not None]
        guards = [image.guards.get(image.slot_of[id(item)]) for item in root.atoms()]  # as declared
        self._expiring = [guard for guard in guards if guard is not None and guard.expires is not None]

    def __bool__(self) -> bool:
        return bool(self._image.guards)

    def evaluate(self) -> None:
        """Interlocks, then expiries; after `sample`. DriverError if a device did not take its default."""
        failures: list[Failure] = []
        for index, interlock in enumerate(self._interlocks):
            failures += self._ask(index, interlock)
        for guard in self._expiring:
            failures += self._expire(guard)
        if failures:
            raise DriverError("could not be reset", failures)

    def _ask(self, index: int, interlock: Interlock) -> list[Failure]:
        before, reason = self._reasons[index], _reason(interlock)
        if reason == before:
            return []
        self._reasons[index] = reason
        slots = self._forbids[index]
        for slot in slots:
            self._image.guards[slot].reason = self._standing(slot)
        if before is not None or reason is None:
            return []
        for slot in slots:
            self._happened(slot, f"reset: {reason}", Kind.INTERLOCKED)
        return self._image.try_each(slots, "reset")

    def _standing(self, slot: int) -> str | None:
        """The first reason that forbids this actuator."""
        reasons = zip(self._reasons, self._forbids, strict=True)
        return next((reason for reason, slots in reasons if reason is not None and slot in slots), None)

    def _expire(self, guard: Guard) -> list[Failure]:
        assert guard.expires is not None
        now = self._image.clock.now
        if guard.written is None or now - guard.written < guard.expires - A_TICK:
            return []
        self._happened(guard.slot, f"not written for {guard.expires:g} s: to its default", Kind.EXPIRED)
        return guard.lapse()

    def _happened(self, slot: int, text: str, kind: Kind) -> None:
        event = Event(self._image.clock.now, self._image.items[slot].path, text)
        self.events.append(event)
        self._image.note(slot, kind)
        log.warning("%s %s", event.path, event.text)


def _slots(interlock: Interlock, image: Image) -> list[int]:
    return list(dict.fromkeys(image.slot_of[id(item)] for item in interlock.actuators()))


def _towards(target: float, start: float, step: float) -> float:
    """A step nearer to the target; there, when no more than a step is left but for rounding."""
    left = target - start
    return target if abs(left) <= step * (1 + 1e-9) else start + copysign(step, left)


def _is_guarded(item: Atomic) -> bool:
    if isinstance(item, DigitalActuator):
        return item._expires is not None or item._max_rate is not None
    return isinstance(item, BinaryActuator) and item._expires is not None


def _reason(interlock: Interlock) -> str | None:
    """Why it forbids now, None if it does not. What it cannot find out counts as true."""
    try:
        holds = interlock.condition()
        if not isinstance(holds, bool | np.bool_):  # None, for want of a return, would never forbid
            raise TypeError(f"{holds!r} is neither True nor False")
        return interlock.reason if holds else None
    except Exception as error:
        return f"{interlock.reason} (or not: {type(error).__name__}: {error})"
