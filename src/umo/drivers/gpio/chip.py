"""The search for a GPIO chip by its path, name or label."""

from __future__ import annotations

import os
from pathlib import Path

import gpiod

from umo.drivers._device_file import explained, listed, numbered, one_named
from umo.errors import DriverError


def path_of(chip: str) -> str:
    """Return the device file of the chip with this path, name or label."""
    for path in (chip, f"/dev/{chip}"):
        if "/" in path and os.path.exists(path):
            path = os.path.realpath(path)
            if not gpiod.is_gpiochip_device(path):
                raise DriverError(f"{path} is not a GPIO chip")
            return path
    if "/" in chip:
        raise DriverError(f"there is no device {chip}; {listed('GPIO chip', dict.fromkeys(_paths(), ()))}")
    return _labelled(chip)


def named(chip: gpiod.Chip) -> dict[str, list[int]]:
    """Return the lines of the chip by their names."""
    found: dict[str, list[int]] = {}
    for offset in range(chip.get_info().num_lines):
        if name := chip.get_line_info(offset).name:
            found.setdefault(name, []).append(offset)
    return found


def _labelled(label: str) -> str:
    labels: dict[str, list[str]] = {}
    refused = ""
    for path in _paths():
        labels[path] = []
        try:
            with gpiod.Chip(path) as chip:
                labels[path] = [chip.get_info().label]
        except OSError as error:
            refused = f"; {explained(path, error)}"
    try:
        return os.path.realpath(one_named("GPIO chip", label, labels))
    except DriverError as error:
        raise DriverError(f"{error}{refused}") from None


def _paths() -> list[str]:
    return list(map(str, numbered(Path("/dev"), "gpiochip")))
