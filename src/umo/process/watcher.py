"""The guardian watches the frames: when a period was missed, it saves the last ones in a black box.

Nothing here raises: an error costs black boxes only.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep, time

from umo.errors import FramesError
from umo.frames import Reader
from umo.frames.folder import new_path, remove
from umo.latency import blackbox
from umo.system import realtime
from umo.text import Moment

AT_MOST_EVERY = 10.0
"""s from one black box of a missed period to the next."""
AFTERMATH = 0.05
"""s of what followed that are kept as well."""
PATIENCE = 5.0
"""s that the end of a run waits for a black box that is being written."""


class Watcher:
    """Follows one ring in a file that it chooses. Writes in a child process: the disk does not delay the guardian."""

    def __init__(self, station: str) -> None:
        self.path: Path | None = None
        """Where the control process is to make its ring; None where there is no folder for it."""
        with suppress(FramesError, OSError):
            self.path = new_path(station)
        self._station = station.replace(os.sep, "_")
        self._reader: Reader | None = None
        self._missed = 0
        self._due: float | None = None
        self._next = 0.0
        self._child = 0
        self._wanted = ""
        """Why a black box is to be written as soon as the one before is finished."""

    def look(self) -> None:
        """A missed period is noticed, and kept a little later."""
        self._reap()
        if not self._attach():
            return
        assert self._reader is not None
        now = monotonic()
        if self._reader.missed > self._missed:
            self._missed = self._reader.missed
            if now >= self._next:
                self._due = self._due or now + AFTERMATH
        if self._due is not None and now >= self._due:
            self._next = now + AT_MOST_EVERY
            self.keep(blackbox.MISSED_ONE)

    def keep(self, reason: str) -> None:
        """Write a black box now, or as soon as the one that is being written is finished."""
        self._due = None
        if not self._attach():
            return
        if self._child:
            self._wanted = reason
            return
        assert self._reader is not None
        self._wanted = ""
        try:
            child = os.fork()
        except OSError:
            return
        if child == 0:
            self._write(self._reader, reason)
        self._child = child

    @property
    def moment(self) -> str:
        """The time of the last period, on the machine's clock; empty if it is not known."""
        with suppress(Exception):
            if self._attach() and self._reader is not None and (frame := self._reader.latest()) is not None:
                return Moment.at(float(frame["time"]))
        return ""

    def finish(self) -> None:
        """At the end: what is being written, and what is wanted still, is finished; a ring left behind is removed."""
        until = monotonic() + PATIENCE
        if self._due is not None and not self._wanted:
            self.keep(blackbox.MISSED_ONE)
        while self._child and monotonic() < until:
            sleep(0.001)
            self._reap()
        if self.path is not None:
            with suppress(OSError):
                remove(self.path)

    def _attach(self) -> bool:
        """Whether there are frames to be kept."""
        if self._reader is None and self.path is not None:
            with suppress(FramesError, OSError, ValueError):
                self._reader = Reader(self.path)
        return self._reader is not None

    def _write(self, reader: Reader, reason: str) -> None:
        """In the child; never returns. Should it stick, it holds none of the guardian's locks and sockets."""
        with suppress(BaseException):
            os.closerange(3, os.sysconf("SC_OPEN_MAX"))  # the frames stay mapped
            realtime.stand_back()
            folder = blackbox.folder()
            blackbox.save(reader, blackbox.name_for(folder, self._station, time()), reason)
            blackbox.thin(folder)
        os._exit(0)

    def _reap(self) -> None:
        """A child that is finished makes way for the next."""
        if not self._child:
            return
        try:
            if os.waitpid(self._child, os.WNOHANG)[0] == 0:
                return
        except OSError:  # it is gone
            pass
        self._child = 0
        if self._wanted:
            self.keep(self._wanted)
