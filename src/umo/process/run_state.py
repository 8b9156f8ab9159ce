"""The memory that the processes of a run share: locks that report the death of their owners, heartbeats, and reports.

A lock is a process-shared, robust pthread mutex: the kernel passes it on with EOWNERDEAD while the dead process is
still being removed, 0.2 ms after a SIGKILL; waiting for the exit took up to 30 ms with locked memory (POSIX.1-2017,
pthread_mutexattr_setrobust). Nothing here needs a descriptor, so the control process cannot damage the memory through
its descriptors.
"""

from __future__ import annotations

import errno
import mmap
import os
from collections.abc import Callable
from enum import IntEnum

from umo.cycle.stage import Stage
from umo.errors import UmoError
from umo.system import calls
from umo.system.processes import STOPPED, Child, ProcessHandle, start_of, state, wait_until
from umo.system.shared_cells import HEAD, SharedText


class Who(IntEnum):
    """The processes that hold a lock as long as they live."""

    CONTROL = 0
    GUARDIAN = 1
    STANDBY = 2
    RESET = 3
    """The child that resets the machine, while it works."""
    RESERVE = 4
    """The child of the guardian that waits to reset the machine."""
    KEEPER = 5
    """The process that writes kept values."""


FOLLOWERS = (Who.STANDBY, Who.RESERVE)
"""The processes that take the guardian's place."""


STAGE, BEAT, ASKED, WATCH, ADMITTED, CONCLUDING, EXCUSED, TOLD = range(8)
CELLS = 16
MAX_REPORT_BYTES = 1 << 16
"""Largest length of a report, in bytes."""
HOLD_LIMIT = 1.0
"""The timeout in s for the lock of this process. Other processes take the lock for microseconds to test it."""
TEST_TIME = 0.002
"""The time in s for which the lock of a dead process can seem to be held, because another process tests the lock."""
STOPPED_TIMEOUT = 0.2
"""The time in s for which a forked process may be stopped (SIGSTOP, a debugger) before it holds its lock."""
FORK_TIMEOUT = 2.0
"""The timeout in s for a forked process to take its lock. It needs 1 ms of a processor, which other processes may
use."""
FORK_LOOK_INTERVAL = 0.02
"""The time in s between two checks of a process that does not hold its lock yet."""
END_TIMEOUT = 5.0
"""Timeout in s for the end of a process that was killed because it did not take its lock."""
REPORT_AT = 8 * CELLS
REPORT_BYTES = HEAD.size + MAX_REPORT_BYTES
OUTCOME_AT = REPORT_AT + REPORT_BYTES
PIDS_AT = OUTCOME_AT + REPORT_BYTES


class NotBegun(UmoError, OSError):
    """A forked process has not taken its lock."""


def worker(number: int) -> int:
    """Return the holder of the lock of a worker process, by its number from 0."""
    return len(Who) + number


