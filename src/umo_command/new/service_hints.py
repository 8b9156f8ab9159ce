"""Finds the requirements of a service: the groups of its devices, and settings of a Raspberry Pi."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

GROUPS = {"gpio": "gpio", "i2c": "i2c", "spi": "spi", "serial": "dialout", "iio": "iio", "counter": "counter"}
"""The group of each kind of device in Debian and Raspberry Pi OS. The devices iio and counter have no group there, and
need a udev rule."""
WITHOUT_RULE = ("iio", "counter")
MODEL = Path("/proc/device-tree/model")
OVERLAYS = {
    "i2c": "dtparam=i2c_arm=on",
    "spi": "dtparam=spi=on",
    "serial": "enable_uart=1 for the serial port of the header, which must not have a login",
}
"""Lines of config.txt by the kind of device."""


def groups_for(devices: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the supplementary groups for these devices: the group of the device file if that exists, otherwise the
    usual group of its kind. The second list has a line for each group that does not exist on this computer. A unit with
    such a group would not start."""
    kinds = [(device.partition(" ")[0], device) for device in devices]
    wanted = {(kind, _owner(device) or GROUPS[kind]) for kind, device in kinds if kind in GROUPS}
    missing = sorted(each for each in wanted if not _is_there(each[1]))
    groups = sorted({group for _, group in wanted.difference(missing)})
    return groups, [_advice(kind, group) for kind, group in missing]


def hints(devices: Iterable[str]) -> list[str]:
    """Return the settings needed on a Raspberry Pi. Return nothing on other computers."""
    kinds = {device.partition(" ")[0] for device in devices}
    try:
        model = MODEL.read_bytes().decode(errors="replace").rstrip("\0")
    except OSError:
        return []
    if "Raspberry Pi" not in model:
        return []
    lines = [line for kind, line in OVERLAYS.items() if kind in kinds]
    return [
        *([f"{model}: in /boot/firmware/config.txt: {'; '.join(lines)}"] if lines else []),
        f"{model}: periods below 10 ms need a PREEMPT_RT kernel, and isolcpus=3 in /boot/firmware/cmdline.txt "
        "(docs/howto-run-as-a-service.md)",
    ]


def _advice(kind: str, group: str) -> str:
    rule = (
        f'; a rule of udev, such as SUBSYSTEM=="{kind}", GROUP="{group}", MODE="0660"' if kind in WITHOUT_RULE else ""
    )
    return (
        f"there is no group {group} here, so the unit does not name it; to create the group: sudo groupadd --system "
        f"{group}{rule}"
    )


def _owner(device: str) -> str | None:
    """The group of a device file (`gpio /dev/gpiochip0`, `i2c /dev/i2c-1 address 0x48`), unless it is root's."""
    path = next((word for word in device.split() if word.startswith("/dev/")), None)
    try:
        import grp

        number = None if path is None else os.stat(path).st_gid
        return grp.getgrgid(number).gr_name if number else None
    except (OSError, KeyError, ImportError):
        return None


def _is_there(group: str) -> bool:
    try:
        import grp

        grp.getgrnam(group)
    except (KeyError, ImportError):
        return False
    return True
