"""A disk that loses what was not synced, and is perhaps slow, under the file of kept values of a machine.

It hands all on to the operating system. Beside the folder it keeps another one: what is certain to be found after a
power cut, content that was synced under names that were.
"""

from __future__ import annotations

import os
from pathlib import Path
from time import sleep
from typing import Any

from umo.process import kept_file

FOLDER = "KILLS_DISK"
"""The environment variable that names the folder of what is certain."""
PAUSE = "KILLS_DISK_PAUSE"
"""The one that says how long each call takes, in s."""


class Disk:
    """The system of `kept_file.write`."""

    def __init__(self, certain: Path, pause: float) -> None:
        self._certain, self._pause = certain, pause
        self._places: dict[int, Path] = {}
        """The places of open files."""
        self._synced: dict[Path, bytes] = {}
        """Content that was synced and whose name was not, by its present place."""

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        sleep(self._pause)
        file = os.open(path, flags, mode)
        self._places[file] = path
        if flags & os.O_CREAT:
            self._synced[path] = b""
        return file

    def write(self, file: int, data: bytes, /) -> int:
        sleep(self._pause)
        return os.write(file, data[: max(1000, len(data) // 3)])

    def fsync(self, file: int) -> None:
        sleep(self._pause)
        os.fsync(file)
        path = self._places[file]
        if path in self._synced:
            self._synced[path] = path.read_bytes()
        else:
            self._certainly_named(path)

    def close(self, file: int) -> None:
        del self._places[file]
        os.close(file)

    def replace(self, old: Path, new: Path) -> None:
        sleep(self._pause)
        os.replace(old, new)
        self._synced[new] = self._synced.pop(old)

    def _certainly_named(self, folder: Path) -> None:
        """The names in a folder are certain now, each with the content that was synced."""
        for path in [each for each in self._synced if each.parent == folder]:
            new = self._certain / f"{path.name}.{os.getpid()}"
            new.write_bytes(self._synced.pop(path))
            os.replace(new, self._certain / path.name)


def replace_it() -> None:
    """Put this disk under the file of kept values, where the campaign asks for it."""
    if certain := os.environ.get(FOLDER):
        write: Any = kept_file.write
        write.__defaults__ = (Disk(Path(certain), float(os.environ.get(PAUSE, "0"))),)
