"""The lease of a client: taken, renewed by a thread, given back."""

from __future__ import annotations

import secrets
import threading
import time
from contextlib import suppress

from umo.cycle.client_commands import LONGEST_LEASE, SHORTEST_LEASE
from umo.cycle.events import CommandState
from umo.errors import FramesError, LeaseHeld, RangeError, UmoError
from umo.frames.client_memory import LEASE
from umo.remote.commanded import Commanded

EVENT_DELAY = 0.05
"""s within which the machine's words follow the end of a lease."""
SIGNS_OF_LIFE = 5
"""Number of signs of life that a client gives in the time of a lease, or the dead-man time of what it holds."""


class HeldLease:
    """`with station.lease("commissioning"):`. Only its holder commands the station.

    A thread gives signs of life for it and for what was written or is jogged, until the block ends. If this process
    dies, the lease ends after `seconds`, and what it held goes to its default. RangeError for other `seconds` than
    a lease may last.
    """

    def __init__(self, station: Commanded, who: str, seconds: float, over: bool) -> None:
        if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
            raise RangeError(f"a lease can last from {SHORTEST_LEASE:g} to {LONGEST_LEASE:g} s, not {seconds:g} s")
        self.who = who
        self.key = secrets.token_hex(8)
        self.held: dict[str, float] = {}
        """The paths that are held, each with the s for which it lasts."""
        self._since: dict[str, int] = {}
        """The number of the next event when a path was held first."""
        self._station = station
        self._seconds = seconds
        self._over = over
        self._number = 0
        self._ended = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def lost(self) -> bool:
        """Whether it has ended, with the station or by itself, or another client has taken it over."""
        return not (self._station.running and self._station.reader.lease_held(self._number))

    def __enter__(self) -> HeldLease:
        self._number = self._ask()
        self._station.held_lease = self
        self._thread = threading.Thread(target=self._keep, name="umo lease", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.give_back()

    def give_back(self) -> None:
        """End the lease. What it held goes to its default."""
        if self._station.held_lease is not self:  # it was given back before
            return
        try:
            with suppress(UmoError, OSError):  # it is lost, or the station has ended
                if not self.lost:
                    self._station.ask("give back")
        finally:
            self._ended = True
            self._wake.set()
            assert self._thread is not None
            self._thread.join()
            self._station.held_lease = None

    def _ask(self) -> int:
        """Ask for the lease; its number. LeaseHeld names the argument that takes it over."""
        try:
            number: int = self._station.ask("lease", key=self.key, who=self.who, seconds=self._seconds, over=self._over)
        except LeaseHeld as error:
            raise LeaseHeld(
                f"{error}; take it over with station.lease(over=True), or wait until it is given back"
            ) from error
        return number

    def hold(self, path: str, lasts: float) -> None:
        """Hold this path from now on: the thread may be waiting longer than it lasts."""
        self._since[path] = self._station.reader.next_event
        self._station.sign(self._number, path)
        self.held[path] = lasts
        self._wake.set()

    def ended(self, path: str) -> str:
        """Reason why what was held at this path has ended, in the machine's words; "": it lasts, or was not held."""
        station, lost = self._station, self.lost  # before the events: the last of them may tell why
        if not (told := self._told(path)) and lost and station.running:
            time.sleep(EVENT_DELAY)
            told = self._told(path)
        if told or not lost:
            return told
        return "the lease has ended" if station.running else f"{station.reader.about['station']} has ended"

    def _told(self, path: str) -> str:
        since = self._since.get(path, self._station.reader.next_event)
        events = (each.event for each in self._station.reader.events(since))
        ends = (each.text for each in events if each.path == path and each.state is CommandState.CANCELLED)
        return next(ends, "")

    def _keep(self) -> None:
        """Give signs of life until the block ends, or the lease is lost."""
        with suppress(FramesError):  # the station has just ended
            while not (self._ended or self.lost):
                self._station.sign(self._number, LEASE, *self.held.copy())
                self._wake.wait(min([self._seconds, *self.held.copy().values()]) / SIGNS_OF_LIFE)
                self._wake.clear()
