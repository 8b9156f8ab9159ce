"""The states of other processes (alive, stopped or ended), and the name of this process in lists of processes.

This is the only module that sends signals to other processes and waits for children. The number of a process alone is
never sufficient to identify it. A process is ended, and waited for, by `ProcessHandle.end`.
"""

from __future__ import annotations

import ctypes
import getpass
import os
import re
import signal
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from umo.system import calls
from umo.text import printable

HASH_SEED = "PYTHONHASHSEED"
"""The environment variable for the order of sets of strings, which a process reads at its start."""
PR_SET_NAME = 15
PARENT, FLAGS, START, PROCESSOR, PRIORITY = 1, 6, 19, 36, 37
"""The indices of fields in proc_pid_stat(5), counted from the state: ppid, flags, starttime, processor, rt_priority."""
BOOT = Path("/proc/sys/kernel/random/boot_id")
KERNEL_THREAD, EXITING = 0x200000, 0x4
"""Flags of proc_pid_stat(5): PF_KTHREAD, PF_EXITING."""
STOPPED, ENDED = "Tt", "ZX"
"""The states of processes that were stopped by a signal or a debugger, and of processes that have ended."""
SIGKILL_PENDING = re.compile(r"^S\w\wPnd:\t[0-9a-f]*[13579bdf][0-9a-f]{2}$", re.M)
"""A line of proc_pid_status(5), SigPnd or ShdPnd: the masks of pending signals, in which SIGKILL is the ninth bit."""
LOOK_INTERVAL = 0.0005
"""The time in s between two checks of another process."""
MAX_NAME_BYTES = 15
"""The largest number of bytes of the name of a process (prctl(2), PR_SET_NAME)."""


class ProcessHandle:
    """A process, identified by a descriptor. Unlike a number, a descriptor never refers to another process later
    (pidfd_open(2), Linux 5.3). Without a descriptor, number and start time identify it.

    Make a handle only while the number certainly belongs to the process: for this process, for a child whose end was
    not awaited yet, or for the parent (`parent_of_this`). In other cases check the process afterwards (`known`,
    `RunState.process`).
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._file, self._maker = -1, os.getpid()
        self._started = ""
        with suppress(OSError):
            self._file = calls.open_process(pid)
        if self._file < 0:
            self._started = _start_time(pid)

    def __del__(self) -> None:
        if self._file >= 0 and self._maker == os.getpid():
            with suppress(OSError):
                calls.close(self._file)

    def send(self, number: int) -> None:
        """Send a signal, if the process has not ended."""
        with suppress(ProcessLookupError):
            if self._file >= 0:
                calls.signal_process(self._file, number)
            elif self._started and self._started == _start_time(self.pid):
                calls.kill(self.pid, number)

    @property
    def ended(self) -> bool:
        """True if the process has ended; then its files and connections are closed."""
        if self._file >= 0:
            return bool(calls.ready(self._file, 0.0))
        fields = _stat(self.pid)
        if len(fields) <= START or not self._started:
            return not is_used(self.pid)  # else it cannot be told
        return fields[0] in ENDED or fields[START] != self._started

    @property
    def state(self) -> str:
        """The state of the process: R, S, D, T, t, Z as in proc_pid_stat(5); X if the process has ended."""
        found = state(self.pid)
        return "X" if self.ended else found

    @property
    def is_stopped(self) -> bool:
        """True if the process was stopped by a signal or by a debugger."""
        return self.state in STOPPED

    @property
    def is_killed(self) -> bool:
        """True if the process is ending, or was killed and waits for a processor to end."""
        fields = _stat(self.pid)
        ending = len(fields) > FLAGS and bool(int(fields[FLAGS]) & EXITING)
        return ending or SIGKILL_PENDING.search(_status(self.pid)) is not None or self.ended

    def end(self, within: float, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Kill the process, and wait up to `within` s for its end. Return False if it has not ended, because it is
        blocked in the kernel. `meanwhile` is called between two looks."""
        self.send(signal.SIGKILL)
        return wait_until(lambda: self.ended, within, meanwhile)


class Child(ProcessHandle):
    """A child of the process that makes this object. Only this process waits for the child (waitpid(2)); until then no
    other process gets the child's number. A process that inherits this object by a fork notices the end of the child
    too, but not its status."""

    def __init__(self, pid: int) -> None:
        super().__init__(pid)
        self.status: int | None = None
        """Status with which the child ended (waitpid(2)); None if it has not ended, or if the status is unknown."""
        self.was_stopped = False
        """True if the child was stopped by a signal at the last check."""
        self._waited = False

    def send(self, number: int) -> None:
        if self._file >= 0 or self._maker != os.getpid():
            super().send(number)
        elif not self._waited:
            with suppress(ProcessLookupError):
                calls.kill(self.pid, number)

    @property
    def is_own(self) -> bool:
        """True if this process waits for the child."""
        return self._maker == os.getpid()

    @property
    def ended(self) -> bool:
        if self._maker != os.getpid():
            return super().ended
        if not self._waited:
            try:
                pid, status = calls.wait(self.pid)
            except ChildProcessError:  # the kernel has let go of it: SIGCHLD is ignored
                self._waited = True
            else:
                self.was_stopped |= bool(pid) and os.WIFSTOPPED(status)
                if pid and not os.WIFSTOPPED(status):
                    self._waited, self.status = True, status
        return self._waited


