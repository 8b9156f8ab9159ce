"""Decides how often the reset of a machine is attempted.

The rule is the same for the guardian, the control process and a worker that is left alone: if an attempt has reached an
actuator that none had reached before, another attempt follows, also when the time is over. A device may begin to answer
in the middle of the last attempt; without another one it would remain half driven."""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class Attempts:
    """The results of the attempts so far. The number of attempts that reach something new is at most the number of
    actuators."""

    def __init__(self) -> None:
        self._reached: set[Hashable] = set()

    def add(self, reached: Iterable[Hashable]) -> bool:
        """Add the results of an attempt. Return True if it has reached an actuator that none had reached before."""
        before = len(self._reached)
        self._reached.update(reached)
        return len(self._reached) > before
