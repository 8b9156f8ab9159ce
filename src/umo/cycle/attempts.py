"""Decides how often the reset of a machine is attempted.

The rule is the same for the guardian, the control process and a worker process without its machine: if an attempt has
reached an actuator that none had reached before, another attempt follows, even when the time is over. A device may
begin to answer in the middle of the last attempt; without another one it would remain half driven."""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class Attempts:
    """The results of the attempts so far. At most as many attempts as there are actuators can reach something new."""

    def __init__(self) -> None:
        self._reached: set[Hashable] = set()

    def add(self, reached: Iterable[Hashable]) -> bool:
        """Add the results of an attempt. Return True if it has reached an actuator that none had reached before."""
        before = len(self._reached)
        self._reached.update(reached)
        return len(self._reached) > before
