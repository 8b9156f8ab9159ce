"""The keys that the table of any driver may have, and the drivers off the cycle."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from umo.drivers.contract import Direction, Driver
from umo.drivers.off_cycle import OffCycle
from umo.duration import duration
from umo.objects.atomic import Atomic
from umo.text import some
from umo.wiring.settings import above_0, names_of, values_of
from umo.wiring.source import WiringSource
from umo.wiring.wired import Wire

OFF_CYCLE, PERIOD, MAX_AGE = "off_cycle", "period", "max_age"
MAX_AGE_PERIODS = 3
"""Default number of periods of a driver off the cycle after which one of its values becomes STALE."""


@dataclass(frozen=True)
class DriverTable:
    """The keys of a driver's table that are not options of its type. Times are in s; None means the default."""

    timeout: Annotated[float | None, above_0()] = None
    watchdog: Annotated[float | None, above_0()] = None
    off_cycle: bool = False
    period: Annotated[float | None, above_0()] = None
    max_age: Annotated[float | None, above_0()] = None


OWN = names_of(DriverTable)


def driver_table(source: WiringSource, name: str, table: Mapping[str, Any]) -> DriverTable:
    """Return the settings in the table of a driver that every driver may have. Wrong and contradictory keys are added
    to the mistakes."""
    given = {key: table[key] for key in OWN if key in table}
    if not given:
        return DriverTable()
    values, mistakes = values_of(DriverTable, given)
    found = DriverTable(**values)
    if found.off_cycle and PERIOD not in given:
        mistakes.append((PERIOD, 'is missing: the time from one transfer to the next, such as "100 ms"'))
    if not found.off_cycle:
        without = "can only be used with a driver off the cycle: add off_cycle = true"
        mistakes += [(key, without) for key in (PERIOD, MAX_AGE) if key in given]
    for key, text in mistakes:
        source.mistake(f"drivers.{name}.{key}", text)
    return found


def take_off_cycle(
    source: WiringSource,
    wires: list[Wire],
    drivers: dict[str, Driver[Any]],
    tables: Mapping[str, DriverTable],
    timer: Atomic | None,
) -> None:
    """Replace each driver that is off the cycle by a proxy that uses the image in shared memory."""
    for name, driver in drivers.items():
        if isinstance(driver, OffCycle):  # it was made in Python
            _meet(driver, [wire for wire in wires if wire.driver is driver])
            continue
        table = tables[name]
        if not table.off_cycle or (period := table.period) is None:  # one that is missing is reported
            continue
        max_age = table.max_age or MAX_AGE_PERIODS * period
        if max_age < period:
            text = f"{duration(max_age)} is less than the driver's period, {duration(period)}"
            source.mistake(f"drivers.{name}.{MAX_AGE}", text)
        is_timer = any(wire.item is timer and wire.driver is driver for wire in wires)
        if driver.simulates_time or is_timer:
            source.mistake(
                f"drivers.{name}.{OFF_CYCLE}",
                "the machine's timer is wired to this driver, so the driver cannot be off the cycle",
            )
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
    """Check that only one process uses a device: either all drivers that share a device must be off the cycle, or none
    of them."""
    for device in {device for devices in hardware.values() for device in devices}:
        sharing = [name for name, devices in hardware.items() if device in devices]
        off = [name for name in sharing if isinstance(drivers.get(name), OffCycle)]
        if off and len(off) < len(sharing):
            others = [name for name in sharing if name not in off]
            text = f"{some(others)} shares {device} with this driver, and must be off the cycle too"
            source.mistake(f"drivers.{off[0]}.{OFF_CYCLE}", text)
