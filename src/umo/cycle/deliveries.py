"""The actuators of the image: operations on them, and the ways in which their pending values reach the device.

Each actuator has one delivery, chosen when it is connected:

    WithPeriod   a synchronous actuator: every `update` sends the pending value
    AtOnce       an asynchronous actuator: only a write sends the value
    Posted       a synchronous actuator of a driver off the cycle: the period posts the value, the device confirms it
                 later
    Ordered      an asynchronous actuator of a driver off the cycle: a write orders the value, the device confirms it
                 later
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, ClassVar

from umo.cycle.clock import Clock
from umo.cycle.slots import Slots
from umo.errors import FAILURES, Failure, cause_of_failure
from umo.objects import Quality
from umo.wiring.wired import Wired


class ImageOutputs(Slots):
    """The slots of a machine's objects, and the operations on the actuators among them."""

    def __init__(self, wired: Wired, clock: Clock, equipment: int = 0, axes: int = 0, alarms: int = 0) -> None:
        super().__init__(wired, clock, equipment, axes, alarms)
        self.owed: set[int] = set()
        """The asynchronous actuators whose default the device did not accept. The default is sent in every period until
        it is accepted."""
        self.unconfirmed: dict[int, float] = {}
        """The actuators with on_error="retry" whose pending value was not confirmed, with the time in s of the first
        attempt. While an actuator is STALE, its value is sent again in every period."""
        with_period, at_once = WithPeriod(self), AtOnce(self)
        self.deliveries = [with_period if item.synchronous else at_once for item in self.items]
        """The delivery of the pending value of each actuator; sensors have none."""
        self.does_not_wait: Callable[[int], object] = bool
        """Function that is called for each actuator whose pending value must be sent in this period."""

    def set_default(self, slot: int) -> None:
        """Make the default of an actuator pending."""
        self.pending[slot] = self._defaults[slot]
        self.does_not_wait(slot)

    def is_at_default(self, slot: int) -> bool:
        """Return True if the default of an actuator is pending."""
        return bool(self.pending[slot] == self._defaults[slot])

    def _give_default(self, slot: int) -> None:
        """Make the default of an actuator the value that is sent next."""
        self.sent[slot], self.sent_raws[slot] = self._defaults[slot], self.transfer.defaults[slot]
        self.stepped[slot] = self.clock.now

    def accepted(self, slot: int) -> None:
        """Record that a value was sent to one actuator without an error."""
        self.deliveries[slot].accepted(slot)

    def confirmed(self, slot: int) -> None:
        """Record that one actuator has accepted the value that was sent."""
        self.values[slot] = self.sent[slot]
        self.times[slot] = self.clock.now
        if self.stepped[slot] == inf:
            self.stepped[slot] = self.clock.now
        if self.quality[slot]:
            self.set_quality(slot, Quality.GOOD)
            self.owed.discard(slot)
            self.unconfirmed.pop(slot, None)

    def send_again(self) -> list[Failure]:
        """Send the unconfirmed values again; returns the failures."""
        stale = [slot for slot in self.unconfirmed if self.quality[slot] == Quality.STALE]
        return [failure for slot in stale for failure in self.deliveries[slot].written(slot)]

    def fail_output(self, slot: int, cause: str, failures: list[Failure]) -> None:
        if self.deliveries[slot].is_sent_again(slot):
            self.set_quality(slot, Quality.STALE)
        else:
            self._has_failed(slot, cause, failures)

    def unconverted(self, slot: int, error: Exception, failures: list[Failure]) -> None:
        """Record that the pending value of an actuator cannot be converted to a raw integer."""
        self._has_failed(slot, f"its linearization failed: {cause_of_failure(error)}", failures)

    def _has_failed(self, slot: int, cause: str, failures: list[Failure]) -> None:
        self.deliveries[slot].refused(slot)
        self.set_quality(slot, Quality.BAD)
        failures.append(self.transfer.failure(slot, cause))


class WithPeriod:
    """Delivery of outputs whose pending values are sent by every `update`, whether written or not."""

    at_once: ClassVar[bool] = False
    """True if a write sends the value immediately."""

    def __init__(self, image: ImageOutputs) -> None:
        self._image = image
        self._items: Any = image.items

    def written(self, slot: int) -> list[Failure]:
        """Send an accepted value or the default, if no `update` will send it. Returns the failures."""
        return []

    def accepted(self, slot: int) -> None:
        """Record that a value was sent to an actuator without an error."""
        self._image.confirmed(slot)

    def refused(self, slot: int) -> None:
        """Record that the device did not accept the pending value."""

    def is_sent_again(self, slot: int) -> bool:
        """Return True if an unconfirmed value is sent again in the next period, and does not count as failed yet. This
        is also so while it is unknown whether the device answers, because the value was then not sent at all."""
        image = self._image
        away, driver = image.transfer.callees.away, image.wires[slot].driver
        return self._is_within(slot, image.times[slot]) or away.is_unknown(driver)

    def _is_within(self, slot: int, since: float) -> bool:
        """Return True if no more than the actuator's `max_age` has passed since this time in s."""
        max_age = self._items[slot]._max_age
        return max_age is not None and bool(self._image.clock.now - since <= max_age)

    def survives(self, slot: int) -> bool:
        """Return True if the actuator gets its pending value after its device was away and has been initialised
        again."""
        return True

    def goes_on(self, slot: int) -> None:
        """Record that the device has been initialised again and gets the pending value."""


class AtOnce(WithPeriod):
    """Delivery of outputs whose values are sent by the write itself. A default that was not accepted is sent in every
    period until it is accepted."""

    at_once = True

    def written(self, slot: int) -> list[Failure]:
        failures: list[Failure] = []
        image = self._image
        value, raw = image.pending[slot], image.transfer.defaults[slot]
        if not image.is_at_default(slot):
            try:
                raw = image.wires[slot].raw(value)
            except Exception as error:  # of a linearization of the user's
                image.unconverted(slot, error, failures)
                return failures
        image.sent[slot], image.sent_raws[slot] = value, raw
        try:
            image.transfer.write(slot, image.sent_raws[slot])
        except FAILURES as error:
            image.fail_output(slot, cause_of_failure(error), failures)
        else:
            image.accepted(slot)
        return failures

    def refused(self, slot: int) -> None:
        """Record that a value was refused. A default is sent again until it is accepted or another value is written."""
        owed = self._image.owed
        (owed.add if self._image.is_at_default(slot) else owed.discard)(slot)

    def is_sent_again(self, slot: int) -> bool:
        if self._items[slot]._max_age is None:
            return False
        return self._is_within(slot, self._image.unconfirmed.setdefault(slot, self._image.clock.now))

    def survives(self, slot: int) -> bool:
        return self._items[slot]._max_age is not None

    def goes_on(self, slot: int) -> None:
        if not self._image.is_at_default(slot):
            self._image.unconfirmed[slot] = self._image.clock.now
            self._image.set_quality(slot, Quality.STALE)
