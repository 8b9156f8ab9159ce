"""The history of alarms over restarts: a small file with lines of JSON for each station, in the permanent state folder.

It is never written in a control process or in a look of a guardian. Two generations are kept, each of at most
`MAX_BYTES`. An incomplete or foreign line does not affect the other lines.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from math import isfinite
from pathlib import Path
from typing import NamedTuple

from umo.errors import UmoError
from umo.system import folders
from umo.system.device_record import STICKY_MODE, state_folder
from umo.system.file_locks import lock_within

try:
    import fcntl
except ImportError:  # a system without it
    fcntl = None  # type: ignore[assignment]

FOLDER = "alarms"
SUFFIX = ".jsonl"
MAX_BYTES = 1 << 20
"""The largest number of bytes of a file. A file of this size becomes the older generation."""
MAX_NAME = 100
"""Largest length of a station's name in the name of a file, in characters."""

TRIES = 100
"""The number of times that a file is opened again because another writer has begun a new file."""


class AlarmRecord(NamedTuple):
    """One change of an alarm."""

    when: float
    """The time in s since 1970 at which the writer has read the event, shortly after it happened."""
    time: float
    """Time in s on the cycle's clock."""
    path: str
    text: str
    """The new state of the alarm, its priority and its text, as in the event."""
    who: str
    """The client; "" means the machine itself."""


def file_of(station: str) -> Path:
    """Return the file of a station. Raises OSError if there is no folder that outlives a run."""
    name = "".join(each if each.isalnum() or each in "-_." else "_" for each in station)[:MAX_NAME].lstrip(".")
    return folders.checked(state_folder() / FOLDER) / f"{name or '_'}{SUFFIX}"


LOCK_TIMEOUT = 0.2
"""The time in s to wait for another writer of the file, which is another run of the station. Writing is tried again at
the next look."""


def append(file: Path, records: Iterable[AlarmRecord]) -> None:
    """Add records at the end: either all of them or none. Raises OSError if they cannot be written."""
    data = "".join(f"{json.dumps(record._asdict())}\n" for record in records).encode()[-MAX_BYTES:]
    if not data:
        return
    with _opened(file) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size + len(data) <= MAX_BYTES:
            torn = size and os.pread(stream.fileno(), 1, size - 1) != b"\n"  # the last writer did not come to its end
            _write(stream, b"\n" + data if torn else data, size)
            return
        os.replace(file, older(file))
        with _opened(file) as fresh:
            _write(fresh, data, 0)


@contextmanager
def _opened(file: Path) -> Iterator[FileIO]:
    """The file of this name, for one writer at a time: several runs of a station write to it."""
    for _ in range(TRIES):
        number = os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, STICKY_MODE)
        with FileIO(number, "r+") as stream:
            if fcntl is not None and not lock_within(stream, LOCK_TIMEOUT):
                break
            if _is_at(file, number):
                yield stream
                return
    raise OSError(errno.EBUSY, "other users can write to it", str(file))


def _is_at(file: Path, number: int) -> bool:
    """True if an open file still has this name: another writer may have begun a new generation."""
    try:
        return os.path.samestat(os.stat(file, follow_symlinks=False), os.fstat(number))
    except FileNotFoundError:
        return False


def _write(stream: FileIO, data: bytes, size: int) -> None:
    """A full disk takes a part of the data, and says so in the next write only."""
    try:
        while data:
            data = data[stream.write(data) or 0 :]
    except OSError:
        with suppress(OSError):
            stream.truncate(size)
        raise


def older(file: Path) -> Path:
    """Return the file of the older generation."""
    return file.with_name(f"{file.name}.1")


def read(file: Path) -> list[AlarmRecord]:
    """Return the records that are kept, oldest first. Raises UmoError if a file cannot be read. A file that does not
    exist counts as empty."""
    found: list[AlarmRecord] = []
    for each in (older(file), file):
        try:
            with open(os.open(each, os.O_RDONLY | os.O_NOFOLLOW), "rb") as stream:
                data = stream.read(2 * MAX_BYTES)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise UmoError(f"{each} cannot be read: {error.strerror}") from None
        found += [record for line in data.splitlines() if (record := _record(line)) is not None]
    return found


def _record(line: bytes) -> AlarmRecord | None:
    """Return the record in a line, or None if the line has none."""
    try:
        given = json.loads(line)
        when, time = float(given["when"]), float(given["time"])
        texts = [given[name] for name in ("path", "text", "who")]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    if not (isfinite(when) and isfinite(time) and all(isinstance(text, str) for text in texts)):
        return None
    return AlarmRecord(when, time, *texts)
