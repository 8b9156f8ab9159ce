"""Passes the commands of a fleet to one run. It works like the gateway of a face, except that only one client at a time
has the lease."""

from __future__ import annotations

from math import inf

from umo.clients.faces.command_users import lives, named
from umo.clients.faces.face import User
from umo.clients.faces.gateway import Gateway
from umo.errors import CommandRefused, LeaseHeld
from umo.operation.commands.verbs import STOP, TUNE


class SoleLease(Gateway):
    """The gateway for clients of a fleet. They take the lease and give it back, like clients on the computer of the
    machine."""

    _owner: User | None = None

    async def take_lease(self, user: User, *, over: bool = False) -> int:
        """Take the lease for one user, who alone commands as long as `user.is_alive` returns True. Return the number of
        the lease. Raises LeaseHeld if another user has the lease and it is not deliberately taken over."""
        if (refusal := super()._refusal(user, TUNE.name, "")) is not None:  # the least that one needs it for
            raise CommandRefused(refusal)
        owner = self.owner
        if owner is not None and _others(owner, user) and not over:
            raise LeaseHeld(f"{named(owner, self._face)} has the lease")
        self._owner = user
        try:
            await self._take_lease(named(user, self._face), anew=owner is None or over, over=over)
        except BaseException:
            self._owner = owner
            raise
        return self._session.lease

    def give_back(self, user: User) -> None:
        """Give back the lease, because the user no longer needs it."""
        if self._owner is not None and not _others(self._owner, user):
            self._owner, self._last = None, -inf

    @property
    def owner(self) -> User | None:
        """The user who has the lease, or None."""
        if self._owner is not None and not lives(self._owner):
            self._owner = None
        return self._owner

    @property
    def _is_used(self) -> bool:
        return super()._is_used or self.owner is not None

    def _refusal(self, user: User, do: str, path: str) -> str | None:
        owner = self.owner
        if do != STOP.name and owner is not None and _others(owner, user):
            return f"{named(owner, self._face)} has the lease"
        return super()._refusal(user, do, path)


def _others(owner: User, user: User) -> bool:
    """True if two users are different: their names differ, or only one of the two names is proved. A visitor of a page
    whose commands a user passes on is therefore not that user."""
    return (owner.name, owner.proved) != (user.name, user.proved)
