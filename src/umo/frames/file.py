"""Creating the file of a ring. The file gets its name last, when it is complete and locked."""

from __future__ import annotations

import mmap
import os
import time
from contextlib import suppress
from pathlib import Path

from umo.errors import FramesError
from umo.frames import folder

DESCRIPTORS = Path("/proc/self/fd")
MADV_POPULATE_WRITE = 23


def make(path: Path, head: bytes, size: int) -> tuple[int, mmap.mmap]:
    """A new file of `size` bytes that begins with `head`: its descriptor, and its memory, all of it in place.

    FramesError if there is not enough memory, or if a running process uses this name; then no file is left.
    """
    folder.is_living(path)  # that of a dead process goes
    try:
        try:
            return _nameless(path, head, size)
        except FileExistsError:
            raise
        except (OSError, AttributeError, NotImplementedError):  # a system, or a file system, that has no such files
            return _hidden(path, head, size)
    except FileExistsError:
        raise FramesError(f"{path} already exists") from None
    except OSError as error:
        raise FramesError(
            f"cannot reserve {size / 1e6:.1f} MB for frames in {path.parent}: {error.strerror or error}"
        ) from None


def _nameless(path: Path, head: bytes, size: int) -> tuple[int, mmap.mmap]:
    """Nobody can come upon it before it is given its name."""
    file = os.open(path.parent, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
    try:
        mapped = _filled(file, head, size)
        place = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:  # with a folder given Python calls linkat, which alone follows this link (open(2), O_TMPFILE)
            os.link(DESCRIPTORS / str(file), path.name, dst_dir_fd=place, follow_symlinks=True)
        finally:
            os.close(place)
    except BaseException:
        os.close(file)
        raise
    return file, mapped


def _hidden(path: Path, head: bytes, size: int) -> tuple[int, mmap.mmap]:
    """Under a name that listers pass over at first."""
    if os.path.lexists(path):
        raise FileExistsError
    hidden = path.with_name(f".{os.getpid()}-{time.monotonic_ns():x}")
    flags = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    file = os.open(hidden, os.O_RDWR | os.O_CREAT | os.O_EXCL | flags, 0o600)
    try:
        mapped = _filled(file, head, size)
        os.rename(hidden, path)
    except BaseException:
        os.close(file)
        hidden.unlink(missing_ok=True)
        raise
    return file, mapped


def _filled(file: int, head: bytes, size: int) -> mmap.mmap:
    """Locked, with room for all of it, and every page in place where the kernel does that at once: the first lap would
    pay for it otherwise."""
    folder.hold(file)
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.ftruncate(file, size)
    mapped = mmap.mmap(file, size)
    with suppress(OSError, AttributeError):
        mapped.madvise(MADV_POPULATE_WRITE)
    mapped[: len(head)] = head
    return mapped
