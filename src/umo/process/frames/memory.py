"""Memory that processes share and that no process can truncate: memfds with seals (memfd_create(2), fcntl(2)).

If another process truncates a mapped file, SIGBUS kills the reader. A sealed memfd cannot be truncated, so a process
that has mapped a sealed memfd cannot crash for this reason. Only the process that mapped the memory before it was
sealed can write frames.
"""

from __future__ import annotations

import mmap
import os
from contextlib import suppress
from typing import NamedTuple

from umo.errors import FramesError

try:
    import fcntl
except ImportError:  # not on this platform: nothing is published there
    fcntl = None  # type: ignore[assignment]

F_ADD_SEALS, F_GET_SEALS = 1033, 1034
SEAL, SHRINK, GROW, FUTURE_WRITE = 0x1, 0x2, 0x4, 0x10
"""Seals: no further seals, no truncating, no growing, no new writable mapping (Linux 5.1)."""
SIZE_SEALS = SHRINK | GROW
MADV_POPULATE_WRITE = 23


class RunDescriptors(NamedTuple):
    """The descriptors of a run's shared memory."""

    frames: int
    cells: int
    alive: int
    """A pipe without data. The writer of the frames holds the writing end of the pipe, and readers hold the reading
    end, so that the pipe hangs up when the writer has ended."""

    @classmethod
    def pair(cls) -> tuple[RunDescriptors, RunDescriptors]:
        """Make empty memory, and return the descriptors for the writer and for readers. Raises FramesError if this
        fails."""
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
            raise FramesError(f"the shared memory for frames cannot be created: {error.strerror}") from None
        os.close(pipe[0])
        return cls(frames, cells, pipe[1]), readers

    def again(self) -> RunDescriptors:
        """Return further descriptors of the same memory. Raises OSError if there are no more descriptors."""
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
    """Give empty memory its size and its initial content, and seal it. Return the writable mapping. `private`: from
    then on no other process can write to the memory, if the kernel has this seal. Raises FramesError if there is not
    enough memory. All pages are allocated now, because allocating them later would slow the first lap of the ring.
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
        fcntl.fcntl(file, F_ADD_SEALS, SIZE_SEALS | SEAL | (FUTURE_WRITE if private else 0))
    except OSError:  # a kernel without the last one
        fcntl.fcntl(file, F_ADD_SEALS, SIZE_SEALS | SEAL)
    return mapped


def mapped(file: int, *, write: bool = False) -> mmap.mmap:
    """Map memory that another process has made. Raises FramesError if it can be truncated."""
    try:
        seals = fcntl.fcntl(file, F_GET_SEALS)
        if seals & SIZE_SEALS != SIZE_SEALS:
            raise FramesError("this memory is not sealed: another process could shorten it")
        return mmap.mmap(file, os.fstat(file).st_size, access=mmap.ACCESS_WRITE if write else mmap.ACCESS_READ)
    except (OSError, ValueError) as error:  # ValueError: it is empty
        raise FramesError(f"this memory cannot be read: {error}") from None
