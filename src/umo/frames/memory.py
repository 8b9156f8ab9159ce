"""Memory that processes share and that nobody can cut: memfds with seals (memfd_create(2), fcntl(2)); what is in cells.

A mapping of a file that another process cuts short ends the reader by SIGBUS. A sealed memfd cannot be cut, so whoever
has mapped one never dies of it. Frames can be written by nobody but the process that mapped them before the seal.
"""

from __future__ import annotations

import mmap
import os
import signal
from contextlib import suppress
from typing import NamedTuple

from umo.errors import FramesError
from umo.frames.layout import NAME, Layout
from umo.text import printable

try:
    import fcntl
except ImportError:  # not on this platform: nothing is published there
    fcntl = None  # type: ignore[assignment]

F_ADD_SEALS, F_GET_SEALS = 1033, 1034
SEAL, SHRINK, GROW, FUTURE_WRITE = 0x1, 0x2, 0x4, 0x10
"""Seals: no more of them, no cutting, no growing, no new way to write (Linux 5.1)."""
UNCUT = SHRINK | GROW
MADV_POPULATE_WRITE = 23
STOP, WHO, HEAD, QUEUE = 0, 16, 96, 128
SLOTS, SLOT = 64, 1024
SIGNS = QUEUE + SLOTS * SLOT
STOP_MARK = 0x756D_6F53_746F_7000
"""Number that asks for a stop: it is not there by accident."""
SIGNALS = {int(getattr(signal, name)) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)}
LEASE = ""
"""The path of the lease's sign of life."""


