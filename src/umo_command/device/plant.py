"""`umo device plant`: serves a station's plant over Modbus TCP. The registers are derived from two wirings of the
station."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from umo.errors import WiringError
from umo.plant.register_map import RegisterMap, register_maps
from umo.plant.serve import serve_until_signal
from umo.process.station import Station, StationError
from umo.system.streams import limit_waits
from umo.wiring import distribute_options, resolve
from umo.wiring.source import read
from umo_command.console import out
from umo_command.run.run_folder import rows
from umo_command.station_options import parse

MODBUS = "modbus"
"""The name of the served wiring and of its driver."""


def serve_plant(
    station: Station,
    wiring: str | None,
    plant_wiring: str | None,
    arguments: Sequence[str],
    changes: Mapping[str, Any],
    report: Path | None,
    injected: Mapping[str, Any],
) -> None:
    """Serve until SIGINT or SIGTERM, then print the report on one line. `changes` are the new values of host, port and
    watchdog that are not None. `arguments` are the options of the machine and of the plant's drivers."""
    limit_waits()
    served = modbus_wiring(station, wiring)
    options = parse(station, plant_wiring, arguments, application=False)
    simulated = station.wiring(plant_wiring)
    if plant_wiring is None and simulated is not None and _uses(simulated):
        raise StationError(
            f"{station.name} has no plant: none of its wirings is simulated; write wiring/simulated.toml with a driver "
            "that is the plant (`umo new station` makes an example), or name a wiring with --plant-wiring"
        )
    shares = distribute_options({**options, **injected}, machine=station.make, wiring=simulated)
    machine = station.machine(**shares.machine)
    plant = resolve(machine, simulated, shares.wiring)
    bus = resolve(machine, served, to_run=False)
    try:
        maps = register_maps(plant, bus)
    except WiringError as error:
        raise WiringError(f"{error} (plant: {simulated or 'everything simulated'}; Modbus: {served})") from None

    def announce(name: str, host: str, port: int) -> None:
        out.print(f"{station.name} plant, {name}: Modbus TCP at {host}:{port}", soft_wrap=True)

    summary = serve_until_signal(plant, _changed(maps, changes), ready=announce, report=report)
    out.print(", ".join(f"{name} {value}" for name, value in rows("report", summary)), soft_wrap=True)


def modbus_wiring(station: Station, name: str | None) -> Path | None:
    """Return the Modbus wiring with this name. Without a name return the wiring called modbus, or else the only wiring
    with a modbus driver."""
    if name is not None:
        return station.wiring(name)
    found = [MODBUS] if MODBUS in station.wirings else [key for key, file in station.wirings.items() if _uses(file)]
    if len(found) == 1:
        return station.wirings[found[0]]
    if found:
        raise StationError(f"{station.name} has several Modbus wirings: choose one with -w: {', '.join(found)}")
    raise StationError(
        f"{station.name} has no Modbus wiring: write wiring/modbus.toml with the register of each object, "
        "or name a file with -w"
    )


def _uses(file: Path) -> bool:
    """True if a wiring has a modbus driver."""
    source = read(file)
    used = {entry.driver for entry in source.entries.values()} - source.drivers.keys()
    return MODBUS in used | {table.get("type") for table in source.drivers.values()}


def _changed(maps: Sequence[RegisterMap], changes: Mapping[str, Any]) -> list[RegisterMap]:
    given = {name: value for name, value in changes.items() if value is not None}
    if len(maps) > 1 and (given.keys() & {"host", "port"}):
        names = ", ".join(each.name for each in maps)
        raise StationError(f"--host and --port need a wiring with one box; this wiring has {len(maps)}: {names}")
    return [replace(each, **given) for each in maps]
