"""Finding a GPIO chip by its path, name or label."""

from __future__ import annotations

import os
from glob import glob

import gpiod

from umo.drivers._device_file import explained
from umo.errors import DriverError
from umo.text import did_you_mean


def path_of(chip: str) -> str:
    """The device file of the chip with this path, name or label."""
    for path in (chip, f"/dev/{chip}"):
        if "/" in path and os.path.exists(path):
            path = os.path.realpath(path)
            if not gpiod.is_gpiochip_device(path):
                raise DriverError(f"{path} is not a GPIO chip")
            return path
    if "/" in chip:
        raise DriverError(f"no device {chip}{_known({})}")
    return _labelled(chip)


def named(chip: gpiod.Chip) -> dict[str, list[int]]:
    """The lines of the chip by their names."""
    found: dict[str, list[int]] = {}
    for offset in range(chip.get_info().num_lines):
        if name := chip.get_line_info(offset).name:
            found.setdefault(name, []).append(offset)
    return found


def _labelled(label: str) -> str:
    labels, refused = {}, ""
    for path in _paths():
        try:
            with gpiod.Chip(path) as chip:
                labels[path] = chip.get_info().label
        except OSError as error:
            refused = explained(path, error)
    found = [path for path, each in labels.items() if each == label]
    if len(found) > 1:
        raise DriverError(f"{' and '.join(found)} both have the label {label!r}: use a path")
    if not found:
        raise DriverError(f"no GPIO chip {label!r}{_known(labels, label)}{refused and f'; {refused}'}")
    return os.path.realpath(found[0])


def _known(labels: dict[str, str], wanted: str = "") -> str:
    names = [f"{path} ({labels[path]})" if path in labels else path for path in _paths()]
    near = did_you_mean(wanted, labels.values())
    return f"{near}; there are: {', '.join(names)}" if names else "; this computer has no GPIO chips"


def _paths() -> list[str]:
    return sorted(glob("/dev/gpiochip*"), key=lambda path: (len(path), path))
