"""Other processes: whether they live, are stopped, or have ended; and the name of this one in lists of processes."""

from __future__ import annotations

import ctypes
import getpass
import os
import select
import signal
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import NoReturn

from umo.text import printable

HASH_SEED = "PYTHONHASHSEED"
"""Environment variable of the order of sets of texts, which a process takes at its start."""
PR_SET_NAME = 15
FLAGS, START, PROCESSOR, PRIORITY = 6, 19, 36, 37
"""Places in proc_pid_stat(5), counted from the state: flags, starttime, processor, rt_priority."""
BOOT = Path("/proc/sys/kernel/random/boot_id")
KERNEL_THREAD = 0x200000
STOPPED, ENDED = "Tt", "ZX"
"""States of processes that were stopped by a signal or a debugger, and of those that have ended."""
LOOK_INTERVAL = 0.0005
"""Time in s between two looks at a process."""
MAX_NAME_BYTES = 15
"""Bytes of the name of a process (prctl(2), PR_SET_NAME)."""


class ProcessHandle:
    """A process, known by a descriptor: no other process can take its place, as with its id (pidfd_open(2), Linux 5.3;
    by its id alone where that is refused)."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._poll: select.poll | None = None
        with suppress(OSError):
            self._file = os.pidfd_open(pid)
            self._poll = select.poll()
            self._poll.register(self._file, select.POLLIN)

    def send(self, number: int) -> None:
        """Send a signal, if the process has not ended."""
        with suppress(ProcessLookupError):
            if self._poll is None:
                os.kill(self.pid, number)
            else:
                signal.pidfd_send_signal(self._file, number)

    @property
    def ended(self) -> bool:
        """Whether it has ended: its files and connections are closed then."""
        if self._poll is not None:
            return bool(self._poll.poll(0))
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return True
        return False


def end_child(pid: int, within: float) -> bool:
    """Kill a child that nobody has waited for, and wait up to `within` s for its end; whether it has ended. One that is
    blocked in a call of the kernel ends after that call."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
    until = monotonic() + within
    with suppress(ChildProcessError):  # somebody else has waited for it
        while not os.waitpid(pid, os.WNOHANG)[0]:
            if monotonic() > until:
                return False
            sleep(LOOK_INTERVAL)
    return True


def adjust_oom_score(change: int) -> None:
    """Make the kernel take this process sooner, or (as far as permitted) later, when memory runs out: by so many
    thousandths of the memory (proc_pid_oom_score_adj(5))."""
    file = Path("/proc/self/oom_score_adj")
    with suppress(OSError, ValueError):
        file.write_text(str(max(-1000, min(1000, int(file.read_text()) + change))))


def carry_out(work: Callable[[], int]) -> NoReturn:
    """Do the work of a process that was forked and end it with the status that the work gives, 1 after an error, which
    is printed. Nothing of the process that it was forked from is run: no exit handlers, no callers."""
    status = 1
    try:
        status = work()
    except BaseException:
        with suppress(BaseException):
            sys.excepthook(*sys.exc_info())
    finally:
        flush()
        os._exit(status)


def flush() -> None:
    """Write what was printed. Before a fork: else the child would write it again."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()


def is_stopped(pid: int) -> bool:
    """Whether a process was stopped by a signal, or by a debugger."""
    return state(pid) in STOPPED


def state(pid: int) -> str:
    """R, S, D, T, t, Z as in proc_pid_stat(5); X where there is no such process."""
    return (_stat(pid) or ["X"])[0]


def identity(pid: int) -> str:
    """A text that no other process has, not even one that gets its number later, or after a restart of the computer;
    empty where there is no such process, or it cannot be told."""
    fields = _stat(pid)
    with suppress(OSError):
        return f"{BOOT.read_text().strip()} {pid} {fields[START]}" if len(fields) > START else ""
    return ""


def running_on(cores: Collection[int], but: Collection[int]) -> int | None:
    """A process under SCHED_FIFO or SCHED_RR, none of the kernel's, that now runs on one of these cores; the one of
    the highest priority. `but`: processes that are passed over."""
    found: list[tuple[int, int]] = []
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        fields = _stat(pid) if pid not in but else []
        if len(fields) <= PRIORITY or fields[0] != "R" or int(fields[FLAGS]) & KERNEL_THREAD:
            continue
        if int(fields[PROCESSOR]) in cores and int(fields[PRIORITY]):
            found.append((int(fields[PRIORITY]), pid))
    return max(found)[1] if found else None


def title_of(pid: int) -> str:
    """The station that a process drives, else its name; and its pid."""
    words: list[str] = []
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_text(errors="replace").split("\0")[:-1]
    name = words[-1] if "umo.process" in words else name_of(pid)
    return printable(f"{name or 'a process'} (pid {pid})")


def _stat(pid: int) -> list[str]:
    """The fields of proc_pid_stat(5) from the state on; empty where there is no such process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    return []


def name_process(text: str) -> None:
    """Name this process for lists of processes (`ps -o comm`)."""
    with suppress(OSError):
        ctypes.CDLL(None).prctl(PR_SET_NAME, text.encode()[:MAX_NAME_BYTES], 0, 0, 0)


def name_of(pid: int) -> str:
    """The name of a process in such lists; empty where there is no such process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/comm").read_text(errors="replace").strip()
    return ""


def user_name() -> str:
    """The name of this user, or the number of one without a name; "a user" where users have no numbers (Windows)."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return str(os.getuid()) if hasattr(os, "getuid") else "a user"
