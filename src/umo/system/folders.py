"""Folders that umo shares between processes, protected against other users who can write to the same place.

A folder in a place that everybody may write to (/dev/shm, /var/tmp) is identified by its owner, not by its name. So
another user who takes the name first, or a symbolic link, has no effect.
"""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from umo.system import calls

PREFIX = "umo-"
MAX_FOLDERS = 100
LASTING_PLACES = (Path("/var/tmp"), Path("/tmp"))
"""The places for records that all users may read and only their writer may change. The first place survives a
reboot."""
STATE_VARIABLE = "UMO_STATE"
"""The environment variable that names another place for data that outlive a run, for containers and tests."""
READABLE_MODE = 0o755
"""Mode of a folder that other users may read but not change."""


def own(place: Path, mode: int = 0o700) -> Path:
    """Return this user's folder in a place where other users may write. The folder is made if there is none. Raises
    OSError if this is impossible. Several uses may share the folder with different modes: other users may read the
    folder if any of the uses permits it, and may never write to it.
    """
    if not hasattr(os, "getuid"):
        path = place / f"{PREFIX}user"
        path.mkdir(parents=True, exist_ok=True)
        return path
    base = f"{PREFIX}{os.getuid()}"
    for path, status in folders(place):
        if status.st_uid == os.getuid() and (path.name + "-").startswith(f"{base}-"):
            return _with_mode(path, mode)
    for number in range(MAX_FOLDERS):
        path = place / (f"{base}-{number}" if number else base)
        with suppress(FileExistsError):  # another user's, not a folder, or another process of ours was quicker
            path.mkdir(mode=0o700)
        if is_own(path):
            return _with_mode(path, mode)
    return _with_mode(Path(tempfile.mkdtemp(prefix=f"{base}-", dir=place)), mode)


def checked(path: Path) -> Path:
    """Return the folder with this name. It is made if there is none. Raises OSError if the name is that of a link,
    belongs to another user, or is not a folder."""
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not is_own(path):
        raise PermissionError(errno.EACCES, "a link, or another user's folder", str(path))
    return path


def lasting() -> Path:
    """Return the place of the users' folders that outlive a run. Raises OSError if the place named by the environment
    cannot be made."""
    if given := os.environ.get(STATE_VARIABLE):
        place = Path(given)
        place.mkdir(parents=True, exist_ok=True)
        return place
    return first_writable(LASTING_PLACES)


def folders(place: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Return all users' folders in a place, by name, without links and files."""
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


def is_own(path: Path, is_kind: Callable[[int], bool] = stat.S_ISDIR) -> bool:
    """Return True if this is a folder that belongs to this user, or a file of the given kind (such as `stat.S_ISSOCK`),
    and not a link to one."""
    try:
        status = path.lstat()
    except OSError:
        return False
    return is_kind(status.st_mode) and (not hasattr(os, "getuid") or status.st_uid == os.getuid())


def open_own(path: Path, *, follow: bool = False) -> int:
    """Open a regular file of this user for reading. Raises OSError if the file is anything else. `follow` allows a
    symbolic link.

    The opened file is checked, not the name, because the name may refer to another file in the meantime. A pipe does
    not block the call.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    file = os.open(path, flags | (0 if follow else getattr(os, "O_NOFOLLOW", 0)))
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        if hasattr(os, "getuid") and status.st_uid != os.getuid():
            raise PermissionError(errno.EACCES, f"it belongs to another user (uid {status.st_uid})", str(path))
    except BaseException:
        os.close(file)
        raise
    return file


@contextmanager
def written(path: Path, mode: int, *, to_disk: bool = False) -> Iterator[BinaryIO]:
    """Return a context that yields a file to write. The file is written completely or not at all: it gets its name at
    the end of the block. Raises OSError if this is impossible; then the earlier file remains. `to_disk`: the file must
    also survive a power failure of the computer."""
    new = path.with_name(f".{path.name}.{os.getpid()}")
    calls.unlink(new)  # of a process that had this number before
    file = calls.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o600)
    try:
        with open(file, "wb") as stream:
            os.chmod(new, mode)
            yield stream
            stream.flush()
            if to_disk:
                calls.fsync(file)
        calls.replace(new, path)
    except BaseException:
        remove(new)
        raise
    if to_disk:
        sync(path.parent)


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Return a context that yields the path of a file to write, for code that opens the file itself. The file is
    written completely or not at all. The path has the same suffix. The umask decides who may read the file."""
    new = path.with_name(f".{os.getpid()}.{path.name}")
    calls.unlink(new)  # of a process that had this number before
    calls.close(calls.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o666))
    try:
        yield new
        calls.replace(new, path)
    except BaseException:
        remove(new)
        raise


def remove(path: Path) -> None:
    """Remove a file, unless it does not exist or cannot be removed."""
    with suppress(OSError):
        calls.unlink(path)


def sync(folder: Path) -> None:
    """Write the names in a folder to the disk."""
    file = calls.open(folder, os.O_RDONLY)
    try:
        calls.fsync(file)
    finally:
        calls.close(file)


def modified(path: Path) -> float:
    """Return the time in s since 1970 at which a file was written last; 0 if the file has just been removed."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def first_writable(places: Iterable[Path]) -> Path:
    """Return the first of the places in which this process may make a folder. If there is none, return the place for
    temporary files."""
    for place in places:
        if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
            return place
    return Path(tempfile.gettempdir())


def _with_mode(path: Path, mode: int) -> Path:
    now = stat.S_IMODE(path.lstat().st_mode)
    wanted = mode | (now & READABLE_MODE)
    if wanted != now:
        path.chmod(wanted)
    return path
