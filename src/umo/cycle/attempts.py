"""The number of attempts to reset a machine.

The rule is the same for the guardian, the control process and a worker process without its machine: if an attempt has
reached an actuator that no attempt had reached before, another attempt follows, even when the time is over. A device
may begin to answer in the middle of the last attempt; without another attempt some of its actuators would remain
driven."""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class Attempts:
    """The results of the attempts so far. The number of attempts that reach a further actuator is limited by the number
    of actuators."""

    def __init__(self) -> None:
        self._reached: set[Hashable] = set()

    def add(self, reached: Iterable[Hashable]) -> bool:
        """Add the results of an attempt. Return True if it has reached an actuator that no attempt had reached
        before."""
        before = len(self._reached)
        self._reached.update(reached)
        return len(self._reached) > before
