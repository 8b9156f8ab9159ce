"""The real-time settings of a process that the operating system permits, and a list of those that it refuses."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from math import floor
from pathlib import Path
from typing import NamedTuple

from umo.system import calls
from umo.system.processes import user_name

try:
    import resource
except ImportError:  # not on this platform
    resource = None  # type: ignore[assignment]

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
MADV_WILLNEED, MADV_POPULATE_READ, MADV_POPULATE_WRITE = 3, 22, 23
IDLE_BYTES = 16 << 20
"""Smallest size in bytes of an anonymous mapping that counts as a library's buffer."""
IDLE_LIBRARIES = ("blas", "gfortran", "quadmath", "pydantic", "libcrypto", "libssl", "unicodedata", "_decimal")
"""The parts of names that identify libraries that no loop calls."""
LARGE_LIBRARIES = ("_multiarray_umath", "libstdc++")
"""The parts of names that identify libraries of which a loop uses only a small part."""
BUSY_WAIT = 200e-6
"""Time in s for waking up and cache warming (docs/decisions/0018)."""
SLEEPLESS = 100e-6
"""The longest period in s in which a loop with compiled laws and its own core does not sleep: waking up takes as
long."""
PR_SET_CHILD_SUBREAPER = 36
PR_SET_TIMERSLACK = 29
CAP_IPC_LOCK = 14
LIMITS = "/etc/security/limits.d/umo.conf, then a new login"
ISOLATED = Path("/sys/devices/system/cpu/isolated")
CORE_SOCKET_NAME = "umo core"
MAX_PLACES = 16
"""The largest number of places on one core."""


class Refusal(NamedTuple):
    """A setting that was not permitted: its name, the reason, and the line of configuration that permits it."""

    what: str
    why: str
    grant: str

    def __str__(self) -> str:
        return f"{self.what} ({self.why}): {self.grant}"


def prepare(priority: int = 80, cpu: int | None = None) -> list[Refusal]:
    """Freeze the garbage collector and switch it off, lock the memory, set SCHED_FIFO at `priority` (1 to 99), and
    reserve a core. Return the settings that were refused.

    Without `cpu` the process is pinned only under SCHED_FIFO: to an isolated core, or else to the last core. Under
    another policy it could not avoid a busy process on that core. Never raises."""
    gc.collect()
    gc.freeze()
    gc.disable()
    if not sys.platform.startswith("linux"):
        return [Refusal("no real time", f"this is {sys.platform}", "Linux")]
    with suppress(OSError):
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)
    scheduled = use_fifo(priority)
    refusals = [lock_memory(), scheduled, pin(cpu, scheduled is None)]
    return [refusal for refusal in refusals if refusal is not None]


def granted() -> tuple[int, int | None]:
    """Return the settings of this process. The first is its priority under SCHED_FIFO, or 0 without SCHED_FIFO. The
    second is its core if the process is pinned to one core and its parent is not pinned to the same core, otherwise
    None."""
    if not sys.platform.startswith("linux"):
        return 0, None
    fifo = os.sched_getscheduler(0) == getattr(os, "SCHED_FIFO", None)
    cores = os.sched_getaffinity(0)
    alone = len(cores) == 1 and cores != os.sched_getaffinity(os.getppid())
    return os.sched_getparam(0).sched_priority if fifo else 0, next(iter(cores)) if alone else None


def busy_wait_for(period: float, compiled: bool = False) -> float:
    """Return the time, in whole us, of busy waiting before each tick of a loop with this period in s: at most half of
    the period. With compiled laws and a period of at most `SLEEPLESS` it is the whole period."""
    most = longest_busy_wait(period) if compiled else period / 2
    return min(BUSY_WAIT, floor(most * 1e6 + 1e-6) * 1e-6)


def longest_busy_wait(period: float) -> float:
    """Return the longest permitted time in s of busy waiting before each tick: half of the period, or the whole period
    if it is at most `SLEEPLESS`."""
    return period if period <= SLEEPLESS else period / 2


def default_busy_wait(period: float, compiled: bool = False) -> float:
    """Return the default, which is 0 unless the process has both SCHED_FIFO and a reserved core."""
    priority, core = granted()
    return busy_wait_for(period, compiled) if priority and core is not None else 0.0


def prepare_guardian(priority: int, cpu: int | None = None) -> None:
    """Set the guardian's priority one above that of the control process, so that an endless loop there cannot block the
    guardian. Also keep the guardian off the core that `prepare` takes with the same arguments. Both are done only if
    the operating system permits them."""
    if not sys.platform.startswith("linux"):
        return
    leave_core(choose_core(cpu, use_fifo(priority + 1) is None))


def leave_core(core: int | None) -> None:
    """Run only on cores other than this one, if there are any and the operating system permits this. With None nothing
    changes."""
    allowed = os.sched_getaffinity(0) if sys.platform.startswith("linux") else set()
    if core in allowed and len(allowed) > 1:
        with suppress(OSError):
            os.sched_setaffinity(0, allowed - {core})


def adopt_orphans(yes: bool) -> None:
    """Set whether descendants of this process become its children when their parents end (prctl(2))."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(yes), 0, 0, 0)


def drop_realtime(niceness: int = 10) -> None:
    """Make this process an ordinary process again, for work of the guardian's children that is not urgent."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.nice(niceness)