class RunDescriptors(NamedTuple):
    """The descriptors of a run's shared memory."""

    frames: int
    cells: int
    alive: int
    """A pipe that hangs up when the writer of the frames, who holds its writing end, is gone."""

    @classmethod
    def pair(cls) -> tuple[RunDescriptors, RunDescriptors]:
        """Empty memory: the writer's descriptors and the readers'. FramesError if there can be none."""
        if not hasattr(os, "memfd_create"):
            raise FramesError("frames can be published on Linux only; reading black boxes works everywhere")
        opened: list[int] = []
        try:
            opened.append(frames := os.memfd_create("umo-frames", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
            opened.append(cells := os.memfd_create("umo-cells", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
            opened.extend(pipe := os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK))
            readers = cls(frames, cells, pipe[0]).again()
        except OSError as error:
            for file in opened:
                os.close(file)
            raise FramesError(f"no shared memory for frames: {error.strerror}") from None
        os.close(pipe[0])
        return cls(frames, cells, pipe[1]), readers

    def again(self) -> RunDescriptors:
        """Other descriptors of the same memory; OSError if there are no more."""
        opened: list[int] = []
        try:
            for file in self:
                opened.append(os.dup(file))  # noqa: PERF401  (those before are closed if one fails)
        except OSError:
            for file in opened:
                os.close(file)
            raise
        return RunDescriptors(*opened)

    def close(self) -> None:
        for file in self:
            os.close(file)


def fill(file: int, head: bytes, size: int, *, private: bool) -> mmap.mmap:
    """Give empty memory its size and its beginning, and seal it; the mapping to write by. `private`: from then on
    nobody else can write to it, where the kernel has this seal. FramesError if there is not enough memory.

    Every page is in place before: the first lap of the ring would pay for it otherwise.
    """
    try:
        os.posix_fallocate(file, 0, size)
        mapped = mmap.mmap(file, size)
    except OSError as error:
        raise FramesError(f"cannot reserve {size / 1e6:.1f} MB for frames: {error.strerror or error}") from None
    with suppress(OSError, AttributeError):
        mapped.madvise(MADV_POPULATE_WRITE)
    mapped[: len(head)] = head
    try:
        fcntl.fcntl(file, F_ADD_SEALS, UNCUT | SEAL | (FUTURE_WRITE if private else 0))
    except OSError:  # a kernel without the last one
        fcntl.fcntl(file, F_ADD_SEALS, UNCUT | SEAL)
    return mapped


def mapped(file: int, *, write: bool = False) -> mmap.mmap:
    """Memory that somebody else has made. FramesError if it can be cut."""
    try:
        seals = fcntl.fcntl(file, F_GET_SEALS)
        if seals & UNCUT != UNCUT:
            raise FramesError("this memory is not sealed: another process could cut it")
        return mmap.mmap(file, os.fstat(file).st_size, access=mmap.ACCESS_WRITE if write else mmap.ACCESS_READ)
    except (OSError, ValueError) as error:  # ValueError: it is empty
        raise FramesError(f"this memory cannot be read: {error}") from None


def size_of(layout: Layout) -> int:
    """Bytes of the cells of a run."""
    return SIGNS + 16 * (1 + len(layout.objects) + len(layout.actions))


class ClientMemory:
    """The cells as the machine or a client has them: memory beside the frames that clients write and the machine reads.
    Levels, and the queue of commands. FramesError if this memory is not what the frames describe.

    Its size is sealed; what is in it is not: every process of the user may write anything there. So whatever the
    machine reads is checked, and at worst a command is dropped, or a lease or something held ends.

    Layout, little-endian: at `STOP` a request to stop, `STOP_MARK` plus the number of a signal; at `WHO` who asks,
    UTF-8, `NAME` bytes; at `HEAD` the number of commands written so far; from `QUEUE` on `SLOTS` commands of `SLOT`
    bytes each (`umo.remote.queue`); from `SIGNS` on the signs of life, 16 bytes each: number of the lease, and when its
    holder was last there, in ns of CLOCK_MONOTONIC. The first is that of the lease itself; then comes one for each
    object, and one for each action, in the order of the frames' description.
    """

    def __init__(self, file: int, layout: Layout) -> None:
        self._map = mapped(file, write=True)
        if len(self._map) < size_of(layout):
            self._map.close()
            raise FramesError("the cells of this run do not fit its frames")
        self.memory = memoryview(self._map)
        self.words = self.memory[: len(self._map) & ~7].cast("Q")
        self.asked, self.head = (self.words[at >> 3 : (at >> 3) + 1] for at in (STOP, HEAD))
        """For the look in each period: not 0 if a stop is asked for or there is garbage; commands written so far."""
        paths = [LEASE, *(str(entry["path"]) for entry in (*layout.objects, *layout.actions))]
        self._signs = {path: (SIGNS >> 3) + 2 * number for number, path in enumerate(paths)}

    # A stop --------------------------------------------------------------------------------------------

    def ask_to_stop(self, number: int, who: str) -> None:
        """Ask the run to end as after this signal. The first request stands."""
        if self.stop is None:
            text = who.encode(errors="replace")[:NAME].decode(errors="ignore").encode()
            self.memory[WHO : WHO + NAME] = text.ljust(NAME, b"\0")
            self.words[STOP >> 3] = STOP_MARK | number

    @property
    def stop(self) -> tuple[int, str] | None:
        """The stop signal that was requested, and the client that requested it; None: there is no request."""
        word = self.words[STOP >> 3]
        if not word or word ^ STOP_MARK not in SIGNALS:
            return None
        text = bytes(self.memory[WHO : WHO + NAME]).partition(b"\0")[0].decode(errors="replace")
        return word ^ STOP_MARK, printable(text)

    # Signs of life -------------------------------------------------------------------------------------

    def sign(self, path: str, lease: int, now: int) -> None:
        """The holder of this lease is there now (ns of CLOCK_MONOTONIC), for what is at this path, if it has a cell."""
        at = self._signs.get(path)
        if at is not None:
            self.words[at], self.words[at + 1] = lease, now

    def signed(self, path: str, lease: int) -> float:
        """The time at which the holder of this lease was last there for this path, s of CLOCK_MONOTONIC; 0: never."""
        at = self._signs[path]
        return self.words[at + 1] * 1e-9 if self.words[at] == lease else 0.0

    def close(self) -> None:
        for view in (self.asked, self.head, self.words):
            view.release()
        self.memory.release()
        self._map.close()
