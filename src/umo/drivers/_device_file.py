"""Device files such as /dev/ttyUSB0, and the small files of sysfs: an error says what the user can do. This module is
for drivers of serial lines, GPIO chips, I2C and SPI buses, IIO devices and counters."""

from __future__ import annotations

import errno
import getpass
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from umo.errors import DriverError
from umo.text import did_you_mean, in_brackets

_MISSING = (errno.ENOENT, errno.ENODEV, errno.ENXIO)
_REFUSED = (errno.EACCES, errno.EPERM)
_MAX_LISTED = 8


@contextmanager
def opening(path: str) -> Iterator[None]:
    """Return a context in which any OSError becomes a DriverError that names the file and says what to do
    (`explained`)."""
    try:
        yield
    except DriverError:
        raise
    except OSError as error:
        raise DriverError(explained(path, error)) from error


def explained(path: str, error: OSError) -> str:
    """Return the text of an error with advice. For a missing file the text names the existing files; for a refused
    file, the group to join; for a busy file, the processes that have it open."""
    if error.errno in _MISSING:
        others = similar(path)
        known = f"; there are: {', '.join(others[:_MAX_LISTED])}" if others else "; there is no device of this kind"
        return f"there is no device {path}{did_you_mean(path, others)}{known}"
    if error.errno in _REFUSED:
        return f"no permission to open {path}{_remedy(path)}"
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        held = ", ".join(holders(path))
        return f"{path} is in use{f' by {held}' if held else ''}"
    return f"{path}: {error.strerror or error}"


def similar(path: str) -> list[str]:
    """Return the existing files of the same folder whose names differ from this one in digits only, in natural
    order."""
    stem = re.sub(r"\d+", "", os.path.basename(path))
    try:
        names = os.listdir(os.path.dirname(path) or ".")
    except OSError:
        return []
    found = [name for name in names if re.sub(r"\d+", "", name) == stem]
    found.sort(key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)])
    return [os.path.join(os.path.dirname(path), name) for name in found]


def numbered(folder: Path, stem: str) -> list[Path]:
    """Return the files of a folder whose names are this stem and a number, in the order of the numbers."""
    return sorted(folder.glob(f"{stem}[0-9]*"), key=lambda path: (len(path.name), path.name))


def one_named(kind: str, wanted: str, there: Mapping[str, Sequence[str]]) -> str:
    """Return the device that is named by its number or by one of its names. `there` contains the names of each number.
    Raises DriverError, which lists the existing devices, if there is no such device."""
    found = [number for number, names in there.items() if wanted in (number, *names)]
    if len(found) == 1:
        return found[0]
    if found:
        shown = " and ".join(f"{number}{in_brackets(*there[number])}" for number in found)
        raise DriverError(f"{shown} both have the name {wanted!r}: use a number, or another name")
    near = did_you_mean(wanted, [each for number, names in there.items() for each in (*names, number)])
    raise DriverError(f"there is no {kind} {wanted!r}{near}; {listed(kind, there)}")


def listed(kind: str, there: Mapping[str, Sequence[str]]) -> str:
    """Return the existing devices as text for a message."""
    if not there:
        return f"this computer has no {kind}"
    return "there are: " + ", ".join(f"{number}{in_brackets(*names)}" for number, names in there.items())


def text_in(file: Path) -> str:
    """Return the contents of a small file; empty if it cannot be read."""
    with suppress(OSError):
        return file.read_text().strip()
    return ""


def put(file: Path, value: str) -> None:
    """Write a small file. Raises DriverError, which names the file, if this fails."""
    try:
        fd = os.open(file, os.O_WRONLY | os.O_TRUNC | os.O_CLOEXEC)
        try:
            os.write(fd, value.encode())
        finally:
            os.close(fd)
    except PermissionError as error:
        raise DriverError(f"no permission to write {file}: a udev rule can give it to a group") from error
    except OSError as error:
        raise DriverError(f"{file}: {value.strip()!r} is refused: {error.strerror}") from error


def holders(path: str) -> list[str]:
    """Return the processes that have the file open, as `pid 123 (minicom)`; only root sees the processes of other
    users."""
    real = os.path.realpath(path)
    found = []
    for process in sorted(Path("/proc").glob("[0-9]*"), key=lambda folder: int(folder.name)):
        with suppress(OSError):
            if any(_target(link) == real for link in (process / "fd").iterdir()):
                found.append(f"pid {process.name} ({(process / 'comm').read_text().strip()})")
    return found


def _target(link: Path) -> str:
    with suppress(OSError):  # closed in the meantime
        return os.readlink(link)
    return ""


def _remedy(path: str) -> str:
    """Return advice for a refused file: to join its group if the members may read and write it, otherwise its
    permissions."""
    try:
        import grp

        status = os.stat(path)
        group = grp.getgrgid(status.st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return ""
    if status.st_mode & 0o060 != 0o060 or group == "root":
        return "; its permissions are " + oct(status.st_mode & 0o777)[2:] + ", a udev rule can give it to a group"
    return f": join its group (sudo usermod -aG {group} {getpass.getuser()}) and log in again"