def lock_memory() -> Refusal | None:
    """Lock all memory of this process, so that no page is removed or first used in the loop (mlockall(2)).

    The memory is locked only if there is no limit, because with a limit a later allocation would fail."""
    what = "memory is not locked"
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit != resource.RLIM_INFINITY and not _capable(CAP_IPC_LOCK):
        return Refusal(what, f"ulimit -l is {limit // 1024} kB", f"`{user_name()} - memlock unlimited` in {LIMITS}")
    libc = ctypes.CDLL(None, use_errno=True)
    flags = MCL_CURRENT | MCL_FUTURE
    if touch_memory(libc):
        flags |= MCL_ONFAULT  # all that is in use has been touched, the rest is left alone
    if libc.mlockall(flags) < 0:
        return Refusal(what, os.strerror(ctypes.get_errno()), f"`{user_name()} - memlock unlimited` in {LIMITS}")
    return None


def touch_memory(libc: ctypes.CDLL) -> bool:
    """Touch all memory of this process except two idle parts. The first part is 70 MB that no loop needs: buffers and
    code of numpy's linear algebra, and of modules that only read wirings. The second part is 10 MB of code of numpy and
    the C++ library that has not run yet. Its first use in the loop is a page fault, which takes 4 us for 16 pages.
    Return False if the kernel cannot do this (madvise(2), Linux 5.14); then lock everything."""
    touched = False
    for line in Path("/proc/self/maps").read_text().splitlines():
        words = line.split()
        first, last = (int(word, 16) for word in words[0].split("-"))
        if "r" not in words[1] or words[-1].startswith("[v") or (last - first >= IDLE_BYTES and len(words) == 5):
            continue
        if any(name in words[-1] for name in IDLE_LIBRARIES):
            continue
        if "w" in words[1]:
            how = MADV_POPULATE_WRITE
        elif any(name in words[-1] for name in LARGE_LIBRARIES):
            how = MADV_WILLNEED
        else:
            how = MADV_POPULATE_READ
        done = libc.madvise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), how) == 0
        touched |= done and how != MADV_WILLNEED
    return touched


def use_fifo(priority: int) -> Refusal | None:
    """Give this process precedence over every ordinary process (sched(7), SCHED_FIFO)."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        why = f"ulimit -r is {limit}" if isinstance(error, PermissionError) else str(error.strerror)
        return Refusal("no real-time scheduling", why, f"`{user_name()} - rtprio 95` in {LIMITS}")
    return None


def pin(cpu: int | None, fifo: bool) -> Refusal | None:
    """Pin this process to one core."""
    cpu = choose_core(cpu, fifo)
    if cpu is None:
        return None
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError as error:
        cores = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
        return Refusal(f"not pinned to core {cpu}", str(error.strerror), f"`cpu` in the wiring's [process]: {cores}")
    return None


def choose_core(cpu: int | None, fifo: bool) -> int | None:
    """Return the requested core. Without a request, under SCHED_FIFO and if more than one core is allowed, return an
    isolated core or else the last one."""
    allowed = sorted(os.sched_getaffinity(0))
    if cpu is not None or not fifo or len(allowed) < 2:
        return cpu
    isolated = [core for core in isolated_cores() if core in allowed]
    return isolated[0] if isolated else allowed[-1]


def isolated_cores() -> list[int]:
    """Return the cores that the kernel keeps free (isolcpus=)."""
    cores: list[int] = []
    with suppress(OSError, ValueError):
        for part in filter(None, ISOLATED.read_text().strip().split(",")):
            first, _, last = part.partition("-")
            cores.extend(range(int(first), int(last or first) + 1))
    return cores


def _capable(capability: int) -> bool:
    with suppress(OSError, ValueError, IndexError):
        status = Path("/proc/self/status").read_text()
        return bool(int(status.partition("CapEff:")[2].split()[0], 16) >> capability & 1)
    return False


class CorePlace:
    """A place on the core with the fewest other places, or on `cpu`, for the control process that the calling process
    starts. A place is taken like a device (`device_lock`), by an abstract Unix socket with its name: atomically and
    among all users. The kernel releases the place at the latest when the last process that has it ends."""

    def __init__(self, cpu: int | None = None) -> None:
        self.core: int | None = cpu
        """The core; None if no core is reserved, because there is only one."""
        self._socket: calls.Socket | None = None
        for core, number in _places(cpu):
            with suppress(OSError):
                name = f"\0{CORE_SOCKET_NAME} {core} {number}".encode()
                self.core, self._socket = core, calls.take_name(name, calls.DATAGRAM)
                return

    def release(self) -> None:
        """Release the place. A forked process keeps the place until it ends or releases the place, too."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _places(cpu: int | None) -> Iterator[tuple[int, int]]:
    """Yield cores, each with the number of a place on it, in the order in which they are tried. Cores without other
    places come first; among these, isolated cores, then the core with the highest number."""
    allowed, isolated = os.sched_getaffinity(0), set(isolated_cores())
    if cpu is None and len(allowed) < 2:
        return
    cores = sorted(allowed, key=lambda core: (core in isolated, core), reverse=True) if cpu is None else [cpu]
    for number in range(MAX_PLACES):
        for core in cores:
            yield core, number
