"""Where the rings of running stations lie: one folder for each user, in shared memory where there is some.

A ring is locked (flock) by the processes that keep it going and by nobody else, so a ring that can be locked is
that of a dead process.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from umo.errors import FramesError

try:
    import fcntl
except ImportError:  # not on this platform: nothing to lock with
    fcntl = None  # type: ignore[assignment]

SUFFIX = ".frames"
UNFINISHED = ".new"
VARIABLE = "UMO_FRAMES"
"""Environment variable that names another folder, for containers and tests."""


def folder() -> Path:
    """The user's folder, made if need be; FramesError if it is not the user's own."""
    path = _place()
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = path.lstat()
    except OSError as error:
        raise FramesError(f"no folder for frames: {error}") from None
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or path.is_symlink()):
        raise FramesError(f"{path} is another user's (uid {status.st_uid})")
    return path


def _place() -> Path:
    if given := os.environ.get(VARIABLE):
        return Path(given)
    shared = Path("/dev/shm")
    base = shared if os.access(shared, os.W_OK) else Path(tempfile.gettempdir())
    return base / f"umo-{os.getuid() if hasattr(os, 'getuid') else 'user'}"


def rings() -> list[Path]:
    """The rings of living processes, oldest first. Those of dead ones are removed on the way."""
    found = []
    for path in sorted(folder().iterdir(), key=_age):
        if path.suffix not in (SUFFIX, UNFINISHED):
            continue
        if not is_alive(path):
            path.unlink(missing_ok=True)
        elif path.suffix == SUFFIX:
            found.append(path)
    return found


def is_alive(path: Path) -> bool:
    """Whether a process still holds the ring."""
    try:
        with path.open("rb") as file:
            return held(file.fileno())
    except OSError:
        return False


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


def _age(path: Path) -> float:
    try:
        return path.stat().st_ctime
    except OSError:
        return 0.0
