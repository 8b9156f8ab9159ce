"""The keeper: a process that writes kept values and the history of alarms to the disk while a machine runs, and at its
end.

The guardian forks and supervises the keeper. The keeper maps the frames read-only, takes the last complete frame every
half second, and writes one file if the kept values have changed. All values in the file belong to the period of this
frame. The keeper also appends the changes of alarms to their history. When the process that writes the frames has
ended, or was killed, the keeper writes the last frame and ends. It outlives all other processes of the run, and holds
none of their resources, neither a device nor a socket. Only the keeper waits for a disk.
"""

from __future__ import annotations

import errno
import mmap
import os
import signal
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any

from umo.errors import text_of
from umo.process import kept_file
from umo.process.alarm_history import AlarmHistory, utc_of
from umo.process.frames import Reader
from umo.process.kept_file import KeptValues
from umo.process.kept_sections import sections_of
from umo.process.reset import DEATH_TIMEOUT, STOP_SIGNALS
from umo.process.run_state import RunState, Who
from umo.system import calls, realtime
from umo.system.processes import Child, ProcessHandle, adjust_oom_score, name_process

INTERVAL = 0.5
"""The time in s between two looks of the keeper. The values of one look stay in the file until those of the next look
are written: for this time plus the time of the disk. If the disk takes no longer than this time, kept values are never
older than twice this time."""
LAST_TIMEOUT = 5.0
"""Timeout in s at the end of a run for the last values."""
FIRST_PAUSE, MAX_PAUSE = 0.1, 5.0
"""The shortest and the longest time in s between two replacements of a keeper. The time is doubled each time."""
OOM_SCORE_CHANGE = 600
"""The change of the keeper's score relative to the guardian's. If memory runs out, the kernel kills the keeper before
all processes that reset."""
NO_FOLDER = "nothing is kept: there is no folder for kept values"
HELD_BY_ANOTHER = -1
"""The value in place of an error number if another run of this station with this wiring uses the file."""


class KeeperMessage(IntEnum):
    """The keeper's messages in shared memory."""

    BEGUN, ERROR, FINISHED, HISTORY_ERROR, NEXT_EVENT = range(5)
    """The indices of the cells. BEGUN: 1 if there is a keeper whose end was not noticed. ERROR: the number of the error
    of the last write; 0 if there was none. FINISHED: 1 at the end of the keeper. HISTORY_ERROR: the error of the
    history of alarms. NEXT_EVENT: the number of the first event that the keeper has not read."""


class Keeper:
    """The keeper of one run, for its guardian and the standby guardian. `say` prints failures for the user."""

    def __init__(
        self,
        path: Path | None,
        title: KeptValues,
        run_state: RunState,
        say: Callable[[str], object],
        core: int | None = None,
    ) -> None:
        """`path`: the file; None if there is no folder for it. `title`: the data about the station in the file. `core`:
        the core of the control process, which the keeper does not use."""
        self.path = path
        self._title = title
        self._run_state = run_state
        self._say = say
        self._core = core
        self._child: Child | None = None
        """The child process that is the keeper, in the process that has forked it."""
        self._cells = memoryview(mmap.mmap(-1, 8 * len(KeeperMessage))).cast("q")
        self._next_fork, self._pause = 0.0, FIRST_PAUSE
        self._keeps: bool | None = None
        """True if something is to be kept; None before there are frames."""

    # The guardian ----------------------------------------------------------------------------------------

    def look(self, reader: Reader | None) -> None:
        """Fork the keeper as soon as there are frames with something to keep. Replace the keeper if it has died or was
        stopped by a signal. Report if the keeper cannot write."""
        if reader is None or not self._has_something(reader):
            return
        if self.path is None:
            self._say(NO_FOLDER)
        elif self._cells[KeeperMessage.BEGUN]:
            if (error := self._cells[KeeperMessage.ERROR]) != 0:
                self._say(f"{_told(error)}; umo tries again; the earlier file remains: {self.path}")
            self._tell_history("umo tries again")
            if not self._has_ended() or self._cells[KeeperMessage.FINISHED]:
                return
            self._cells[KeeperMessage.BEGUN] = 0
            self._say("the process that keeps values was killed or stopped; another one takes its place")
        elif calls.now() >= self._next_fork:
            self._next_fork = calls.now() + self._pause
            self._pause = min(2 * self._pause, MAX_PAUSE)
            self._fork(reader)

    def finish(self, reader: Reader | None) -> str:
        """Wait for the last values at the end, when the machine has been reset. Return the reason why the values were
        not written, or "". A keeper that is late is ended, because it must not overwrite the values of a later run."""
        if reader is None or not self._has_something(reader):
            return ""
        if self.path is None:
            return NO_FOLDER
        until = calls.now() + LAST_TIMEOUT
        for _ in range(2):  # the second takes the place of one that was killed
            if not self._cells[KeeperMessage.FINISHED] and self._has_ended():
                self._fork(reader)
            self._run_state.wait(self._has_ended, until - calls.now())
        self._tell_history("the last changes are missing")
        finished, error = self._cells[KeeperMessage.FINISHED], self._cells[KeeperMessage.ERROR]
        self._end()
        if finished and not error:
            return ""
        why = _told(error) if error else "the process that keeps values did not end in time"
        return f"the last kept values were not written: {why}; {self.path} has the earlier ones"

    def _tell_history(self, consequence: str) -> None:
        if (error := self._cells[KeeperMessage.HISTORY_ERROR]) != 0:
            self._say(f"the history of alarms cannot be written: {os.strerror(error)}; {consequence}")

    def _has_something(self, reader: Reader) -> bool:
        if self._keeps is None:
            self._keeps = bool(sections_of(reader.layout))
        return self._keeps

    def _fork(self, reader: Reader) -> None:
        self._cells[KeeperMessage.FINISHED] = self._cells[KeeperMessage.ERROR] = 0
        try:
            pid = self._run_state.fork(Who.KEEPER)
        except OSError as error:
            self._say(f"nothing is kept: {text_of(error)}; umo tries again")
            return
        if pid == 0:
            assert self.path is not None
            _work(self.path, self._title, reader, self._cells, self._core)
        self._child, self._cells[KeeperMessage.BEGUN] = Child(pid), 1

    def _has_ended(self) -> bool:
        """Return True if the keeper no longer works. A keeper that was stopped by a signal is ended."""
        process = self._process
        if process is None or process.ended:
            return True
        if process.is_stopped:
            self._end()
            return True
        return False

    @property
    def _process(self) -> ProcessHandle | None:
        """Return the process. For another guardian's keeper the lock proves which process it is."""
        if self._child is not None and self._child.is_own:
            return self._child
        return self._run_state.process(Who.KEEPER)

    def _end(self) -> None:
        """Make sure that the keeper ends. A keeper that is blocked in a call of the kernel ends after this call."""
        if (process := self._process) is not None:
            self._run_state.end_process(process, DEATH_TIMEOUT / 10)
            self._child = None


