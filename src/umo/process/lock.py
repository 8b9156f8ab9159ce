"""One run per machine: a lock that dies with its process."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from umo.errors import AlreadyRunning

try:
    import fcntl
except ImportError:  # not on this platform: nothing to lock with
    fcntl = None  # type: ignore[assignment]


def lock_file(station: Path, wiring: Path | None) -> Path:
    """Where the lock of a machine lies: one for each station and wiring, in the user's runtime folder."""
    folder = Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir())
    key = hashlib.sha256(f"{station.resolve()}|{wiring and wiring.resolve()}".encode()).hexdigest()[:16]
    user = os.getuid() if hasattr(os, "getuid") else "user"
    return folder / f"umo-{user}-{station.name}-{key}.lock"


@contextmanager
def only_one(station: Path, wiring: Path | None) -> Iterator[None]:
    """Held while the machine runs; AlreadyRunning names the process that holds it."""
    if fcntl is None:
        yield
        return
    path = lock_file(station, wiring)
    with path.open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.seek(0)
            raise AlreadyRunning(
                f"{station.name} is already running (pid {file.read().strip() or 'unknown'})"
            ) from None
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        yield
