"""Takes the wiring of a recording as data. Its numbers are used, but code and files are those of the present station.

A driver is imported only if an installed package registers it by this name, or if a driver of the same type is in a
wiring of the station that the command line names. A file is opened only if such a wiring names the same file.
"""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_args

from umo.drivers import registry
from umo.errors import WiringError, text_of
from umo.process.station import Station
from umo.recording.replay.tape import NotReplayable
from umo.signature import signature_of
from umo.system.packages import package_of
from umo.wiring.run_options import RESERVED
from umo.wiring.source import WiringSource, read

WITHOUT_DEVICE = ("simulated", "timerfd")
"""Types of drivers that may always be run in closed loop, regardless of the wirings of the station."""
HOW = "name a wiring: --wiring NAME|FILE"


class RecordedDriver(NamedTuple):
    """A driver that a wiring uses."""

    kind: str
    options: Mapping[str, Any]


def recorded_wiring(
    job: Mapping[str, Any], station: Station | None, *, runs: bool = False
) -> str | dict[str, Any] | None:
    """Return the wiring of a recorded job: a file of the station if one has the recorded text, otherwise the recorded
    table. With `runs` the drivers will be run, in closed loop, so they must be those of a wiring of the station. Raises
    NotReplayable if the wiring names code or files that neither the station nor an installed package has."""
    wiring = job.get("wiring")
    wiring = wiring if isinstance(wiring, Mapping) else {}
    text, table = wiring.get("text"), wiring.get("table")
    own = [] if station is None else list(station.wirings.values())
    if isinstance(text, str):
        if (same := next((file for file in own if _text_of(file) == text), None)) is not None:
            return str(same)
        try:
            table = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise NotReplayable(f"the wiring of the recording cannot be read: {error}") from None
    if not isinstance(table, Mapping):
        name = wiring.get("name")
        return name if isinstance(name, str) and station is not None and name in station.wirings else None
    return _checked(dict(table), station, own, runs)


def _text_of(file: Path) -> str | None:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None


def _checked(table: dict[str, Any], station: Station | None, own: Sequence[Path], runs: bool) -> dict[str, Any]:
    """Return the table if it names only types and files that are permitted. Raises NotReplayable for any others."""
    known = [driver for file in own for driver in drivers_in(read(file))]
    drivers = table.get("drivers")
    table["drivers"] = {
        name: _absolute(each, station) if isinstance(each, Mapping) else each
        for name, each in (drivers.items() if isinstance(drivers, Mapping) else ())
    }
    source = read(table)
    for driver in drivers_in(source):
        if runs and driver.kind not in WITHOUT_DEVICE and driver not in known:
            raise NotReplayable(
                f"the wiring of the recording has a driver {driver.kind!r} with settings that no wiring of the "
                f"station has: {HOW}"
            )
        if driver.kind not in registry.known() and driver.kind not in {each.kind for each in known}:
            raise NotReplayable(
                f"the wiring of the recording names the code {driver.kind!r}, which no wiring of the station names and "
                f"no installed package registers: {HOW}"
            )
        for option in files_among(_signature(driver.kind), driver.options):
            if driver not in known:
                raise NotReplayable(
                    f"the wiring of the recording names a file ({option} = {driver.options[option]!r}) that no wiring "
                    f"of the station names: {HOW}"
                )
    for each in table["drivers"].values():
        if station is not None and isinstance(each, dict) and isinstance(each.get("type"), str):
            for option in files_among(_signature(each["type"]), each):
                each[option] = str(station.path / str(each[option]))
    return table


def _absolute(table: Mapping[str, Any], station: Station | None) -> dict[str, Any]:
    """Return the table of a driver in which a type such as `.plant:Plant` is completed with the station's module.
    Whether a wiring of the station names this type is checked later."""
    kind = table.get("type")
    if not isinstance(kind, str) or not kind.startswith("."):
        return dict(table)
    if station is None:
        raise NotReplayable(f"the wiring of the recording names the code {kind!r} of a station: {HOW}")
    try:
        return {**table, "type": package_of(station.path) + kind}
    except (Exception, SystemExit) as error:  # of the station's __init__.py
        raise NotReplayable(f"{station.path} cannot be imported: {text_of(error)}") from error


def drivers_in(source: WiringSource) -> Iterator[RecordedDriver]:
    """Return the drivers that a wiring declares, and those that only its lines name. They are resolved like in
    `connect`."""
    named = {each.driver for each in source.entries.values()} - source.drivers.keys()
    for table in [*source.drivers.values(), *map(registry.table_of, sorted(named))]:
        if isinstance(kind := table.get("type"), str):
            yield RecordedDriver(kind, {key: value for key, value in table.items() if key != "type"})


def _signature(kind: str) -> Mapping[str, inspect.Parameter]:
    """Return the options of a known driver. For a driver that cannot be imported, return none; the error is raised when
    the driver is created."""
    try:
        return signature_of(registry.find(kind))
    except WiringError:
        return {}


def files_among(signature: Mapping[str, inspect.Parameter], given: Mapping[str, Any]) -> list[str]:
    """Return the given options that are files."""
    return [
        name for name, each in signature.items() if name in given and name not in RESERVED and _is_path(each.annotation)
    ]


def _is_path(kind: Any) -> bool:
    if isinstance(kind, type):
        return issubclass(kind, Path)
    return any(map(_is_path, get_args(kind)))
