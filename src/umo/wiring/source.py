"""The reading of a wiring: from TOML to flat entries by object path, and every mistake with its file and key."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from umo.drivers.contract import Driver
from umo.errors import Mistake, text_of
from umo.system.packages import package_of, station_of
from umo.text import cut_repr, did_you_mean
from umo.toml_lines import line_of, lines_of, toml_hint

if TYPE_CHECKING:
    from umo.wiring.schema import Entry

SECTIONS = ("drivers", "wire", "parameters", "process", "faults", "fault_seed", "faces", "record")
CONTROLLER = "controller"
"""Key of a line of `[wire]` for a part that runs on a controller."""
MAX_SUGGESTIONS = 10
"""Largest number of wrong names for which the nearest name is searched. A search among a hundred names takes 20 ms, and
a generated file may contain a thousand wrong names."""


@dataclass
class WiringSource:
    """A wiring as written: entries by path, drivers' tables by name, parameters, and mistakes."""

    file: str
    text: str = ""
    """The content of the file."""
    entries: dict[str, Entry] = field(default_factory=dict)
    refused: set[str] = field(default_factory=set)
    """Paths of the entries that are faulty."""
    drivers: dict[str, dict[str, Any]] = field(default_factory=dict)
    controllers: dict[str, Any] = field(default_factory=dict)
    """The controller of each part that runs on a controller, by path (`umo.wiring.controller_table`)."""
    parameters: dict[str, Any] = field(default_factory=dict)
    process: dict[str, Any] = field(default_factory=dict)
    faces: dict[str, Any] = field(default_factory=dict)
    """The faces of the station, as written (`umo.clients.faces.face_settings` reads them)."""
    record: dict[str, Any] | None = None
    """The settings of recordings of the station's runs, as written (`umo.recording.record_settings` reads them); None
    if the runs are not recorded."""
    injected: list[Any] = field(default_factory=list)
    """Faults to inject (`umo.testing.faults`)."""
    seed: Any = 0
    """The seed of the random numbers of faults."""
    mistakes: list[Mistake] = field(default_factory=list)
    suggested: int = 0

    def mistake(self, key: str, message: str) -> None:
        self.mistakes.append(Mistake(self.file, key, message))

    def located(self, mistakes: Iterable[Mistake]) -> list[Mistake]:
        """Return the mistakes, each with the line of its key in the file."""
        found = list(mistakes)
        lines = lines_of(self.text) if found and self.text else {}
        return [self._located(each, line_of(each.key, lines)) for each in found]

    def _located(self, mistake: Mistake, line: int | None) -> Mistake:
        is_here = line is not None and mistake.file == self.file
        return replace(mistake, file=f"{self.file}:{line}") if is_here else mistake

    def near(self, name: str, known: Iterable[str]) -> str:
        """Return the nearest name (`did_you_mean`) for the first `MAX_SUGGESTIONS` wrong names."""
        self.suggested += 1
        return did_you_mean(name, known) if self.suggested <= MAX_SUGGESTIONS else ""


def read(wiring: Path | str | Mapping[str, Any]) -> WiringSource:
    """Read the wiring from a TOML file, or from its contents as a mapping. Mistakes are collected instead of raised."""
    if not isinstance(wiring, Mapping | str | Path):
        source = WiringSource(cut_repr(wiring))
        source.mistake("", "it is not a wiring: a TOML file, its contents as a dict, or None")
        return source
    source = WiringSource("wiring" if isinstance(wiring, Mapping) else str(wiring))
    try:
        _fill(source, _named(wiring) if isinstance(wiring, Mapping) else _load(source, Path(wiring)))
    except RecursionError:
        source.mistake("", "cannot be read: it is nested too deeply")
    return source


def _load(source: WiringSource, path: Path) -> dict[str, Any]:
    try:
        source.text = path.read_text(encoding="utf-8-sig")  # Windows may begin it with a mark
        return tomllib.loads(source.text)
    except FileNotFoundError:
        source.mistake("", "no such file")
    except (OSError, ValueError) as error:  # TOML and UTF-8 errors are ValueErrors
        source.mistake("", f"cannot be read: {error}{toml_hint(str(error), source.text)}")
    return {}


