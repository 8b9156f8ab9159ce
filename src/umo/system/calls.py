"""The boundary to the operating system: all functions of it that the processes of a run, the timer and the device lock
use.

`umo.process`, `umo.generate.split`, `umo.drivers.timerfd` and `umo.system.device_lock` use no other function of the
operating system that waits, reads the time, or has an effect on another process. No function here decides or stores
anything. So a test can put a gate in front of each function: the gate replaces the function in this module, and calls
the real function.

A function is called through the module, when it is needed:

    from umo.system import calls

    calls.sleep(0.1)

A function is never imported by its name, and never stored when a module is imported (in a constant, the default of an
argument or the body of a class), because a gate that is added later would have no effect. An object may store a
function at its construction: the timer does so, because it calls some functions in every period.
`tests/process/test_calls.py` and the import contracts check this rule.

Two things do not use these functions: memory that processes share (the methods of `RunState` and `ResetState` can be
replaced), and a period that is carried out in C (`compile = true`), which waits for the timer by itself.
"""

from __future__ import annotations

import ctypes
import errno
import os
import select
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from mmap import mmap
from pathlib import Path
from types import FrameType
from typing import IO, NoReturn

try:
    import fcntl
except ImportError:  # this platform has none
    fcntl = None  # type: ignore[assignment]

FilePath = str | os.PathLike[str]
SignalHandler = Callable[[int, FrameType | None], object] | int | None
"""The argument and the result of `signal.signal`."""

# Processes ------------------------------------------------------------------------------------------------

PR_SET_PDEATHSIG = 1


def fork() -> int:
    """Fork this process (fork(2)). Return the child's number; return 0 in the child. Raises OSError if no process can
    be created."""
    return os.fork()


def start_program(words: Sequence[str], files: Sequence[int], environ: Mapping[str, str]) -> int:
    """Start a program in a new session, and return its number. The program inherits these descriptors in addition to
    stdout and stderr. It is a child of this process: call `wait` for it. Raises OSError if it cannot be started."""
    program = subprocess.Popen(
        words, pass_fds=files, stdin=subprocess.DEVNULL, start_new_session=True, env=dict(environ)
    )
    program.returncode = 0  # else its object would wait for it too
    return program.pid


def exit_now(status: int) -> NoReturn:
    """End this process without exit handlers, and without writing text that is still buffered (_exit(2))."""
    os._exit(status)


def wait(pid: int) -> tuple[int, int]:
    """Return the number and status (waitpid(2)) of a child that has ended or was stopped by a signal. `pid`: the number
    of the child; -1 means any child. Returns (0, 0) if no such child has ended or stopped yet. Never waits. Raises
    ChildProcessError if the process has no such child at all."""
    return os.waitpid(pid, os.WNOHANG | os.WUNTRACED)


def kill(pid: int, number: int) -> None:
    """Send a signal to the process that has this number (kill(2)); 0 only checks that it exists. Raises
    ProcessLookupError if there is no such process, PermissionError if it belongs to another user."""
    os.kill(pid, number)


def open_process(pid: int) -> int:
    """Return a descriptor of a process, which is `ready` when the process has ended (pidfd_open(2), Linux 5.3). Raises
    OSError if there is no such process or no descriptor is available."""
    return os.pidfd_open(pid)


def signal_process(file: int, number: int) -> None:
    """Send a signal to the process of a descriptor (pidfd_send_signal(2)). Raises ProcessLookupError if it has
    ended."""
    signal.pidfd_send_signal(file, number)


