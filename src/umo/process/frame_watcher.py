"""The guardian's watch over the frames. When a period was missed, the guardian saves the last frames in a black box. It
also makes the memory of the frames, and answers clients that look for the station. Nothing here raises an error. After
a failure there may be no black box, and it may be impossible to watch or command the run.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress

from umo.errors import FramesError, text_of
from umo.process.frames import Reader, blackbox
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.frame_server import FrameServer, new_path
from umo.process.frames.memory import RunDescriptors
from umo.system import calls, realtime
from umo.system.processes import Child, wait_until
from umo.text import Moment

BLACK_BOX_INTERVAL = 10.0
"""The shortest time in s between two black boxes of missed periods."""
BLACK_BOX_TIMEOUT = 5.0
"""The timeout in s at the end of a run for a black box that is being written."""


class FrameWatcher:
    """The watch over the frames of one run. A child process writes the black boxes, so that the disk does not delay the
    guardian."""

    def __init__(self, station: str) -> None:
        self.frames: tuple[RunDescriptors, FrameServer] | None = None
        """The descriptors by which the control process writes, and the server that the control process makes visible;
        None without frames."""
        self._station = station
        self._reader: Reader | None = None
        self._cells: ClientMemory | None = None
        self._missed = 0
        self._box_due: float | None = None
        self._next_box = 0.0
        self._child: Child | None = None
        """The process that writes a black box."""
        self._wanted_reason = ""
        """The reason for which a black box is to be written as soon as the previous one is finished; empty if no black
        box is to be written."""

    def make(self) -> str:
        """Make the memory, which the control process inherits. Return the reason if this fails, otherwise ""."""
        try:
            path = new_path(self._station)
            ends, readers = RunDescriptors.pair()
            self.frames = ends, FrameServer(path, readers)
        except (FramesError, OSError) as error:
            return text_of(error)
        return ""

    def forked(self) -> None:
        """Close this process's end of the pipe, so that readers find the pipe closed when the control process ends."""
        if self.frames is not None:
            calls.close(self.frames[0].alive)

    @property
    def stop(self) -> int | None:
        """The number of the signal with which a client requests the end of the run, or None."""
        asked = None if self._cells is None else self._cells.stop
        return None if asked is None else asked[0]

    @property
    def reader(self) -> Reader | None:
        """The reader of the frames; None while there are no frames."""
        return self._reader if self._attach() else None

    def look(self) -> None:
        """Answer clients. Write a black box some time after a missed period (`blackbox.aftermath`)."""
        self._reap()
        if not self._attach():
            return
        assert self._reader is not None and self.frames is not None
        self.frames[1].look()
        now = calls.now()
        if self._reader.now().missed > self._missed:
            self._missed = self._reader.now().missed
            if now >= self._next_box:
                self._box_due = self._box_due or now + blackbox.aftermath(self._reader.about["period"])
        if self._box_due is not None and now >= self._box_due:
            self._next_box = now + BLACK_BOX_INTERVAL
            self.keep(blackbox.MISSED_PERIOD)

    def keep(self, reason: str) -> None:
        """Write a black box now, or as soon as the one that is being written is finished."""
        self._box_due = None
        if not self._attach():
            return
        if self._child:
            self._wanted_reason = reason
            return
        assert self._reader is not None
        self._wanted_reason = ""
        try:
            child = calls.fork()
        except OSError:
            return
        if child == 0:
            self._write(self._reader, reason)
        self._child = Child(child)

    @property
    def moment(self) -> str:
        """The time of the last period, on the machine's clock; empty if it is not known."""
        with suppress(Exception):
            if self._attach() and self._reader is not None and (frame := self._reader.latest()) is not None:
                return Moment.at(float(frame["time"]))
        return ""

    def finish(self, wait: Callable[[Callable[[], bool], float], object] = wait_until) -> None:
        """Finish the black boxes that are being written or were requested, and remove a remaining ring. `wait`: the
        function that waits for a condition, at most for the given time in s."""
        if self._box_due is not None and not self._wanted_reason:
            self.keep(blackbox.MISSED_PERIOD)
        wait(self._is_at_rest, BLACK_BOX_TIMEOUT)
        if self.frames is not None:
            self.frames[1].close()

    def _is_at_rest(self) -> bool:
        """True if no black box is being written."""
        self._reap()
        return self._child is None

    def _attach(self) -> bool:
        """Return True if there are frames that can be saved."""
        if self._cells is None and self.frames is not None:
            with suppress(FramesError, OSError):  # they are not complete yet
                ends = self.frames[1].ends
                self._reader = self._reader or Reader(self._station, ends.again())
                self._cells = ClientMemory(ends.cells, self._reader.layout)
        return self._cells is not None

    def _write(self, reader: Reader, reason: str) -> None:
        """Write a black box, in the child; never returns. If it hangs, it holds none of the guardian's locks and
        sockets."""
        with suppress(BaseException):
            calls.close_from(3)  # the frames stay mapped
            realtime.drop_realtime()
            folder = blackbox.folder()
            blackbox.save(
                reader, blackbox.name_for(folder, self._station.replace(os.sep, "_"), calls.wall_time()), reason
            )
            blackbox.thin(folder)
        calls.exit_now(0)

    def _reap(self) -> None:
        """Remove a child process that has ended, and start the next one if a black box was requested meanwhile."""
        if self._child is None or not self._child.ended:
            return
        self._child = None
        if self._wanted_reason:
            self.keep(self._wanted_reason)