def _fill(source: WiringSource, data: Mapping[str, Any]) -> None:
    for key in data:
        if key not in SECTIONS:
            source.mistake(key, f"unknown section{source.near(key, SECTIONS)}; known: {', '.join(SECTIONS)}")
    _read_drivers(source, _table(source, data, "drivers"))
    for path, table in _flat(_table(source, data, "wire")):
        _read_entry(source, path, table)
    source.parameters = dict(_leaves(_table(source, data, "parameters")))
    source.process = dict(_table(source, data, "process"))
    source.faces = dict(_table(source, data, "faces"))
    source.record = dict(_table(source, data, "record")) if "record" in data else None
    injected, source.seed = data.get("faults", []), data.get("fault_seed", 0)
    if isinstance(injected, list | tuple):
        source.injected = list(injected)
    else:
        source.mistake("faults", f'must be a list such as ["z.encoder stuck at 5 s"], not {injected!r}')


def _named(table: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the table with strings as keys in all inner tables, as in TOML; a mapping such as `{"axes": {0: ...}}` has
    other keys."""
    return {str(key): _named(value) if isinstance(value, Mapping) else value for key, value in table.items()}


def _table(source: WiringSource, data: Mapping[str, Any], section: str) -> Mapping[str, Any]:
    table = data.get(section, {})
    if isinstance(table, Mapping):
        return table
    source.mistake(section, f"must be a table, not {table!r}")
    return {}


def _read_drivers(source: WiringSource, tables: Mapping[str, Any]) -> None:
    """Read a table for each name. If the wiring is a mapping, a driver object may be its type or replace the whole
    table (tests, see umo.testing)."""
    for name, table in tables.items():
        if isinstance(table, Driver):
            source.drivers[name] = {"type": table}
        elif not isinstance(table, Mapping):
            source.mistake(f"drivers.{name}", f"must be a table, not {table!r}")
        elif not isinstance(table.get("type"), str | Driver):
            source.mistake(f"drivers.{name}.type", "is missing: a driver's name, or module:Class")
            source.drivers[name] = {}  # its objects need not be reported as well
        else:
            kind = _absolute(source, name, table["type"])
            source.drivers[name] = {} if kind is None else {**table, "type": kind}


def _absolute(source: WiringSource, name: str, kind: str | Driver) -> str | Driver | None:
    """Return the absolute name of a class such as `.plant:Plant`, which is in a module of the wiring's station. None if
    there is no station, or if it cannot be imported."""
    if isinstance(kind, Driver) or not kind.startswith("."):
        return kind
    folder = station_of(Path(source.file))
    if folder is None:
        source.mistake(
            f"drivers.{name}.type", f"{kind!r} is in a module of a station; {source.file} is not in a station"
        )
        return None
    try:
        return package_of(folder) + kind
    except (Exception, SystemExit) as error:  # of the station's __init__.py
        source.mistake(f"drivers.{name}.type", f"{folder} cannot be imported: {text_of(error)}")
        return None


def _read_entry(source: WiringSource, path: str, table: Any) -> None:
    from pydantic import ValidationError

    from umo.wiring.schema import Entry
    from umo.wiring.schema_mistakes import mistakes_of, types_of

    key = f'wire."{path}"'
    if not isinstance(table, Mapping):
        source.refused.add(path)
        source.mistake(key, f'must be a table such as {{ driver = "simulated" }}, not {table!r}')
        return
    if CONTROLLER in table:
        source.controllers[path] = table
        return
    if path in source.entries:
        source.mistake(key, "is wired twice")
        return
    try:
        source.entries[path] = Entry.model_validate(dict(table))
    except ValidationError as error:
        source.refused.add(path)
        for name, message in mistakes_of(error, list(Entry.model_fields), types_of(Entry)):
            source.mistake(f"{key}.{name}", message)


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Return the entries by path, in whichever form they are written: `"z.motor" = {...}`, `z.motor = {...}` or
    `[wire."z.motor"]`."""
    for key, value in table.items():
        path = f"{prefix}{key}"
        if isinstance(value, Mapping) and value and all(isinstance(item, Mapping) for item in value.values()):
            yield from _flat(value, f"{path}.")
        else:
            yield path, value


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
