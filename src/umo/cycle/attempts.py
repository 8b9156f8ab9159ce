"""How often whoever resets a machine tries again.

The rule is one for the guardian, the control process and a worker that is left alone: as long as an attempt has reached
anything that none had reached before, there is another one, also when the time is over. A device may begin to answer
in the middle of the last attempt; it would stay half driven.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable


class Attempts:
    """What they have reached so far. At most as many of them reach something new as there are actuators."""

    def __init__(self) -> None:
        self._reached: set[Hashable] = set()

    def add(self, reached: Iterable[Hashable]) -> bool:
        """Add what an attempt has reached; whether none before had reached some of it."""
        before = len(self._reached)
        self._reached.update(reached)
        return len(self._reached) > before
