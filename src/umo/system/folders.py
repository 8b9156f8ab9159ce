"""Folders that umo shares between processes, safe against whoever else may write beside them.

A folder in a place that everybody may write to (/dev/shm, /var/tmp) is known by its owner, not by its name: another
user who takes the name first changes nothing, nor does a symbolic link.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

PREFIX = "umo-"
TRIES = 100
SHARED = (Path("/var/tmp"), Path("/tmp"))
"""Where records lie that every user of the computer may read, and only their writer may change; kept over a reboot in
the first."""


def own(place: Path, mode: int = 0o700) -> Path:
    """This user's folder in a place where others may write, made if there is none; OSError where that cannot be."""
    if not hasattr(os, "getuid"):
        path = place / f"{PREFIX}user"
        path.mkdir(parents=True, exist_ok=True)
        return path
    uid = os.getuid()
    for path, status in folders(place):
        if status.st_uid == uid:
            if stat.S_IMODE(status.st_mode) != mode:
                path.chmod(mode)
            return path
    for number in range(TRIES):
        path = place / (f"{PREFIX}{uid}" + (f"-{number}" if number else ""))
        try:
            path.mkdir(mode=0o700)
            path.chmod(mode)
            return path
        except FileExistsError:  # another user's, or not a folder
            continue
    raise FileExistsError(f"every name from {PREFIX}{uid} on is taken in {place}")


def folders(place: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """All users' folders in a place, by name; links and files are passed over."""
    try:
        names = sorted(name for name in os.listdir(place) if name.startswith(PREFIX))
    except OSError:
        return
    for name in names:
        path = place / name
        try:
            status = path.lstat()
        except OSError:
            continue
        if stat.S_ISDIR(status.st_mode):
            yield path, status


def first_writable(places: Iterable[Path]) -> Path:
    """The first of the places where this process may make a folder; else the one for temporary files."""
    for place in places:
        if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
            return place
    return Path(tempfile.gettempdir())
