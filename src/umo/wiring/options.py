"""Which options of a run (`--seed`, `--realtime`) the drivers of a wiring take."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from umo.drivers import registry
from umo.errors import WiringError
from umo.wiring.source import read


def driver_options(wiring: Path | str | Mapping[str, Any] | None) -> set[str]:
    """The names of all options of all drivers in use; what is wrong with the wiring is for `check` to say."""
    if wiring is None:
        return set()
    source = read(wiring)
    types = {name: table.get("type", name) for name, table in source.drivers.items()}
    names = {types.get(entry.driver, entry.driver) for entry in source.entries.values()}
    taken: set[str] = set()
    for name in names | set(types.values()):
        try:
            taken |= inspect.signature(registry.find(name)).parameters.keys()
        except (WiringError, TypeError, ValueError):  # ValueError: a class without a signature
            continue
    return taken
