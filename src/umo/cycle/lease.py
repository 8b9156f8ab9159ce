"""The lease: who commands a machine from outside. One hand at a time."""

from __future__ import annotations

from umo.errors import CommandRefused, LeaseHeld

SHORTEST, LONGEST = 0.2, 60.0
"""s for which a lease may be taken."""


class Lease:
    """Times are in s on the clock of its holder's signs of life. It ends when there is none for too long."""

    def __init__(self) -> None:
        self.holder = ""
        """The holder's name; empty: nobody has it."""
        self.number = 0
        """Counts the leases."""
        self._key = ""
        self._seconds = 0.0
        self._seen = 0.0

    def take(self, who: str, key: str, seconds: float, now: float, *, over: bool = False) -> bool:
        """Whether it was taken over from another hand. LeaseHeld while another hand has it, unless `over`."""
        others = bool(self.holder) and key != self._key
        if others and not over:
            raise LeaseHeld(f"{self.holder} has the lease")
        self.number += 1
        self.holder, self._key, self._seconds = who, key, min(max(seconds, SHORTEST), LONGEST)
        self._seen = now
        return others

    def check(self, key: str) -> None:
        """CommandRefused for anybody but its holder."""
        if not self.holder:
            raise CommandRefused("nobody has the lease; take it first")
        if key != self._key:
            raise LeaseHeld(f"{self.holder} has the lease")

    def seen(self, then: float, now: float) -> None:
        """Its holder was there then. A time that is still to come does not count."""
        if self._seen < then <= now:
            self._seen = then

    def expired(self, now: float) -> bool:
        return bool(self.holder) and now - self._seen > self._seconds

    def end(self) -> None:
        self.holder = self._key = ""