def _told(error: int) -> str:
    if error == HELD_BY_ANOTHER:
        return "kept values cannot be written: another run of this station with this wiring keeps its values"
    return f"kept values cannot be written: {os.strerror(error)}"


# The keeper's own process ---------------------------------------------------------------------------------


def _work(path: Path, title: KeptValues, reader: Reader, cells: Any, core: int | None) -> None:
    """Write kept values, in the child; never returns."""
    try:
        for number in STOP_SIGNALS:
            calls.handle_signal(number, signal.SIG_IGN)
        assert reader.ends is not None
        _close_all_but(reader.ends.alive)
        realtime.drop_realtime(
            niceness=0
        )  # its looks are due: where others have the processors, what is kept grows old
        realtime.leave_core(core)
        adjust_oom_score(OOM_SCORE_CHANGE)
        name_process("umo keeper")
        keep(reader, Writer(path, title, cells), writer_is_gone)
        cells[KeeperMessage.FINISHED] = 1
    finally:
        calls.exit_now(0)


ALIVE = 3
"""The only descriptor of the keeper: the pipe that hangs up when the writer of the frames has ended."""


def _close_all_but(alive: int) -> None:
    """Close all descriptors except that of the pipe. The frames stay mapped. Nothing is printed, because a terminal or
    a pipe of the starter must not stay open."""
    os.dup2(alive, ALIVE)
    null = calls.open(os.devnull, os.O_RDWR)
    for standard in range(ALIVE):
        os.dup2(null, standard)
    calls.close_from(ALIVE + 1)


def writer_is_gone(within: float) -> bool:
    """Wait up to this time in s for the end of the process that writes the frames. Return True if it has ended."""
    return bool(calls.ready(ALIVE, within, 0))


class Writer:
    """The writer of the kept data of a frame, if they have changed since the last write, and of the changes of
    alarms."""

    def __init__(
        self,
        path: Path,
        title: KeptValues,
        cells: Any,
        write: Callable[[Path, bytes], object] = kept_file.write,
    ) -> None:
        self._path, self._title, self._cells, self._write = path, title, cells, write
        self._history = AlarmHistory(cells[KeeperMessage.NEXT_EVENT])
        self._written: dict[str, Any] | None = None
        self._lock = -1

    def take(self, reader: Reader) -> None:
        frame = reader.latest()
        if frame is None:
            return
        self._keep(reader, frame)
        self._note_alarms(reader, frame)

    def _note_alarms(self, reader: Reader, frame: Any) -> None:
        try:
            self._history.take(reader, frame)
        except OSError as error:
            self._cells[KeeperMessage.HISTORY_ERROR] = error.errno or errno.EIO
            return
        self._cells[KeeperMessage.NEXT_EVENT] = self._history.next
        self._cells[KeeperMessage.HISTORY_ERROR] = 0

    def _keep(self, reader: Reader, frame: Any) -> None:
        snapshot = {name: section(frame) for name, section in sections_of(reader.layout).items()}
        if snapshot == self._written:
            return
        about = reader.about
        values = KeptValues(
            self._title.station, self._title.wiring, self._title.place, about["pid"], about["started"],
            int(frame["number"]), utc_of(frame), snapshot,
        )  # fmt: skip
        try:
            if not self._is_ours():
                self._cells[KeeperMessage.ERROR] = HELD_BY_ANOTHER
                return
            self._write(self._path, kept_file.dump(values))
        except OSError as error:
            self._cells[KeeperMessage.ERROR] = error.errno or errno.EIO
            return
        self._written = snapshot
        self._cells[KeeperMessage.ERROR] = 0

    def _is_ours(self) -> bool:
        """Return True if this process has the lock of the file. It keeps the lock until it ends."""
        if self._lock < 0:
            file = kept_file.lock_file(self._path)
            if not kept_file.take_lock(file):
                calls.close(file)
                return False
            self._lock = file
        return True


def keep(
    reader: Reader, writer: Writer, is_gone: Callable[[float], bool], now: Callable[[], float] | None = None
) -> None:
    """Write until the run has ended, then write the last frame. `is_gone`: the function that waits for the writer's
    end, at most for the given time in s. The time that the disk takes does not delay the next look, unless it is longer
    than `INTERVAL`."""
    now = now or calls.now
    gone, due = False, now()  # the first at once: it may take the place of a keeper that was killed
    while not gone:
        gone = is_gone(max(0.0, due - now())) or reader.is_finished
        due = now() + INTERVAL
        writer.take(reader)
