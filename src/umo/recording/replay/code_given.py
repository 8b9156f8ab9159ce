"""Finds the code for a replay. A recording is only data. It names its station, but by that name only a station that
ships with umo or is installed is found. Any other code must be named on the command line, or by the caller."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from umo.process.job import MAIN_MODULE, Job, functions_of
from umo.process.source_files import other_files
from umo.process.station import Station, find, packaged
from umo.recording.replay.recorded_wiring import files_among, recorded_wiring
from umo.recording.replay.tape import NotReplayable
from umo.signature import parameters_of
from umo.text import in_a_line, printable, some
from umo.wiring.parameters import flag
from umo.wiring.run_options import WIRING_OPTIONS, driver_options

FORM = "FILE.py:MACHINE:APPLICATION"


@dataclass(frozen=True)
class CodeGiven:
    """The code that the command line names."""

    station: str | None = None
    """A station by folder or name, or functions as `FILE.py:MACHINE:APPLICATION` (or `MODULE:...`). Without an
    application `control` is run. None means the station that ships with umo or is installed under the recorded name."""
    wiring: str | None = None
    """A wiring of the station by name, or a file. None means the recorded wiring, as data."""

    @property
    def is_program(self) -> bool:
        """True if the code is given by functions and not by a station."""
        return self.station is not None and ":" in self.station and not Path(self.station).exists()


NOTHING_GIVEN = CodeGiven()
"""The code if the command line names none: the station that ships with umo or is installed under the recorded name,
with the recorded wiring."""


def job_of(recorded: Mapping[str, Any], given: CodeGiven, *, runs: bool = False) -> Job:
    """Return the recorded job with the given code. `runs`: True if the drivers of the job will be run, in closed loop.
    Raises NotReplayable if no code is given and the recorded station neither ships with umo nor is installed, or if the
    recording names other code or files."""
    options = recorded.get("options")
    job = Job(options=dict(options.get("given", {})) if isinstance(options, Mapping) else {}, path=[])
    job.options = {name: value for name, value in job.options.items() if name not in WIRING_OPTIONS}
    job.manual = bool(recorded.get("manual", False))
    station: Station | None = None
    if given.is_program:
        job.machine, job.application, job.script = _functions(str(given.station))
    else:
        station = _station_of(recorded) if given.station is None else find(given.station)
        job.station = str(station.path)
    job.wiring = recorded_wiring(recorded, station, runs=runs) if given.wiring is None else given.wiring
    _check_files(job, station)
    return job


def _station_of(recorded: Mapping[str, Any]) -> Station:
    """Return the station that ships with umo or is installed under the recorded name, regardless of its folder in the
    recorded run. Raises NotReplayable if there is none."""
    name = recorded.get("station")
    if recorded.get("machine"):
        place = Path(str(recorded.get("script") or "FILE.py")).name
        names = [str(recorded.get(key) or "").rpartition(":")[2] for key in ("machine", "application")]
        hint = printable(":".join([place, *filter(None, names)]))
        raise NotReplayable(
            f"the run of the recording was a program, and umo runs only code that the command line names: add {hint}"
        )
    folder = packaged(name) if isinstance(name, str) else None
    if folder is None:
        place = printable(in_a_line(str(recorded.get("place") or "")))[:200]
        where = f" (it was in {place})" if place else ""
        raise NotReplayable(
            f"the station of the recording, {printable(in_a_line(str(name)))[:100]!r}, neither ships with umo nor is "
            f"installed{where}. umo runs only code that the command line names: add the folder of the station"
        )
    return Station(str(name), folder)


def _functions(text: str) -> tuple[str, str | None, str | None]:
    """Return machine and application, each as `module:function`, and the file that contains them."""
    where, *names = text.split(":")
    if not 1 <= len(names) <= 2 or not all(name.isidentifier() for name in names):
        raise NotReplayable(f"{text!r} is neither a station nor functions such as {FORM}")
    script = None
    if where.endswith(".py"):
        if not Path(where).is_file():
            raise NotReplayable(f"{where}: no such file")
        script, where = str(Path(where).resolve()), MAIN_MODULE
        if (folder := str(Path(script).parent)) not in sys.path:
            sys.path.append(folder)  # a script imports what lies beside it
    machine, *application = (f"{where}:{name}" for name in names)
    return machine, next(iter(application), None), script


def _check_files(job: Job, station: Station | None) -> None:
    """Raise NotReplayable if an option of the recorded run is a file, because the recording has named this file."""
    if not job.options:
        return
    found = {name: each for name, (_, each) in driver_options(_wiring(job, station)).items()}
    make, main = functions_of(job) if station is None else (station.make, station.main)
    found |= parameters_of(make, 0) | (parameters_of(main, 1) if main else {})
    for name in files_among(found, job.options):
        raise NotReplayable(
            f"the recorded run had a file as its option {flag(name)}, and a recording opens no files: replay it in a "
            f"program (umo.recording.replay)"
        )


def _wiring(job: Job, station: Station | None) -> Any:
    if station is not None and (job.wiring is None or isinstance(job.wiring, str)):
        return station.wiring(job.wiring)
    return Path(job.wiring) if isinstance(job.wiring, str) else job.wiring


def other_code(recorded: Mapping[str, Any], place: Path) -> str:
    """Return a remark if the files of the code differ from those of the recorded run, or "" if they do not."""
    others = other_files(recorded, place)
    if others is None:
        return (
            "it is not known whether the code is the code of the recorded run: the recording has no hashes of its files"
        )
    return (
        (f"the code differs from the code of the recorded run ({printable(in_a_line(some(others)))})") if others else ""
    )
