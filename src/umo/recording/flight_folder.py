"""Folders of flight recorders. Each folder contains the files of one recorder while it runs, and names the process that
writes them. At any time `save` joins the files into one. The last few folders of killed recorders are kept.
"""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from umo.errors import FramesError
from umo.recording.copying import join
from umo.recording.part_names import SUFFIX, part_name
from umo.system import folders
from umo.system.processes import identity

MAX_LEFT = 3
"""Number of folders of killed recorders that are kept."""
ABOUT, FILE = "recorder.json", f"flight{SUFFIX}"


@dataclass(frozen=True)
class FlightFolder:
    """The folder of one flight recorder."""

    path: Path
    station: str
    pid: int
    """The pid of the recorded control process."""
    recorder: tuple[int, str]
    """The pid of the recorder, and a mark that distinguishes it from later processes with the same pid."""

    @property
    def file(self) -> Path:
        """The first of the recorder's files."""
        return self.path / FILE

    @property
    def parts(self) -> list[Path]:
        parts, number = [], 1
        while (part := part_name(self.file, number)).exists():
            parts.append(part)
            number += 1
        return parts

    @property
    def is_written(self) -> bool:
        """True if the recorder is still running."""
        pid, process = self.recorder
        return identity(pid) == process

    def save(self, path: Path) -> None:
        """Save the whole flight recording as one file. Raises OSError or FramesError."""
        if not (parts := self.parts):
            raise FramesError(f"the flight recorder of {self.station} has nothing yet")
        join(parts, path)

    def remove(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)


def place() -> Path:
    """Return the folder that contains the folders of flight recorders. Raises FramesError if it cannot be created."""
    try:
        return folders.checked(folders.checked(folders.own(folders.lasting(), 0o755) / "flights"))
    except OSError as error:
        raise FramesError(f"the folder for flight recorders cannot be used: {error}") from None


def new(station: str, pid: int, recorder: int) -> FlightFolder:
    """Make a new folder for a flight recorder. Remove the folders of killed recorders, except the last few. Raises
    OSError or FramesError."""
    for left in [each for each in all_folders() if not each.is_written][:-MAX_LEFT]:
        left.remove()
    name = "".join(letter if letter.isalnum() else "_" for letter in station)[:40]
    path = place() / f"{name}-{pid}-{time.monotonic_ns():x}"
    path.mkdir(mode=0o700)
    made = FlightFolder(path, station, pid, (recorder, identity(recorder)))
    try:
        (path / ABOUT).write_text(json.dumps([station, pid, list(made.recorder)]))
    except OSError:
        made.remove()
        raise
    return made


def all_folders() -> list[FlightFolder]:
    """Return the folders of all flight recorders, the oldest first."""
    found = []
    for file in place().glob(f"*/{ABOUT}"):
        try:
            station, pid, (recorder, process) = json.loads(file.read_text())
            found.append((file.stat().st_mtime, FlightFolder(file.parent, str(station), int(pid), (recorder, process))))
        except (OSError, ValueError, TypeError):  # it is being made or removed
            continue
    return [folder for _, folder in sorted(found, key=lambda each: each[0])]


def find(name: str) -> FlightFolder:
    """Return the newest flight recorder of a station, by name or pid. Raises FramesError if there is none."""
    known = all_folders()
    fitting = [each for each in known if name in (each.station, str(each.pid))]
    if not fitting:
        names = ", ".join(dict.fromkeys(each.station for each in known)) or "none"
        raise FramesError(
            f"there is no flight recorder of {name!r} (`umo run --last 10min` makes one); "
            f"there are flight recorders of: {names}"
        )
    return max(fitting, key=lambda each: (each.is_written, known.index(each)))
