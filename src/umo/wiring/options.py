"""Which options of a run (`--seed 7`) the drivers of a wiring take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from umo.drivers import Driver, registry
from umo.errors import WiringError
from umo.wiring.source import read

RESERVED = ("type", "timeout", "watchdog")
"""Keys of a driver's table that are not options of the driver."""
REALTIME = "realtime"
"""The option of a run that belongs to the wiring and not to a driver: its timer keeps the pace of the wall clock."""
FAULT, FAULT_SEED = "fault", "fault_seed"
"""Two more: faults to inject, in addition to those of the wiring, and the seed of their random numbers."""
OF_WIRINGS = (REALTIME, FAULT, FAULT_SEED)


def driver_options(wiring: Path | str | Mapping[str, Any] | None) -> dict[str, tuple[str, inspect.Parameter]]:
    """All options of all drivers in use by name: the driver's type and the parameter. Faults are left to `check`."""
    if wiring is None:
        return {}
    source = read(wiring)
    types = {name: table.get("type", name) for name, table in source.drivers.items()}
    names = {types.get(entry.driver, entry.driver): None for entry in source.entries.values()}
    taken: dict[str, tuple[str, inspect.Parameter]] = {}
    for name in dict.fromkeys([*types.values(), *names]):
        try:
            parameters = inspect.signature(registry.find(name), eval_str=True).parameters
        except (WiringError, TypeError, ValueError, NameError):  # ValueError: a class without a signature
            continue
        new = {key: (str(name), parameter) for key, parameter in parameters.items() if key not in taken}
        taken |= {key: found for key, found in new.items() if key not in OF_WIRINGS}
    return taken


def maker_of(wiring: Path | str | Mapping[str, Any] | None, name: str) -> partial[Driver[Any]]:
    """Makes drivers like that of this name, in a wiring that `check` found right; keywords change options."""
    from umo.wiring.entry import options_of

    table = {"type": name} | (read(wiring).drivers.get(name, {}) if wiring is not None else {})
    cls = registry.find(table["type"])
    given = {key: value for key, value in table.items() if key not in RESERVED}
    return partial(cls, **options_of(cls.__name__, inspect.signature(cls, eval_str=True).parameters, given))
