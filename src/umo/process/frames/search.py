"""The search for the frames of stations that run now, by name or pid."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from umo.errors import FramesError, UmoError, text_of
from umo.process.frames import Reader, rings
from umo.system.packages import how_to_install, registered
from umo.text import did_you_mean

FINDERS = "umo.finders"
"""The group of entry points that find the frames of stations on other computers. Each takes a name, and returns a
`Reader`, or None if it does not know names of this kind."""


def frames_at(path: Path) -> Reader:
    """Return the frames of a running station or a black box. Raises FramesError for any defect of the file."""
    if not (path.is_file() or path.is_socket()):
        raise FramesError(f"{path} is not a file" if path.exists() else f"there are no frames at {path}: no such file")
    with reading(path):
        reader = Reader(path)
        _check(reader.about)
        return reader


def _check(about: Mapping[str, Any]) -> None:
    """Check the facts by which stations are distinguished and listed. Raises any exception if they are not valid."""
    "".join([about["station"], about["wiring"], about["place"], *about["devices"]])
    if not (math.isfinite(about["started"]) and math.isfinite(about["period"]) and about["pid"] == int(about["pid"])):
        raise ValueError("numbers")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Return a context that raises any error of reading a damaged file as FramesError."""
    try:
        yield
    except UmoError:
        raise
    except Exception as error:  # of json, struct, numpy, mmap: whatever a damaged file leads to
        raise FramesError(
            f"{path} cannot be read: it is damaged or was written by another version of umo ({text_of(error)})"
        ) from error


def find_running(name: str | None, said: Callable[[str], object] = lambda text: None) -> Reader:
    """Return the frames of one running station, by name, folder or pid (`meant_by`). Raises FramesError, which lists
    the running stations. `said` is called for a ring that cannot be read while others can be read."""
    if name is not None and (elsewhere := find_elsewhere(name)) is not None:
        return elsewhere
    unread: list[str] = []
    found = readers(unread.append)
    if unread and not found:
        raise FramesError("; ".join(unread))
    for text in unread:
        said(text)
    fitting = found if name is None else meant_by(name, found)
    for reader in found:
        if fitting != [reader]:
            reader.close()
    if len(fitting) == 1:
        return fitting[0]
    names = [str(reader.about["station"]) for reader in found]
    if not found:
        raise FramesError(f"no station is running{_others()}; start one in real time with `umo run STATION --realtime`")
    if not fitting:
        raise FramesError(f"{name!r} is not running{did_you_mean(str(name), names)}; running: {', '.join(names)}")
    if name is not None:
        raise FramesError(several_runs(name, fitting))
    pids = ", ".join(f"{reader.about['station']} (pid {reader.about['pid']})" for reader in fitting)
    raise FramesError(f"several stations are running; give a name or a pid: {pids}")


def find_elsewhere(name: str) -> Reader | None:
    """Return the frames of a station on another computer, from the first finder that knows such names, or None."""
    if "/" not in name:
        return None
    for point in registered(FINDERS):
        try:
            find = point.load()
        except ModuleNotFoundError as error:
            if os.path.exists(name):
                return None
            raise FramesError(f"{name} needs {error.name}: {how_to_install(point.name)}") from None
        if (found := find(name)) is not None:
            return cast("Reader", found)
    return None


def meant_by(name: str, found: Sequence[Reader]) -> list[Reader]:
    """Return the runs that a name means; all commands and `umo.attach` use this function. A name means the run with
    this pid. If there is none, it means the runs of the station in this folder. If there are none and the name is not a
    path, it means the runs of stations with this name in any folder."""
    if name.isdigit() and not os.path.isdir(name):
        return [reader for reader in found if str(reader.about["pid"]) == name]
    place = real_path(name)
    here = [reader for reader in found if reader.about["place"] == place]
    if here or is_path(name):
        return here
    return [reader for reader in found if reader.about["station"] == name]


def is_path(name: str) -> bool:
    """Return True if a name can only be the name of a folder: `.`, `./tank`, `/srv/tank`."""
    return name in (os.curdir, os.pardir) or any(each in name for each in (os.sep, os.altsep) if each)


def several_runs(name: str, fitting: Sequence[Reader]) -> str:
    """Return the message that a name does not identify a single run, with the names that do."""
    pids = ", ".join(str(reader.about["pid"]) for reader in fitting)
    return f"{len(fitting)} runs of {name} are active; give the pid of one instead of the name: {pids}"


def station_name(text: str) -> str:
    """Return the name of a station in a folder, even if the folder is a broken link."""
    return os.path.basename(real_path(text))


def real_path(text: str) -> str:
    """Return the path without links. It is unchanged if the working directory was removed."""
    try:
        return os.path.realpath(text)
    except FileNotFoundError:
        return os.path.normpath(text)


def readers(said: Callable[[str], object] = lambda text: None) -> list[Reader]:
    """Return a reader for each active run. `said` is called with a run that cannot be read."""
    found = []
    for path in rings():
        try:
            reader = frames_at(path)
        except FramesError as error:
            if path.exists():  # it has not just ended
                said(str(error))
            continue
        if reader.alive:
            found.append(reader)
        else:  # its guardian is resetting the machine
            reader.close()
    return found


def _others() -> str:
    """Return a hint for the message if another user has a folder of frames; otherwise ""."""
    folders = [path for path in Path("/dev/shm").glob("umo-*") if path.is_dir()] if Path("/dev/shm").is_dir() else []
    own = f"umo-{os.getuid()}" if hasattr(os, "getuid") else ""
    return " for this user; stations of other users cannot be reached" if any(p.name != own for p in folders) else ""
