"""The registers of a plant's boxes, derived from two wirings of one machine: the simulated wiring and the Modbus
wiring."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from umo.drivers.contract import Direction
from umo.drivers.modbus import Host, Modbus, ModbusChannel
from umo.drivers.wrapping import bare
from umo.errors import WiringError
from umo.objects import Actuator
from umo.wiring import Wire, Wired


class Point:
    """One object between its channel of the plant and its cells in a table of the box.

    The raw integer is passed unchanged if both wirings give the object the same scale (resolution, zero offset and
    linearization, or inversion); otherwise the box converts it through the value, and an invalid raw integer of the
    plant becomes the invalid raw integer of the bus. `slot` is the index of the plant's wire."""

    def __init__(self, slot: int, plant: Wire, bus: Wire) -> None:
        channel = bus.channel
        assert isinstance(channel, ModbusChannel)
        self.slot = slot
        self.path = plant.item.path
        self.table, self.address, self.cells = channel.table.name, channel.address, channel.cells
        self.output = plant.item.direction is Direction.OUTPUT
        default: Any = plant.item._default_value() if isinstance(plant.item, Actuator) else None
        self.default = bus.raw(default) if self.output else 0
        """The raw integer of an output's register at power-up."""
        self.plant_default = plant.raw(default) if self.output else 0
        self._plant, self._bus = plant, bus
        self._equal = (plant.scale, plant.linearization) == (bus.scale, bus.linearization)
        self._little, self._swapped, self._scale = channel.little, channel.swapped, channel.scale
        self.is_field = channel.low is not None
        self._low = channel.low or 0
        self._bits = channel.bits if channel.low is not None or channel.table.full == 1 else 16 * channel.cells

    def to_plant(self, raw: int) -> int:
        """Convert a raw integer of the box to one of the plant. Raises OverflowError if it does not fit the plant's
        channel."""
        return self._converted(raw, self._bus, self._plant)

    def to_bus(self, raw: int) -> int:
        """Convert a raw integer of the plant to one of the box. Raises OverflowError if it does not fit the
        register."""
        if raw in self._plant.invalid_raws and self._bus.invalid_raws:
            return self._bus.invalid_raws[0]
        return self._converted(raw, self._plant, self._bus)

    def _converted(self, raw: int, here: Wire, there: Wire) -> int:
        if not self._equal:
            raw = there.nearest(here.value(raw))
        if not there.channel.lowest <= raw <= there.channel.highest:
            raise OverflowError(f"{raw} does not fit {there.channel.text}")
        return raw

    def words(self, raw: int) -> list[int]:
        """Return the raw integer in this point's cells, in the order of their addresses; 0 in the bits of other
        points."""
        if self._scale:
            packed = struct.pack(self._floating, raw * self._scale)
        else:
            packed = ((raw & (1 << self._bits) - 1) << self._low).to_bytes(2 * self.cells, "big")
        words = list(struct.unpack(self._layout, packed))
        return words[::-1] if self._little else words

    def raw(self, words: Sequence[int]) -> int:
        """Return the raw integer that these cells hold. Raises OverflowError if they hold no raw integer."""
        packed = struct.pack(self._layout, *(reversed(words) if self._little else words))
        if not self._scale:
            whole = int.from_bytes(packed, "big") >> self._low & (1 << self._bits) - 1
            return whole - (1 << self._bits) if self._bus.channel.signed and whole >> (self._bits - 1) else whole
        value: float = struct.unpack(self._floating, packed)[0]
        try:
            return round(value / self._scale)
        except ValueError:
            raise OverflowError(f"{value:g} is not a number") from None

    @property
    def _layout(self) -> str:
        """The format of the registers for `struct`, with the order of the bytes in each register."""
        return f"{'<' if self._swapped else '>'}{self.cells}H"

    @property
    def _floating(self) -> str:
        return ">f" if self.cells == 2 else ">d"


@dataclass(frozen=True)
class RegisterMap:
    """The register map of one box, which is the other end of a Modbus driver in the wiring."""

    name: str
    """The driver's name in the wiring."""
    host: str
    port: int
    points: tuple[Point, ...]
    watchdog_register: int | None = None
    """The holding register of the watchdog's time in ms."""
    watchdog: float = 0.0
    """The watchdog's time at power-up in s; 0 means off."""


def register_maps(plant: Wired, bus: Wired) -> list[RegisterMap]:
    """Return a map for each Modbus driver of the wiring `bus`. Its objects are joined with those of the wiring `plant`
    by path. Raises WiringError if `plant` is not a simulation with a timer, if `bus` has no Modbus driver, or if two
    objects would have the same address.
    """
    _check_plant(plant)
    slots = {wire.path: slot for slot, wire in enumerate(plant.wires)}
    missing = [wire.path for wire in bus.wires if wire.path not in slots]
    if missing:
        raise WiringError(f"the plant has no object for {', '.join(missing)}")
    maps = []
    for name, driver in ((name, bare(driver)) for name, driver in bus.drivers.items()):
        if isinstance(driver, Modbus):
            if not isinstance(driver.place, Host):
                raise WiringError(f"driver {name} is on a serial line; a box serves Modbus TCP")
            wires = [wire for wire in bus.wires if bare(wire.driver) is driver]
            points = [Point(slot := slots[wire.path], plant.wires[slot], wire) for wire in wires]
            register, watchdog = driver.watchdog_register, bus.watchdogs.get(name, 0.0)
            maps.append(RegisterMap(name, driver.place.host, driver.place.port, tuple(points), register, watchdog))
    _check_maps(maps)
    return maps


def _check_plant(plant: Wired) -> None:
    if plant.hardware:
        name, devices = next(iter(plant.hardware.items()))
        raise WiringError(f"the plant's wiring is not a simulation: its driver {name} controls {devices[0]}")
    if plant.timer_wire is None:
        raise WiringError("no time can pass in the plant: the machine has no object `timer`")
    if plant.realtime:
        raise WiringError("no time can pass in the plant: its wiring has a real-time timer instead of the plant's")


def _check_maps(maps: Sequence[RegisterMap]) -> None:
    if not maps:
        raise WiringError("the wiring to serve has no modbus driver")
    addresses = Counter((each.host, each.port) for each in maps)
    for (host, port), count in addresses.items():
        if count > 1:
            names = " and ".join(each.name for each in maps if (each.host, each.port) == (host, port))
            raise WiringError(f"drivers {names} have one address, {host}:{port}; a box serves one driver")
    for each in maps:
        for point in each.points:
            if point.table == "holding" and each.watchdog_register in range(point.address, point.address + point.cells):
                what = f"holding register {each.watchdog_register} of {each.name}"
                raise WiringError(f"{what} is used twice: for the watchdog and for {point.path}")