def stat_of(pid: int) -> str:
    """Return the text of proc_pid_stat(5); empty if there is no such process."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(errors="replace")
    return ""


def new_session() -> None:
    """Make this process the leader of a new session and process group (setsid(2)), so that a signal to another group or
    session does not reach it."""
    os.setsid()


def die_with_parent(parent: int, number: int) -> None:
    """Have the kernel send this signal to this process when the process `parent` (pid) ends for any reason
    (PR_SET_PDEATHSIG). If the parent has already ended, the signal is sent immediately."""
    _libc().prctl(PR_SET_PDEATHSIG, number, 0, 0, 0)
    if os.getppid() != parent:
        signal.raise_signal(signal.Signals(number))


# Signals --------------------------------------------------------------------------------------------------


def handle_signal(number: int, handler: SignalHandler) -> SignalHandler:
    """Set the handler of a signal: this function, SIG_IGN or SIG_DFL. Return the former handler. Raises ValueError in a
    thread other than the main thread."""
    return signal.signal(number, handler)


def mask_signals(how: int, numbers: Iterable[int]) -> set[int]:
    """Block (SIG_BLOCK) or unblock these signals in this thread, or block exactly these signals (SIG_SETMASK). Return
    the signals that were blocked before."""
    return {int(number) for number in signal.pthread_sigmask(how, numbers)}


def set_alarm(first: float, interval: float = 0.0) -> None:
    """Have SIGALRM sent to this process after `first` s, then every `interval` s (0: once). 0 s: never."""
    signal.setitimer(signal.ITIMER_REAL, first, interval)


# Descriptors ----------------------------------------------------------------------------------------------

INPUT = getattr(select, "POLLIN", 1)
"""The event that there is something to read, or that a process has ended."""
HUNG_UP = getattr(select, "POLLHUP", 16) | getattr(select, "POLLERR", 8)
"""The event that the other end is closed."""

read = os.read
"""Read up to this number of bytes from a descriptor (read(2)). From a timer, 8 bytes are read after its next expiry.
The function waits if there is nothing to read: callers call `ready` first, or another process or a stop ends the
wait."""


def write(file: int, data: bytes) -> int:
    """Write to a descriptor (write(2)). Return the number of bytes that were written."""
    return os.write(file, data)


def open(path: FilePath, flags: int, mode: int = 0o777) -> int:
    """Open a file (open(2)) with a descriptor that no program inherits, and return the descriptor. Raises OSError if it
    cannot be opened."""
    return os.open(path, flags, mode)


def close(file: int) -> None:
    """Close a descriptor."""
    os.close(file)


def close_from(first: int) -> None:
    """Close every descriptor from this number on."""
    os.closerange(first, os.sysconf("SC_OPEN_MAX"))


def pipe() -> tuple[int, int]:
    """Create a pipe. Return its two ends: one to read from, and one to write to. Raises OSError if no descriptors are
    available."""
    return os.pipe()


def ready(file: int, within: float, awaited: int = INPUT) -> int:
    """Wait up to `within` s until there is something to read or the other end is closed. Return the events of poll(2),
    0 for none. `awaited` = 0: wait only until the other end is closed."""
    poll = select.poll()
    poll.register(file, awaited)
    return next((events for _, events in poll.poll(within * 1e3)), 0)


# Sockets --------------------------------------------------------------------------------------------------

Socket = socket.socket
STREAM, DATAGRAM = socket.SOCK_STREAM, socket.SOCK_DGRAM
INT = struct.Struct("i")


def message_sockets(room: int) -> tuple[Socket, Socket]:
    """Return two ends of a connection for messages (unix(7), SOCK_SEQPACKET), with a buffer for this number of
    bytes."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, room)
    return ends


def socket_of(file: int) -> Socket:
    """Return the socket of an inherited descriptor."""
    return socket.socket(fileno=file)


def send_message(connection: Socket, data: bytes, files: Sequence[int] = ()) -> None:
    """Send one message and hand over descriptors with it (SCM_RIGHTS). This function never waits: it raises OSError if
    there is no room for the message. (`socket.send_fds` and `recv_fds` drop their flags, up to Python 3.13: a call
    would wait for a peer whose buffer is full, and started programs would inherit the received descriptors.)"""
    rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, struct.pack(f"{len(files)}i", *files))] if files else []
    connection.sendmsg([data], rights, socket.MSG_DONTWAIT)


