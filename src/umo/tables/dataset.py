"""A recording as an xarray Dataset: a variable for each object and signal, with its unit, range and states."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from umo.errors import OptionError
from umo.objects import Quality
from umo.presentation.described import Described
from umo.recording import Recording
from umo.recording.recording_file import utc_of
from umo.tables.recorded_values import RecordedValues

if TYPE_CHECKING:
    import xarray

log = logging.getLogger(__name__)
ATTRIBUTES = {"unit": "units", "minimum": "minimum", "maximum": "maximum", "kind": "kind", "wire": "wire"}
"""What of a description becomes an attribute, under which name."""


def load(
    path: Path | str, only: Sequence[str] = (), start: float | None = None, stop: float | None = None
) -> xarray.Dataset:
    """See `umo.load`."""
    try:
        import xarray
    except ImportError:
        raise OptionError('umo.load needs xarray: pip install "umo[analysis]"') from None
    with Recording(path) as recording:
        values = RecordedValues(recording, only, start, stop)
        parts = [_columns(values, np.zeros(0, values.layout.dtype))]
        parts += [_columns(values, part.frames) for part in values.parts()]
        rows, quality, utc, time, missed = map(np.concatenate, zip(*parts, strict=True))
        variables = {
            name: ("time", rows[:, i], attributes(about))
            for i, (name, about) in enumerate(zip(values.names, values.entries, strict=True))
        }
        for column, place in enumerate(values.objects):
            variables[f"{values.layout.objects[place]['path']}.quality"] = ("time", quality[:, column], QUALITY)
        variables["missed"] = ("time", missed, {"long_name": "periods that were missed before this one"})
        coordinates = {
            "time": ("time", time, {"units": "s", "long_name": "time on the machine's clock"}),
            "utc": ("time", utc.astype("datetime64[ns]"), {"long_name": "UTC"}),
        }
        return xarray.Dataset(variables, coordinates, _about(recording, values.bare))


def _columns(values: RecordedValues, frames: Any) -> tuple[Any, ...]:
    """Values, qualities, UTC, time and missed periods: copies, so that the frames are not held."""
    quality, utc = frames["quality"][:, values.objects], utc_of(values.layout, frames)
    return values.of(frames), quality, utc, frames["time"].copy(), frames["missed"].copy()


QUALITY = {
    "flag_values": [int(each) for each in Quality],
    "flag_meanings": " ".join(str(each).replace(" ", "_") for each in Quality),
}
"""Attributes of a variable with the quality of another."""


def attributes(about: Described) -> dict[str, Any]:
    """Units, range and states of an object or a signal, as CF has them where it can say it."""
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
