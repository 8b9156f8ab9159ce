"""The guardian's look at the frames: when a period was missed, the last ones are kept in a black box."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from time import monotonic, time

from umo.errors import FramesError
from umo.frames import Reader
from umo.frames.publish import new_path
from umo.latency import blackbox
from umo.system import realtime
from umo.system.record import state_folder

AT_MOST_EVERY = 10.0
"""s from one black box to the next."""
AFTERMATH = 0.05
"""s of what followed that are kept as well."""


def box_folder() -> Path:
    """Where black boxes lie."""
    path = state_folder() / "blackbox"
    path.mkdir(exist_ok=True)
    return path


class Watcher:
    """Follows one ring, whose place it chooses; writes in a child process, so that a slow disk delays nobody."""

    def __init__(self, station: str) -> None:
        self.path = new_path(station)
        """Where the control process is to make its ring."""
        self._station = station
        self._reader: Reader | None = None
        self._missed = 0
        self._due: float | None = None
        self._next = 0.0
        self._child = 0

    def look(self) -> None:
        """A missed period is noticed, and kept a little later."""
        self._reap()
        if self._reader is None:
            with suppress(FramesError):
                self._reader = Reader(self.path)
            return
        now = monotonic()
        if self._reader.missed > self._missed:
            self._missed = self._reader.missed
            if now >= self._next:
                self._due = self._due or now + AFTERMATH
        if self._due is not None and now >= self._due:
            self.keep("a period was missed")

    def keep(self, reason: str) -> None:
        """Write a black box now."""
        if self._reader is None or self._child:
            return
        self._due = None
        self._next = monotonic() + AT_MOST_EVERY
        self._child = os.fork()
        if self._child == 0:
            self._write(self._reader, reason)

    def finish(self) -> None:
        """At the end: what is being written is finished, a ring left behind is removed."""
        if self._due is not None:
            self.keep("a period was missed")
        if self._child:
            os.waitpid(self._child, 0)
            self._child = 0
        self.path.unlink(missing_ok=True)

    def _write(self, reader: Reader, reason: str) -> None:
        """In the child; never returns. A full disk costs the black box and nothing else."""
        with suppress(BaseException):
            realtime.stand_back()
            folder = box_folder()
            blackbox.save(reader, blackbox.name_for(folder, self._station, time()), reason)
            blackbox.thin(folder)
        os._exit(0)

    def _reap(self) -> None:
        if self._child and os.waitpid(self._child, os.WNOHANG)[0]:
            self._child = 0
