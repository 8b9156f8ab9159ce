"""umo, Universal Mechatronic Objects: the object layer between device drivers and control software.

Declare a machine's actuators and sensors, wire each to a driver's channel in a TOML file, and write control
code that does not depend on the circuits. After Muir and Horner, "Mechatronic objects for
real-time control software development" (1998).

This module has the names that every program needs. Other names are in modules: two-state types in `umo.states`, errors
in `umo.errors`, control laws and axes in `umo.control`, names for drivers in `umo.drivers`, names for tests in
`umo.testing`.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

    from umo.clients.remote import attach
    from umo.cycle.connect import connect
    from umo.cycle.frame import Frame
    from umo.cycle.run import drive, run
    from umo.errors import TaskFailed, UmoError
    from umo.objects import (
        BinaryActuator,
        BinarySensor,
        Compound,
        DigitalActuator,
        DigitalSensor,
        Interlock,
        LookupTable,
        Number,
        Polynomial,
        Quality,
        Range,
        Thermocouple,
        Vector,
        action,
    )
    from umo.process.frames import published
    from umo.process.start import RunFailed, Started, start
    from umo.wiring import check

__all__ = [
    "BinaryActuator",
    "BinarySensor",
    "Compound",
    "DigitalActuator",
    "DigitalSensor",
    "Frame",
    "Interlock",
    "LookupTable",
    "Number",
    "Polynomial",
    "Quality",
    "Range",
    "RunFailed",
    "Started",
    "TaskFailed",
    "Thermocouple",
    "UmoError",
    "Vector",
    "action",
    "attach",
    "check",
    "connect",
    "drive",
    "load",
    "published",
    "run",
    "start",
]

_ROOMS = {
    "cycle.connect": ("connect",),
    "cycle.frame": ("Frame",),
    "cycle.run": ("drive", "run"),
    "errors": ("TaskFailed", "UmoError"),
    "clients.remote": ("attach",),
    "process.frames": ("published",),
    "process.start": ("RunFailed", "Started", "start"),
    "wiring": ("check",),
}
"""The modules of umo from which the names are imported. Names that are not in this table come from `objects`."""
_ROOM_OF = dict.fromkeys(__all__, "objects") | {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a name or a package of umo when it is first used (PEP 562), so that a program that declares or analyses
    does not wait for the import of the cycle and its processes."""
    if (room := _ROOM_OF.get(name)) is not None:
        found = globals()[name] = getattr(importlib.import_module(f"umo.{room}"), name)
        return found
    if name.startswith("_") or importlib.util.find_spec(f"umo.{name}") is None:
        raise AttributeError(f"module 'umo' has no attribute {name!r}")
    return importlib.import_module(f"umo.{name}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def load(
    path: Path | str, only: Sequence[str] = (), start: float | None = None, stop: float | None = None
) -> xarray.Dataset:
    """Return a recording (`umo run --record`) as an xarray Dataset: a variable for each object and signal along `time`.

    `only`: paths or patterns; without it, everything is loaded. `start`, `stop`: times in s on the machine's clock;
    `stop` is excluded. The coordinates are `time`, in s on the machine's clock, and `utc`. Units, ranges and states are
    attributes. `PATH.quality` is the quality of an object's value; the value is NaN where its quality was BAD. Raises
    OptionError if xarray is not installed (extra `analysis`), FramesError if the file is not a recording, PathError for
    a path that names no object or signal. Source: `umo.recording.tables.dataset`.
    """
    from umo.recording.tables import dataset

    return dataset.load(path, only, start, stop)
