"""A recording as an xarray Dataset. It has a variable for each object and signal, with unit, range and states."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from umo.errors import OptionError
from umo.objects import Quality
from umo.objects.presentation.described import Described
from umo.recording.recording import Recording
from umo.recording.tables.recorded_values import RecordedColumns, RecordedValues
from umo.system.packages import how_to_install

if TYPE_CHECKING:
    import xarray

log = logging.getLogger(__name__)
ATTRIBUTES = {"unit": "units", "minimum": "minimum", "maximum": "maximum", "kind": "kind", "wire": "wire"}
"""The parts of an object's description that become attributes, with the names of these attributes."""


def load(
    path: Path | str, only: Sequence[str] = (), start: float | None = None, stop: float | None = None
) -> xarray.Dataset:
    """Load a recording as a Dataset (see `umo.load`)."""
    try:
        import xarray
    except ImportError:
        raise OptionError(f"umo.load needs xarray: {how_to_install('analysis')}") from None
    with Recording(path) as recording:
        values = RecordedValues(recording, only, start, stop)
        parts = [values.columns(np.zeros(0, values.layout.dtype))]
        parts += [values.columns(part.frames) for part in values.parts()]
        columns = RecordedColumns(*map(np.concatenate, zip(*parts, strict=True)))
        variables = {
            name: ("time", columns.values[:, i], attributes(about))
            for i, (name, about) in enumerate(zip(values.names, values.entries, strict=True))
        }
        variables |= {name: ("time", columns.quality[:, i], QUALITY) for i, name in enumerate(values.quality_names)}
        variables["missed"] = ("time", columns.missed, {"long_name": "number of periods missed before this period"})
        coordinates = {
            "time": ("time", columns.time, {"units": "s", "long_name": "time on the machine's clock"}),
            "utc": ("time", columns.utc.astype("datetime64[ns]"), {"long_name": "UTC"}),
        }
        return xarray.Dataset(variables, coordinates, _about(recording, values.bare))


QUALITY = {
    "flag_values": [int(each) for each in Quality],
    "flag_meanings": " ".join(str(each).replace(" ", "_") for each in Quality),
}
"""Attributes of a variable that has the quality of another variable."""


def attributes(about: Described) -> dict[str, Any]:
    """Return the units, range and states of an object or a signal as attributes. They follow the CF conventions where
    these apply."""
    found = {name: about.plain[key] for key, name in ATTRIBUTES.items() if about.plain.get(key) not in (None, "")}
    if about.states:
        meanings = " ".join(name.replace(" ", "_") for name in about.states.values())
        found |= {"flag_values": list(about.states), "flag_meanings": meanings}
    return found


def _about(recording: Recording, bare: int) -> dict[str, Any]:
    about = recording.about
    told = {name: about[name] for name in ("station", "wiring", "period", "started") if about.get(name) is not None}
    lost, damage = recording.lost, "\n".join(recording.damage)
    if damage:
        log.warning("%s", damage)
    boxes = "\n".join(f"{box.time:g} s: {box.text or box.reason}" for box in recording.black_boxes)
    return told | {
        "periods_lost": lost, "damage": damage, "periods_without_values": bare, "black_boxes": boxes,
        "black_box_count": recording.black_box_count,
        "recording": str(recording.path),
    }  # fmt: skip
