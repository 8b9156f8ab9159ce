"""The file of kept values: one for each station and wiring, in the user's folder for data that outlive a run.

It is JSON, ASCII: `{"checksum": ..., "content": {...}}`. The content has the version, station, wiring, run, the number
and the UTC of one period, and the sections of this period. A file is valid only if it equals, byte for byte, the result
of `encode` for its content. An invalid file is kept under another name.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from umo.errors import UmoError
from umo.system import calls, folders
from umo.system.device_record import state_folder
from umo.system.file_locks import lock_within
from umo.system.folders import remove

FOLDER, SUFFIX = "kept", ".json"
VERSION = 1
MAX_BYTES = 4 << 20
"""Largest size of a file, in bytes."""
MAX_ASIDE = 10
"""Number of damaged files of one station and wiring that are kept aside; the oldest are removed first."""
MODE = 0o1600
"""The mode of a file and of its lock. Because of the sticky bit, systemd-tmpfiles does not remove an old file
(tmpfiles.d(5)). A file whose values do not change becomes old during the run."""
NUMBERS, ALARMS, STATES = "numbers", "alarms", "states"
"""The names of the sections. Each section has entries by path: for kept numbers the value, unit and type; for alarms
that are not normal the number of the state; for state machines (`umo.operation`) the name of the state. The next run
does not take over the states of state machines, because they begin stopped."""


class KeptFileError(UmoError):
    """A file of kept values cannot be used."""


@dataclass
class KeptValues:
    """The content of a file: the values kept in one period of a run."""

    station: str
    wiring: str
    place: str = ""
    """Folder or script of the station."""
    pid: int = 0
    started: float = 0.0
    """Pid of the run's control process, and its start in s since 1970."""
    period: int = 0
    """Number of the period."""
    utc: float = 0.0
    """Beginning of the period in s since 1970."""
    sections: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def numbers(self) -> dict[str, Any]:
        """The kept numbers by path: value, unit and type, or None if the number had no value."""
        return self.sections.get(NUMBERS, {})


class FileSystem(Protocol):
    """The functions of the operating system (`calls`) that are needed for writing. Tests replace them."""

    def open(self, path: Path, flags: int, mode: int = ...) -> int: ...
    def write(self, file: int, data: bytes, /) -> int: ...
    def fsync(self, file: int) -> None: ...
    def close(self, file: int) -> None: ...
    def replace(self, old: Path, new: Path) -> None: ...


def path_of(station: str, wiring: str) -> Path:
    """Return the file of a station and a wiring. Raises OSError if there is no folder for it."""
    folder = state_folder() / FOLDER
    plain = "".join(letter if letter.isalnum() and letter.isascii() else "_" for letter in station)[:40]
    digest = hashlib.sha256(f"{station}\0{wiring}".encode(errors="surrogateescape")).hexdigest()[:16]
    return folder / f"{plain}-{digest}{SUFFIX}"


def encode(content: Mapping[str, Any]) -> bytes:
    text = json.dumps(content, allow_nan=False)
    checksum = hashlib.sha256(text.encode()).hexdigest()
    return f'{{"checksum": "{checksum}", "content": {text}}}\n'.encode()


def dump(values: KeptValues) -> bytes:
    return encode({"version": VERSION, **asdict(values)})


def load(data: bytes) -> KeptValues:
    """Return the content of a file. Raises KeptFileError unless the file is a valid file of this version."""
    try:
        content = json.loads(data.decode("ascii"))["content"]
        whole = encode(content) == data
    except (ValueError, KeyError, TypeError, RecursionError):
        raise KeptFileError("the file is incomplete, or not a file of kept values") from None
    if not whole or not isinstance(content, dict):
        raise KeptFileError("the file is damaged: its checksum is wrong")
    if content.pop("version", None) != VERSION:
        raise KeptFileError("another version of umo has written the file")
    try:
        values = KeptValues(**content)
        texts = all(isinstance(text, str) for text in (values.station, values.wiring, values.place))
        if not texts or not all(isinstance(values.sections[name], dict) for name in values.sections):
            raise TypeError
        for entry in values.numbers.values():
            entry["value"], entry["unit"] + entry["type"]
        alarms, states = (values.sections.get(name, {}).values() for name in (ALARMS, STATES))
        if not all(type(number) is int for number in alarms) or not all(isinstance(name, str) for name in states):
            raise TypeError
        datetime.fromtimestamp(float(values.utc)), int(values.period), int(values.pid)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise KeptFileError("the file is not a file of kept values") from None
    return values