class RunState:
    """The shared memory of a run, made by the guardian before it forks. `workers`: the number of worker processes. The
    clock of the heartbeats continues while the computer is suspended (`calls.boottime_ns`)."""

    def __init__(self, workers: int = 0) -> None:
        count = len(Who) + workers
        first = PIDS_AT + 2 * 8 * count
        places = range(first, first + calls.MUTEX_BYTES * count, calls.MUTEX_BYTES)
        self._memory = mmap.mmap(-1, places.stop)  # anonymous and shared
        self._locks = [calls.make_mutex(self._memory, at) for at in places]
        self._held: dict[int, int] = {}
        """The locks that this process holds, each with the pid of this process, because a forked process holds none of
        them."""
        self._cells = memoryview(self._memory)[:REPORT_AT].cast("q")
        numbers = memoryview(self._memory)[PIDS_AT:first].cast("q")
        self._pids, self._starts = numbers[:count], numbers[count:]
        self._report = SharedText(self._memory, REPORT_AT, REPORT_BYTES)
        self._outcome = SharedText(self._memory, OUTCOME_AT, REPORT_BYTES)
        self.watch()
        self.enter(Stage.STARTING)

    # Every process -------------------------------------------------------------------------------------

    def fork(self, who: int) -> int:
        """Fork a process in a new session. When this function returns in the parent, the forked process holds its lock.
        The function returns 0 in the child. Raises OSError if no process or pipe is available, or if the process does
        not take its lock; then the process is ended."""
        held, holding = calls.pipe()
        try:
            pid = calls.fork()
        except OSError:
            calls.close(held)
            calls.close(holding)
            raise
        if pid:
            calls.close(holding)
            why = self._not_holding(pid, held)
            calls.close(held)
            if why:
                self.end_process(Child(pid), END_TIMEOUT)
                raise NotBegun(f"a process that was forked {why}")
            return pid
        calls.close(held)
        calls.new_session()
        self.hold(who)
        calls.close(holding)
        return 0

    def _not_holding(self, pid: int, held: int) -> str:
        """Wait until a child holds its lock and closes its end of the pipe, or is dead, and return "". Otherwise return
        why it is no longer waited for. The waiting guardian sends heartbeats."""
        begun = able = calls.now()
        while not calls.ready(held, FORK_LOOK_INTERVAL, 0):
            self.watch()
            now = calls.now()
            able = able if state(pid) in STOPPED else now
            if now - able >= STOPPED_TIMEOUT:
                return "was stopped by a signal before it had begun"
            if now - begun >= FORK_TIMEOUT:
                return f"did not begin within {FORK_TIMEOUT:g} s"
            if self.admitted and self.gone(0.0):
                return "was ended before it had begun, because the machine must be reset"
        return ""

    def hold(self, who: int, within: float = HOLD_LIMIT) -> bool:
        """Take a lock, so that from now on other processes detect the death of this thread. Wait up to `within` s for a
        former holder, which it may be impossible to kill. Return True if the lock was taken."""
        taken = self._take(who, within)
        if taken:  # numbers are written by the holder of the lock alone
            self._pids[who] = 0
            self._starts[who] = start_of(os.getpid())
            self._pids[who] = self._held[who] = os.getpid()
        return taken

    def release(self, who: int) -> None:
        """Release a lock that this process has taken."""
        self._held.pop(who, None)
        self._pids[who] = 0
        calls.unlock_mutex(self._locks[who])

    def holds(self, who: int) -> bool:
        """Return True if this process holds that lock."""
        return self._held.get(who) == os.getpid()

    def process(self, who: int) -> ProcessHandle | None:
        """Return the living holder of a lock, or None if there is none or if the holder has just taken the lock. If a
        process holds the lock after its descriptor was opened, its pid does not belong to another process. The time of
        its start proves that the pid does not come from a dead holder."""
        pid, started = int(self._pids[who]), int(self._starts[who])
        if not pid or self.gone(0.0, who):
            return None
        handle = ProcessHandle(pid)
        is_holder = not started or start_of(pid) == started
        return handle if is_holder and not self.gone(TEST_TIME, who) and int(self._pids[who]) == pid else None

    def is_able(self, who: int) -> bool:
        """Return True if the holder of a lock lives and can act: it was neither stopped nor killed."""
        process = self.process(who)
        return process is not None and not (process.is_stopped or process.is_killed)

    def end(self, who: int, within: float) -> bool:
        """Kill the holder of a lock, if there is one, and wait up to `within` s. Return True if it has ended."""
        process = self.process(who)
        return self.wait(lambda: self.gone(0.0, who), within) if process is None else self.end_process(process, within)

    def end_process(self, process: ProcessHandle, within: float) -> bool:
        """Kill a process, and wait up to `within` s. Return True if it has ended."""
        return process.end(within, self.watch)

    def wait(self, is_so: Callable[[], bool], within: float) -> bool:
        """Wait up to `within` s until the condition is true, and return whether it is. A guardian, or its successor,
        waits for another process only in this way, because it gives heartbeats during the wait."""
        return wait_until(is_so, within, self.watch)

    def gone(self, within: float, who: int = Who.CONTROL) -> bool:
        """Wait up to `within` s for the holder of a lock to die. Return True if the holder has died, or if the lock was
        never held."""
        if within <= 0:
            return not calls.mutex_is_held(self._locks[who])
        if not self._take(who, within):
            return False
        calls.unlock_mutex(self._locks[who])
        return True

    def _take(self, who: int, within: float) -> bool:
        """Wait up to `within` s for a lock. Return True if it is taken."""
        answer = calls.lock_mutex(self._locks[who], within)
        if answer == errno.EOWNERDEAD:
            self._pids[who] = 0  # of the dead process
        return answer != errno.ETIMEDOUT

    # The control process -------------------------------------------------------------------------------

    def enter(self, stage: Stage) -> None:
        self._cells[STAGE] = stage
        self.beat()

    def beat(self) -> float:
        """Give a heartbeat; call this in every period while running. Return the time in s since the previous
        heartbeat."""
        cells, now = self._cells, calls.boottime_ns()
        before = cells[BEAT]
        cells[BEAT] = now
        return (now - before) * 1e-9

    @property
    def admitted(self) -> bool:
        """True if the control process may begin: every process that can reset the machine exists."""
        return bool(self._cells[ADMITTED])

    @property
    def excused(self) -> float:
        """The time in s since the last heartbeat for which other processes kept this process from running, as measured
        by the guardian."""
        return self._cells[EXCUSED] * 1e-9

    @property
    def unwatched(self) -> float:
        """Time in s since the last look of the guardian."""
        return (calls.boottime_ns() - self._cells[WATCH]) * 1e-9

    @property
    def asked(self) -> int:
        """The signal with which the guardian requested a stop; 0 for none."""
        return int(self._cells[ASKED])

    def report(self, text: bytes) -> None:
        """Write the report of the end. A report that is too long is dropped; the guardian then treats it as invalid."""
        _put(self._report, text)

    # The guardian --------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Give a heartbeat of the guardian."""
        self._cells[WATCH] = calls.boottime_ns()

    def admit(self) -> None:
        self._cells[ADMITTED] = 1

    def excuse(self, seconds: float) -> None:
        """Record the time in s for which other processes kept the control process from running."""
        self._cells[EXCUSED] = round(seconds * 1e9)

    @property
    def last_watch(self) -> int:
        """The time of the guardian's last heartbeat, in ns on `calls.boottime_ns`."""
        return int(self._cells[WATCH])

    def ask(self, number: int) -> None:
        """Request the control process to stop, like this signal."""
        self._cells[ASKED] = number

    @property
    def stage(self) -> Stage:
        try:
            return Stage(self._cells[STAGE])
        except ValueError:  # the control process may write anything
            return Stage.RUNNING

    @property
    def last_beat(self) -> int:
        """The time of the last heartbeat, in ns on `calls.boottime_ns`."""
        return int(self._cells[BEAT])

    @property
    def silence(self) -> float:
        """The time in s since the last heartbeat."""
        return (calls.boottime_ns() - self._cells[BEAT]) * 1e-9

    def reported(self) -> bytes:
        """Return the report of the control process at its end."""
        return _get(self._report)

    def conclude(self) -> None:
        """Record that the guardian resets, records or reports the end from now on: its heartbeats may be far apart."""
        self.watch()
        self._cells[CONCLUDING] = 1

    @property
    def concluding(self) -> bool:
        """True if the guardian has begun to reset, record or report the end."""
        return bool(self._cells[CONCLUDING])

    def settle(self, text: bytes) -> None:
        """Store the outcome, because the machine is reset. The outcome remains if the guardian dies before it has
        recorded and printed it."""
        _put(self._outcome, text)
        self.conclude()

    def note_told(self) -> None:
        """Record that the end is recorded and printed, so that no process takes over any more."""
        self._cells[TOLD] = 1

    @property
    def told(self) -> bool:
        """True if the end is recorded and reported."""
        return bool(self._cells[TOLD])

    def settled(self) -> bytes:
        """Return the outcome; empty before there is one."""
        return _get(self._outcome)


def _put(place: SharedText, text: bytes) -> None:
    place.put(1, text if len(text) <= MAX_REPORT_BYTES else b"")


def _get(place: SharedText) -> bytes:
    """Return the stored bytes; empty if they are incomplete because their writer was killed or stopped while
    writing."""
    found = place.get()
    return b"" if found is None else found[1]
