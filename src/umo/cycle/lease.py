"""The lease: who commands a machine from outside. One hand at a time."""

from __future__ import annotations

from umo.errors import CommandRefused, LeaseHeld

SHORTEST, LONGEST = 0.2, 60.0
"""s for which a lease may be taken."""


class Lease:
    """Times are in s on the cycle's clock. A lease that is not renewed in time has ended."""

    def __init__(self) -> None:
        self.holder = ""
        """Who has it; empty: nobody."""
        self.number = 0
        """Counts the leases."""
        self._key = ""
        self._seconds = 0.0
        self._until = 0.0

    def take(self, who: str, key: str, seconds: float, now: float, *, over: bool = False) -> bool:
        """Whether it was taken over from another hand. LeaseHeld while another hand has it, unless `over`."""
        others = bool(self.holder) and key != self._key
        if others and not over:
            raise LeaseHeld(f"{self.holder} has the lease")
        self.number += 1
        self.holder, self._key, self._seconds = who, key, min(max(seconds, SHORTEST), LONGEST)
        self.renew(key, now)
        return others

    def check(self, key: str) -> None:
        """CommandRefused for anybody but its holder."""
        if not self.holder:
            raise CommandRefused("nobody has the lease; take it first")
        if key != self._key:
            raise LeaseHeld(f"{self.holder} has the lease")

    def renew(self, key: str, now: float) -> None:
        self.check(key)
        self._until = now + self._seconds

    def expired(self, now: float) -> bool:
        return bool(self.holder) and now > self._until

    def end(self) -> None:
        self.holder = self._key = ""
