"""The folder of the rings of running stations: one per user, in shared memory if available.

Only the processes that write a ring lock it (flock), and it gets its name when it is complete and locked. So a ring
that can be locked belongs to a dead process.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

from umo.errors import FramesError
from umo.frames.layout import MAGIC
from umo.system import folders

try:
    import fcntl
except ImportError:  # not on this platform: nothing to lock with
    fcntl = None  # type: ignore[assignment]

SUFFIX = ".frames"
QUEUE = ".hands"
"""Of the queue of commands beside a ring (`umo.remote.queue`)."""
VARIABLE = "UMO_FRAMES"
"""Environment variable that names another folder, for containers and tests."""
SHARED = Path("/dev/shm")


def folder() -> Path:
    """The user's folder, made if need be; FramesError where that cannot be."""
    try:
        if given := os.environ.get(VARIABLE):
            return folders.checked(Path(given))
        return folders.own(folders.first_writable([SHARED]))
    except OSError as error:
        raise FramesError(f"no folder for frames: {error}") from None


def new_path(station: str) -> Path:
    """A file for a new ring, in the user's folder. What dead processes left there is removed, which makes room."""
    rings()
    name = re.sub(r"[^\w-]", "_", station)[:100]
    return folder() / f"{name}-{os.getpid()}-{time.monotonic_ns():x}{SUFFIX}"


def rings() -> list[Path]:
    """The rings of living processes, oldest first. Those of dead ones are removed on the way, and nothing else is."""
    place = folder()
    try:
        names = [name for name in os.listdir(place) if name.endswith(SUFFIX) and not name.startswith(".")]
    except OSError as error:
        raise FramesError(f"no folder for frames: {error}") from None
    return [path for path in sorted((place / name for name in names), key=_made) if is_living(path)]


def is_living(path: Path) -> bool:
    """Whether this is a ring of a living process. That of a dead one is removed; any other file stays as it is."""
    try:
        file = folders.open_own(path)
    except OSError:
        return False
    try:
        if os.pread(file, len(MAGIC), 0) != MAGIC:
            return False
        if held(file):
            return True
        remove(path)
    except OSError:  # it stays, then
        pass
    finally:
        os.close(file)
    return False


def remove(path: Path) -> None:
    """A ring, and the queue beside it."""
    path.unlink(missing_ok=True)
    path.with_suffix(QUEUE).unlink(missing_ok=True)


def held(file: int) -> bool:
    """Whether another open file holds the lock; on a platform without locks nobody can tell: True."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


def hold(file: int) -> None:
    """Keep the ring: until the last process that inherited the file has ended."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _made(path: Path) -> int:
    """ns of CLOCK_MONOTONIC, from the name that `new_path` gave; 0 for another name. Hands write to the file: the times
    that the file system keeps change."""
    try:
        return int(path.stem.rpartition("-")[2], 16)
    except ValueError:
        return 0
