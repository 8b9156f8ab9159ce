"""What is replayed: the station of a recording, or a machine and its loop given by a program."""

from __future__ import annotations

import dataclasses
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from umo.cycle import drive
from umo.errors import OptionError, UmoError, WiringError, text_of
from umo.objects import Compound
from umo.objects.numbers import numbers_of
from umo.process.job import Job, Plan
from umo.process.station import find
from umo.replay.tape import NotReplayable, Tape
from umo.system.packages import MARK, package_of
from umo.text import did_you_mean
from umo.wiring import Wired
from umo.wiring.run_options import WIRING_OPTIONS
from umo.wiring.wired import Parameter


@dataclass
class Program:
    """A machine with its wiring, and the loop that drives it."""

    machine: Compound
    wired: Wired
    drive: Callable[[Any], Any]
    """The loop: it is called with the connected machine, and returns when the work is done."""
    name: str = ""
    manual: bool = False
    """Whether the run began in manual mode."""

    @classmethod
    def of(cls, tape: Tape, station: str | None = None) -> Program:
        """The station of the recording as it is today, or another `station`; NotReplayable if it cannot be made."""
        recorded = tape.job
        given = dict(recorded.get("options", {}).get("given", {}))
        job = Job(
            station=station or _station_of(recorded),
            wiring=wiring_of(recorded, station),
            options={name: value for name, value in given.items() if name not in WIRING_OPTIONS},
            manual=bool(recorded.get("manual", False)),
        )
        if station is None and recorded.get("machine"):
            job.station, job.machine = None, recorded["machine"]
            job.application, job.script = recorded.get("application"), recorded.get("script")
            sys.path += [each for each in recorded.get("path", ()) if each not in sys.path]
        try:
            plan = Plan(job)
        except UmoError as error:
            why = str(error.mistakes[0]) if isinstance(error, WiringError) and error.mistakes else text_of(error)
            raise NotReplayable(f"the machine of the recording cannot be made: {why}") from error
        return cls(plan.machine, plan.wired, partial(drive, application=plan.application), plan.name, job.manual)

    def set(self, settings: Mapping[str, object]) -> None:
        """Let numbers have other values than in the recording. OptionError for one that there is not, or a value that
        is none of it."""
        known = {path: each for path, each in numbers_of(self.machine).items() if each.settable}
        parameters = [each for each in self.wired.parameters if each.number.path not in settings]
        for path, value in settings.items():
            if path not in known:
                raise OptionError(f"--set {path}: no such number{did_you_mean(path, known)}")
            number = known[path]
            try:
                parameters.append(
                    Parameter(number, number.checked(value) if number.is_field else number.of_its_type(value))
                )
            except UmoError as error:
                raise OptionError(f"--set {error}") from None
        self.wired = dataclasses.replace(self.wired, parameters=parameters)


def _station_of(job: Mapping[str, Any]) -> str | None:
    """The folder of the recorded station, or its name where there is no such folder any more."""
    place, name = job.get("place"), job.get("station")
    return str(place) if place and (Path(place) / MARK).is_file() else name


def wiring_of(job: Mapping[str, Any], station: str | None) -> str | dict[str, Any] | None:
    """The wiring of the recording: its file where that has the recorded text still, else this text."""
    wiring = job.get("wiring") or {}
    text, file = wiring.get("text"), wiring.get("file")
    if not isinstance(text, str):
        table = wiring.get("table")
        return dict(table) if isinstance(table, Mapping) else wiring.get("name") or None
    if station is None and file and _text_of_file(Path(file)) == text:
        return str(file)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise NotReplayable(f"the wiring of the recording cannot be read: {error}") from None
    folder = Path(station or _station_of(job) or ".")
    for driver in table.get("drivers", {}).values():
        if isinstance(driver, dict) and str(driver.get("type", "")).startswith("."):
            driver["type"] = _absolute(folder, driver["type"])
    return table


def _absolute(folder: Path, kind: str) -> str:
    """A class in a module of the station."""
    return package_of(find(folder).path) + kind


def _text_of_file(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
