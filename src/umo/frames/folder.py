"""The folder of the sockets of running stations: one per user, in shared memory if available."""

from __future__ import annotations

import os
import re
import time
from contextlib import suppress
from pathlib import Path

from umo.errors import FramesError
from umo.frames.frame_server import is_served, is_socket
from umo.system import folders

SUFFIX = ".sock"
FOLDER_VARIABLE = "UMO_FRAMES"
"""Environment variable that names another folder, for containers and tests."""
SHARED_MEMORY = Path("/dev/shm")
MAX_NAME_LENGTH = 40
"""Characters of a station's name in the name of a socket, whose address is short."""
_HIDDEN = re.compile(rf"\.(\d+)-[0-9a-f]+{re.escape(SUFFIX)}")
_OPEN = re.compile(rf"[\w-]+-\d+-[0-9a-f]+{re.escape(SUFFIX)}", re.ASCII)


def folder() -> Path:
    """The user's folder, made if need be; FramesError where that cannot be."""
    try:
        if given := os.environ.get(FOLDER_VARIABLE):
            return folders.checked(Path(given))
        return folders.own(folders.first_writable([SHARED_MEMORY]))
    except OSError as error:
        raise FramesError(f"no folder for frames: {error}") from None


def new_path(station: str) -> Path:
    """A socket for a new run, in the user's folder. What dead processes left there is removed."""
    rings()
    name = re.sub(r"[^\w-]", "_", station, flags=re.ASCII)[:MAX_NAME_LENGTH]
    return folder() / f"{name}-{os.getpid()}-{time.monotonic_ns():x}{SUFFIX}"


def rings() -> list[Path]:
    """The sockets of running stations, oldest first. Those of dead processes are removed on the way, and nothing else
    is."""
    place = folder()
    try:
        names = os.listdir(place)
    except OSError as error:
        raise FramesError(f"no folder for frames: {error}") from None
    for name in names:
        if (hidden := _HIDDEN.fullmatch(name)) and _is_gone(int(hidden[1])):
            _remove(place / name)
    found = sorted((place / name for name in names if _OPEN.fullmatch(name)), key=_made)
    return [path for path in found if is_living(path)]


def is_living(path: Path) -> bool:
    """Whether this is the socket of a living process. That of a dead one is removed; any other file stays as it is."""
    served = is_served(path) if is_socket(path) else None
    if served is False:
        _remove(path)
    return bool(served)


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _is_gone(pid: int) -> bool:
    """Whether there is no such process: it died before its socket got its name."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


def _made(path: Path) -> int:
    """ns of CLOCK_MONOTONIC, from the name that `new_path` gave."""
    return int(path.stem.rpartition("-")[2], 16)
