"""Devices of Linux Industrial I/O in sysfs: their names, channels, scales and units. No device is opened.

Names and units are those of the kernel's Documentation/ABI/testing/sysfs-bus-iio.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from umo.drivers._device_file import numbered, one_named, text_in
from umo.drivers.optional import PhysicalScale

SYSFS = Path("/sys/bus/iio/devices")
DEV = Path("/dev")

_MILLI = 0.001
UNITS = {
    "voltage": (1.0, "mV"),
    "current": (1.0, "mA"),
    "power": (1.0, "mW"),
    "capacitance": (1.0, "nF"),
    "resistance": (1.0, "ohm"),
    "temp": (_MILLI, "degC"),
    "accel": (1.0, "m/s^2"),
    "gravity": (1.0, "m/s^2"),
    "anglvel": (1.0, "rad/s"),
    "angl": (1.0, "rad"),
    "deltaangl": (1.0, "rad"),
    "deltavelocity": (1.0, "m/s"),
    "velocity": (1.0, "m/s"),
    "phase": (1.0, "rad"),
    "magn": (1.0, "gauss"),
    "pressure": (1.0, "kPa"),
    "humidityrelative": (_MILLI, "percent"),
    "concentration": (1.0, "percent"),
    "positionrelative": (_MILLI, "percent"),
    "illuminance": (1.0, "lux"),
    "distance": (1.0, "m"),
    "energy": (1.0, "J"),
    "electricalconductivity": (1.0, "S/m"),
}
"""The unit that pint knows, and the factor from the kernel's unit to this unit, by the type of channel."""


def find(device: str) -> Path:
    """Return the sysfs folder of the device with this name, label or number (`iio:device0`)."""
    there = {
        folder.name: [text_in(folder / "name"), text_in(folder / "label")] for folder in numbered(SYSFS, "iio:device")
    }
    return SYSFS / one_named("IIO device", device, there)


def channels(folder: Path) -> list[str]:
    """Return the channels that have a raw value, and the processed values."""
    raw = sorted(file.name.removesuffix("_raw") for file in folder.glob("*_raw") if _DIRECTED.match(file.name))
    return raw + sorted(file.name for file in folder.glob("in_*_input"))


_DIRECTED = re.compile("in_|out_")


def processed_scale(channel: str, scale: float) -> PhysicalScale | None:
    """Return the scale of a processed value with this scale, in the units of the kernel's ABI."""
    factor, units = _units(channel)
    return PhysicalScale(scale * factor, 0.0, units) if factor else None


def _units(channel: str) -> tuple[float, str]:
    """Return factor and unit of the channel's type; the factor is 0 for a type without units."""
    return UNITS.get(re.split(r"[^a-z]", channel.partition("_")[2])[0], (0.0, ""))


def scale_of(folder: Path, channel: str) -> PhysicalScale | None:
    """Return (raw + offset) * scale in the units of the kernel's ABI; None if the kernel gives no scale, or if the type
    of the channel has no units."""
    factor, units = _units(channel)
    scale = _attribute(folder, channel, "scale")
    if not factor or not scale:
        return None
    resolution = scale * factor
    return PhysicalScale(resolution, (_attribute(folder, channel, "offset") or 0.0) * resolution, units)


def _attribute(folder: Path, channel: str, name: str) -> float | None:
    for each in _names(channel):
        with suppress(OSError, ValueError):
            return float((folder / f"{each}{name}").read_text())
    return None


def _names(channel: str) -> Iterator[str]:
    """Yield the beginnings of the names of attributes, the channel's own before shared ones: in_accel_x_, in_accel_,
    in_, ""."""
    yield f"{channel}_"
    shared = re.sub(r"\d", "", channel)
    while shared:
        yield f"{shared}_"
        shared = shared.rpartition("_")[0]
    yield ""


def place(folder: Path) -> str:
    """Return the character device of a device's buffers."""
    return str(DEV / os.path.basename(os.path.realpath(folder)))
