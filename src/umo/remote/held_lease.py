"""The lease of a client: taken, renewed by a thread, given back."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING

from umo.errors import LeaseHeld, UmoError

if TYPE_CHECKING:
    from umo.remote.attached import RemoteStation

ROOM = 600
"""Bytes of a command for paths; the rest is for who and key."""
OFTEN = 5
"""Times that a lease is renewed, and what is held is kept up, while it lasts."""


class HeldLease:
    """`with station.lease("commissioning"):`. Only its holder commands the station.

    A thread renews it and keeps up what was written or is jogged, until the block ends. If this process dies, the lease
    ends after `seconds`, and what it held goes to its default.
    """

    def __init__(self, station: RemoteStation, who: str, seconds: float, over: bool) -> None:
        self.who = who
        self.key = secrets.token_hex(8)
        self.held: dict[str, float] = {}
        """What is kept up: paths, each with the s for which it lasts."""
        self._station = station
        self._seconds = seconds
        self._over = over
        self._number = 0
        self._ended = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def lost(self) -> bool:
        """Whether it has ended, or another hand has taken it over."""
        return not self._station.reader.lease_held(self._number)

    def __enter__(self) -> HeldLease:
        self._number = self._ask()
        self._station.held_lease = self
        self._thread = threading.Thread(target=self._keep, name="umo lease", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended = True
        self._wake.set()
        assert self._thread is not None
        self._thread.join()
        with suppress(UmoError, OSError):  # it is lost, or the station has ended
            if not self.lost:
                self._station.ask("give back")
        self._station.held_lease = None

    def _ask(self) -> int:
        """Its number. LeaseHeld names the argument that takes it over."""
        try:
            number: int = self._station.ask("lease", key=self.key, who=self.who, seconds=self._seconds, over=self._over)
        except LeaseHeld as error:
            raise LeaseHeld(
                f"{error}; take it over with station.lease(over=True), or wait until it is given back"
            ) from error
        return number

    def keep_up(self, path: str, lasts: float) -> None:
        """From now on this is kept up: the thread may be waiting longer than it lasts."""
        self.held[path] = lasts
        self._wake.set()

    def _keep(self) -> None:
        """Until the block ends, or the lease is lost."""
        while True:
            self._wake.wait(min([self._seconds, *self.held.values()]) / OFTEN)
            self._wake.clear()
            if self._ended or self.lost:
                return
            with suppress(UmoError, OSError):
                for paths in batches(list(self.held)):
                    self._station.send("keep", key=self.key, who=self.who, held=paths)


def batches(paths: Sequence[str]) -> Iterator[list[str]]:
    """What is kept up, in parts that a command can carry; one empty part if it is nothing."""
    part: list[str] = []
    for path in paths:
        if part and len(json.dumps([*part, path])) > ROOM:
            yield part
            part = []
        part.append(path)
    yield part