def receive_message(connection: Socket, size: int, most: int) -> tuple[bytes, list[int]]:
    """Return the next message, of up to `size` bytes, and up to `most` descriptors that came with it. The receiver must
    close the descriptors. Programs that it starts do not inherit them. An empty message means that the peer has ended.
    The function waits like the socket, so callers call `ready` first or set a timeout."""
    room = socket.CMSG_LEN(most * INT.size)
    data, rights, _, _ = connection.recvmsg(size, room, socket.MSG_CMSG_CLOEXEC)
    files = [
        file
        for level, kind, content in rights
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS)
        for (file,) in INT.iter_unpack(content[: len(content) // INT.size * INT.size])
    ]
    return data, files


def take_name(name: bytes, kind: int) -> Socket:
    """Return a Unix socket (STREAM or DATAGRAM) that has this name until every process that has the socket closes it or
    ends. An abstract name, which starts with a zero byte, is unique on the computer or in the network namespace. Raises
    OSError if the name is taken."""
    taken = socket.socket(socket.AF_UNIX, kind)
    try:
        taken.bind(name)
    except BaseException:
        taken.close()
        raise
    return taken


def listen(taken: Socket, backlog: int) -> None:
    """Listen at the socket's name, so that `listener` returns this process. At most this number of connections may
    wait."""
    taken.listen(backlog)


def listener(name: bytes) -> tuple[int, int] | None:
    """Return the pid and user of the process that listened last at a name, or None if no process listens. Return 0, 0
    if the socket does not answer because too many connections wait. This function never waits."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(name)
            pid, uid, _ = struct.unpack("3i", probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        except ConnectionRefusedError:
            return None
        except OSError:
            return 0, 0
    return pid, uid


# Clocks, sleep, timer -------------------------------------------------------------------------------------

now = time.monotonic
"""Return the time in s on a clock that nobody sets (CLOCK_MONOTONIC)."""
now_ns = time.monotonic_ns
"""Return the time in ns on the clock of `now` (CLOCK_MONOTONIC)."""
boottime_ns = (
    partial(time.clock_gettime_ns, getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))
    if hasattr(time, "clock_gettime_ns")
    else time.monotonic_ns
)
"""Return the time in ns on a clock that continues while the computer is suspended (CLOCK_BOOTTIME), if the system has
one."""
processor_ns = time.thread_time_ns
"""Return the time in ns for which this thread has run on a processor."""
sleep = time.sleep
"""Sleep for a time in s."""
TIMER_CLOEXEC = getattr(os, "O_CLOEXEC", 0)
CLOCK_MONOTONIC, TIMER_ABSTIME = 1, 1
TIMER_SPEC = struct.Struct("@4l")
"""The packing of the interval and the first expiry, each in s and ns."""
NS = 1_000_000_000


def wall_time() -> float:
    """Return the time in s since 1970 on the clock of the day, which people can set."""
    return time.time()


def make_timer() -> int:
    """Return the descriptor of a timer on the monotonic clock (timerfd_create(2)); `read` waits for its next expiry.
    Raises OSError if no timer is available."""
    return _checked(_libc().timerfd_create(CLOCK_MONOTONIC, TIMER_CLOEXEC))


def set_timer(file: int, first: int, interval: int) -> None:
    """Let a timer expire at `first`, ns on the monotonic clock, and then every `interval` ns. If `first` has passed,
    the timer expires immediately. Raises OSError if the kernel refuses it."""
    spec = TIMER_SPEC.pack(*divmod(interval, NS), *divmod(first, NS))
    _checked(_libc().timerfd_settime(file, TIMER_ABSTIME, spec, None))


# Locks ----------------------------------------------------------------------------------------------------

Mutex = ctypes.c_char
MUTEX_BYTES = 64
"""The room for a pthread_mutex_t in bytes. It takes 40 on x86-64, 48 on AArch64."""
PROCESS_SHARED = ROBUST = 1
FUTEX_TID_MASK, FUTEX_OWNER_DIED = 0x3FFFFFFF, 0x40000000
"""The parts of the word by which the kernel knows the holder of a robust lock (robust-futex-ABI in the documentation of
Linux): its thread, and whether it has died."""
TRY_PAUSE = 0.001
"""The time in s until a lock is tried again, on systems that cannot wait for a lock by the monotonic clock."""


def make_mutex(memory: mmap, at: int) -> Mutex:
    """Create a lock at this place in memory that processes share; the place has room for `MUTEX_BYTES`. The lock
    reports the death of a thread that holds it (pthread_mutexattr_setrobust(3))."""
    return _made(memory, at)


def lock_mutex(mutex: Mutex, within: float) -> int:
    """Wait up to `within` s for a lock, by the monotonic clock. Return 0 if the lock is taken, EOWNERDEAD if it is
    taken and its former holder has died, ETIMEDOUT if it is not taken. Raises OSError if waiting is impossible."""
    answer = _lock(mutex, within)
    if answer == errno.EOWNERDEAD:
        _libc().pthread_mutex_consistent(ctypes.byref(mutex))
    elif answer not in (0, errno.ETIMEDOUT):
        raise OSError(answer, os.strerror(answer))
    return answer


def unlock_mutex(mutex: Mutex) -> None:
    """Release a lock that this thread has taken."""
    _libc().pthread_mutex_unlock(ctypes.byref(mutex))


def mutex_is_held(mutex: Mutex) -> bool:
    """Return True if a living thread holds a lock. This function only reads: a process that is stopped while it calls
    it does not keep the lock from others."""
    word = ctypes.c_uint32.from_address(ctypes.addressof(mutex) + _owner_at()).value
    return bool(word & FUTEX_TID_MASK) and not word & FUTEX_OWNER_DIED


def lock_file(file: int | IO[bytes] | IO[str], *, shared: bool) -> bool:
    """Lock an open file, if no other process has locked it (flock(2)). Return True if it is locked now. This function
    never waits. Raises OSError if the file cannot be locked at all."""
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


# Records --------------------------------------------------------------------------------------------------


def replace(old: FilePath, new: FilePath) -> None:
    """Rename a file, replacing the file that has the new name (rename(2))."""
    os.replace(old, new)


def unlink(path: FilePath) -> None:
    """Remove a file, if there is one."""
    with suppress(FileNotFoundError):
        os.unlink(path)


def fsync(file: int) -> None:
    """Wait until the content of a file, or the names in a folder, are on the disk."""
    os.fsync(file)


# The C library --------------------------------------------------------------------------------------------


class _Timespec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def _made(memory: mmap | bytearray, at: int) -> Mutex:
    mutex, attributes = Mutex.from_buffer(memory, at), ctypes.create_string_buffer(MUTEX_BYTES)
    libc = _libc()
    libc.pthread_mutexattr_init(attributes)
    libc.pthread_mutexattr_setpshared(attributes, PROCESS_SHARED)
    libc.pthread_mutexattr_setrobust(attributes, ROBUST)
    libc.pthread_mutex_init(ctypes.byref(mutex), attributes)
    return mutex


def _lock(mutex: Mutex, within: float) -> int:
    """Try to lock, and return 0 or the error number. With glibc before 2.30 the lock is tried repeatedly, because that
    version waits only by the wall clock, which may be set back."""
    libc, place = _libc(), ctypes.byref(mutex)
    lock = getattr(libc, "pthread_mutex_clocklock", None)
    until = time.monotonic() + within
    if lock is not None:
        return int(lock(place, CLOCK_MONOTONIC, ctypes.byref(_Timespec(int(until), int(until % 1 * 1e9)))))
    while (answer := int(libc.pthread_mutex_trylock(place))) == errno.EBUSY and time.monotonic() < until:
        time.sleep(TRY_PAUSE)
    return errno.ETIMEDOUT if answer == errno.EBUSY else answer


@cache
def _owner_at() -> int:
    """Return the offset in a lock, in bytes, of the word that has its holder: the first one that has the number of this
    thread while this thread holds a lock. Raises ValueError if the C library has no such word."""
    room, libc = bytearray(MUTEX_BYTES), _libc()
    place = ctypes.byref(_made(room, 0))
    libc.pthread_mutex_lock(place)
    words = memoryview(room).cast("I").tolist()
    libc.pthread_mutex_unlock(place)
    return 4 * words.index(threading.get_native_id())


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(answer: int) -> int:
    """Return the answer of a function of the C library. Raises OSError if it is below 0."""
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return answer