def read(path: Path) -> KeptValues | None:
    """Return the kept values, or None if there is no file. Raises KeptFileError if the file cannot be read or is not
    complete."""
    try:
        file = folders.open_own(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise KeptFileError(f"the file cannot be read: {error.strerror or error}") from None
    with open(file, "rb") as stream:
        try:
            data = stream.read(MAX_BYTES + 1)
        except OSError as error:
            raise KeptFileError(f"the file cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise KeptFileError("the file is too long for kept values")
    return load(data)


def write(path: Path, data: bytes, system: FileSystem = calls) -> None:
    """Replace the file, either completely or not at all, even if the computer loses power. If OSError is raised, the
    old file is unchanged."""
    if len(data) > MAX_BYTES:
        raise OSError(errno.EFBIG, f"more than {MAX_BYTES} bytes of kept values")
    new = path.with_name(f".{path.name}.new")  # one writer has the lock: one name, and nothing is left behind
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
    file = system.open(new, flags, MODE)
    try:
        rest = data
        while rest:
            rest = rest[system.write(file, rest) :]
        system.fsync(file)
    finally:
        system.close(file)
    system.replace(new, path)
    folder = system.open(path.parent, os.O_RDONLY)
    try:
        system.fsync(folder)
    finally:
        system.close(folder)


def set_aside(path: Path, now: float) -> Path:
    """Rename a file that cannot be used. Raises OSError if this fails."""
    aside = path.with_name(f"{path.stem}.aside-{datetime.fromtimestamp(now, UTC):%Y%m%dT%H%M%S}")
    number = 0
    while (new := aside.with_name(f"{aside.name}-{number}" if number else aside.name)).exists():
        number += 1
    calls.replace(path, new)
    for old in sorted(path.parent.glob(f"{path.stem}.aside-*"))[:-MAX_ASIDE]:
        remove(old)
    return new


def all_kept(station: str) -> Iterator[tuple[Path, KeptValues | KeptFileError]]:
    """Return the files of a station, one for each wiring, and the files whose names may be names of its files."""
    for path in sorted((state_folder() / FOLDER).glob(f"*{SUFFIX}")):
        try:
            values = read(path)
        except KeptFileError as error:
            if path == path_of(station, "") or path.name.startswith(f"{path_of(station, '').name.rpartition('-')[0]}-"):
                yield path, error
        else:
            if values is not None and values.station == station:
                yield path, values


@contextmanager
def locked(path: Path, within: float) -> Iterator[bool]:
    """Return a context in which no other process writes the file. The context yields True if this process has the lock,
    and False if it did not get the lock within `within` s, because a run that keeps its values in the file holds the
    lock."""
    file = lock_file(path)
    try:
        yield take_lock(file, within)
    finally:
        calls.close(file)


def lock_file(path: Path) -> int:
    """Return the descriptor whose lock protects the file of kept values."""
    folders.checked(path.parent)
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
    return calls.open(lock_of(path), flags, MODE)


def lock_of(path: Path) -> Path:
    return path.with_suffix(".lock")


def take_lock(file: int, within: float = 0.0) -> bool:
    """Take the lock, immediately or within a time in s, and return True if this succeeded. The kernel releases it when
    this process ends."""
    try:
        return lock_within(file, within)
    except OSError:
        return False
