"""The keys `off_cycle`, `period` and `max_age` of a driver's table: a driver off the cycle."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from umo.drivers.contract import Direction, Driver
from umo.drivers.off_cycle import OffCycle
from umo.objects.atomic import Atomic
from umo.presentation.durations import duration
from umo.text import some
from umo.wiring.source import WiringSource
from umo.wiring.wired import Wire

OFF_CYCLE, PERIOD, MAX_AGE = "off_cycle", "period", "max_age"
MAX_AGE_PERIODS = 3
"""Periods of a driver off the cycle after which a value of its is STALE, by default."""


def own_period(source: WiringSource, name: str, table: Mapping[str, Any]) -> float | None:
    """The period in s of a driver that is off the cycle; None for any other. Contradictory keys become mistakes."""
    key, off = f"drivers.{name}", table.get(OFF_CYCLE, False)
    if off is not True:
        if off is not False:
            source.mistake(f"{key}.{OFF_CYCLE}", f"must be true or false, without quotes, not {off!r}")
        for other in (PERIOD, MAX_AGE):
            if other in table:
                source.mistake(f"{key}.{other}", "is for a driver off the cycle: add off_cycle = true")
        return None
    if PERIOD not in table:
        source.mistake(f"{key}.{PERIOD}", 'is missing: the time from one transfer to the next, such as "100 ms"')
        return None
    return source.duration(f"{key}.{PERIOD}", table[PERIOD])


def take_off_cycle(
    source: WiringSource, wires: list[Wire], drivers: dict[str, Driver[Any]], timer: Atomic | None
) -> None:
    """Put what meets the image in shared memory in the place of each driver that is off the cycle."""
    for name, driver in drivers.items():
        if isinstance(driver, OffCycle):  # it was made in Python
            _meet(driver, [wire for wire in wires if wire.driver is driver])
            continue
        table = source.drivers.get(name, {})
        if table.get(OFF_CYCLE) is not True:
            continue
        period = source.duration(f"drivers.{name}.{PERIOD}", table.get(PERIOD))
        if period is None:
            continue  # it is reported
        max_age = source.duration(f"drivers.{name}.{MAX_AGE}", table.get(MAX_AGE)) or MAX_AGE_PERIODS * period
        if max_age < period:
            text = f"{duration(max_age)} is less than the driver's period, {duration(period)}"
            source.mistake(f"drivers.{name}.{MAX_AGE}", text)
        is_timer = any(wire.item is timer and wire.driver is driver for wire in wires)
        if driver.simulates_time or is_timer:
            source.mistake(f"drivers.{name}.{OFF_CYCLE}", "the machine's timer is on this driver: it is the cycle")
            continue
        proxy = OffCycle(driver, period, max_age)
        mine = [number for number, wire in enumerate(wires) if wire.driver is driver]
        for number in mine:
            wires[number] = dataclasses.replace(wires[number], driver=proxy)
        _meet(proxy, [wires[number] for number in mine])
        drivers[name] = proxy


def _meet(proxy: OffCycle, wires: Sequence[Wire]) -> None:
    synchronous = [wire for wire in wires if wire.item.synchronous]
    proxy.meet(
        [wire.channel for wire in wires],
        [wire.channel for wire in wires if wire.item.direction is Direction.INPUT],
        [wire.channel for wire in synchronous if wire.item.direction is Direction.OUTPUT],
    )


def check_shared_devices(
    source: WiringSource, drivers: Mapping[str, Driver[Any]], hardware: Mapping[str, Sequence[str]]
) -> None:
    """One process holds a device: of the drivers that share one all are off the cycle, or none is."""
    for device in {device for devices in hardware.values() for device in devices}:
        sharing = [name for name, devices in hardware.items() if device in devices]
        off = [name for name in sharing if isinstance(drivers.get(name), OffCycle)]
        if off and len(off) < len(sharing):
            others = [name for name in sharing if name not in off]
            text = f"{some(others)} shares {device} with it, and must be off the cycle too"
            source.mistake(f"drivers.{off[0]}.{OFF_CYCLE}", text)