def wait_until(is_so: Callable[[], bool], within: float, meanwhile: Callable[[], object] = lambda: None) -> bool:
    """Wait up to `within` s until the function returns True. Return whether it did. `meanwhile` is called between two
    looks."""
    until = calls.now() + within
    while not is_so():
        if calls.now() >= until:
            return False
        meanwhile()
        calls.sleep(LOOK_INTERVAL)
    return True


def known(pid: int, text: str) -> ProcessHandle | None:
    """Return the process that had this `identity`, or None if it has ended."""
    handle = ProcessHandle(pid)
    return handle if text and identity(pid) == text else None  # it lives, so it had the number before


def parent_of_this(pid: int) -> ProcessHandle | None:
    """Return the process from which this one was forked, if it still lives."""
    handle = ProcessHandle(pid)
    return handle if os.getppid() == pid else None


def is_used(pid: int) -> bool:
    """Return True if some process has this number. It may be another process than the one that had the number before,
    so do nothing to it."""
    try:
        calls.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def wait_for_any() -> bool:
    """Release the children that have ended, including adopted ones. Return whether there are other children."""
    with suppress(ChildProcessError):
        while calls.wait(-1)[0]:
            pass
        return True
    return False


def adjust_oom_score(change: int) -> None:
    """Make the kernel kill this process sooner or (if this is permitted) later when memory runs out, by thousandths of
    the memory (proc_pid_oom_score_adj(5))."""
    file = Path("/proc/self/oom_score_adj")
    with suppress(OSError, ValueError):
        file.write_text(str(max(-1000, min(1000, int(file.read_text()) + change))))


def carry_out(work: Callable[[], int]) -> NoReturn:
    """Do the work of a forked process and end the process with the status that the work returns. After an error, which
    is printed, the status is 1. No code of the original process is run: no exit handlers, no callers."""
    status = 1
    try:
        status = work()
    except BaseException:
        with suppress(BaseException):
            sys.excepthook(*sys.exc_info())
    finally:
        flush()
        calls.exit_now(status)


def flush() -> None:
    """Write the text that was printed and is still buffered. Call this before a fork; otherwise the child would write
    the text again."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()


def state(pid: int) -> str:
    """Return the state of a process: R, S, D, T, t, Z as in proc_pid_stat(5); X if there is no such process."""
    return (_stat(pid) or ["X"])[0]


def parent_of(pid: int) -> int:
    """Return the number of the parent of a process; 0 if there is no parent, or the parent is unknown."""
    fields = _stat(pid)
    return int(fields[PARENT]) if len(fields) > PARENT else 0


def first_with(files: Collection[str]) -> int | None:
    """Return a process that has one of these files open, each as proc_pid_fd(5) has it (`socket:[4711]`). Return None
    if there is none, or if this user may not see it."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        folder = f"/proc/{pid}/fd"
        with suppress(OSError):  # of another user, or ended meanwhile
            for file in os.listdir(folder):
                with suppress(OSError):
                    if os.readlink(f"{folder}/{file}") in files:
                        return int(pid)
    return None


def _start_time(pid: int) -> str:
    """Return the start time of a process as text, in clock ticks since the start of the computer; empty if there is no
    such process, or the time is unknown."""
    fields = _stat(pid)
    return fields[START] if len(fields) > START else ""


def start_of(pid: int) -> int:
    """Return the start time of a process in clock ticks since the start of the computer; 0 if unknown."""
    return int(_start_time(pid) or 0)


def identity(pid: int) -> str:
    """Return a text that identifies a process uniquely, also if its pid is used again later or after a restart of the
    computer. The text is empty if there is no such process, or nothing is known about it."""
    with suppress(OSError):
        return f"{BOOT.read_text().strip()} {pid} {started}" if (started := _start_time(pid)) else ""
    return ""


def running_on(cores: Collection[int], but: Collection[int]) -> int | None:
    """Return the process of the highest priority that now runs under SCHED_FIFO or SCHED_RR on one of these cores,
    except processes of the kernel. `but`: the processes to ignore."""
    found: list[tuple[int, int]] = []
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        fields = _stat(pid) if pid not in but else []
        if len(fields) <= PRIORITY or fields[0] != "R" or int(fields[FLAGS]) & KERNEL_THREAD:
            continue
        if int(fields[PROCESSOR]) in cores and int(fields[PRIORITY]):
            found.append((int(fields[PRIORITY]), pid))
    return max(found)[1] if found else None


def title_of(pid: int) -> str:
    """Return the name of the station that a process drives, or else the name of the process, with its pid."""
    words: list[str] = []
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(errors="replace").split("\0")[:-1]
    name = words[-1] if "umo.process" in words else name_of(pid)
    return printable(f"{name or 'a process'} (pid {pid})")


def _stat(pid: int) -> list[str]:
    """Return the fields of proc_pid_stat(5) from the state on; empty if there is no such process."""
    return calls.stat_of(pid).rpartition(")")[2].split()


def _status(pid: int) -> str:
    """Return the text of proc_pid_status(5); empty if there is no such process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/status").read_text(errors="replace")
    return ""


def name_process(text: str) -> None:
    """Name this process for lists of processes (`ps -o comm`)."""
    with suppress(OSError):
        ctypes.CDLL(None).prctl(PR_SET_NAME, text.encode()[:MAX_NAME_BYTES], 0, 0, 0)


def name_of(pid: int) -> str:
    """Return the name of a process in lists of processes; empty if there is no such process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/comm").read_text(errors="replace").strip()
    return ""


def user_name() -> str:
    """Return the name of this user, or the number of a user without a name; "a user" if users have no numbers
    (Windows)."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return str(os.getuid()) if hasattr(os, "getuid") else "a user"
