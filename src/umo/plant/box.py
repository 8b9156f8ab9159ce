"""A controller box in front of a plant, with its registers and its watchdog. This module does not use the network."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import or_

from .modbus_server import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionAnswer, answer
from .register_map import Point, RegisterMap
from .simulation import Simulation

WRITE_FUNCTIONS = frozenset((5, 6, 15, 16, 22, 23))


class Watchdog:
    """A watchdog that a write arms and every request restarts. It expires once after `seconds` without a request (0
    means never)."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.drops = 0
        self._armed = False
        self._fed = 0.0

    @property
    def milliseconds(self) -> int:
        """The time in ms, as its register contains it. A time above 0 is never rounded to 0, because 0 means off."""
        return min(max(round(self.seconds * 1000), 1 if self.seconds else 0), 0xFFFF)

    def feed(self, now: float, *, write: bool) -> None:
        self._fed = now
        self._armed = self._armed or write

    def expired(self, now: float) -> bool:
        """Return True once, when the outputs must be dropped."""
        if not self._armed or self.seconds == 0 or now - self._fed < self.seconds:
            return False
        self._armed = False
        self.drops += 1
        return True


class Box:
    """A box with one register map of a plant.

    The plant is advanced to the time of each request, so that the answer is the present state, even if the timer of the
    event loop is coarse. Reads of outputs return the written values; bits of a register that belong to no object are
    0. Exceptions: 2 for an address that is not mapped, for a write to a register without an output, and for a write to
    a part of a value with several registers; 3 for a written value that does not fit the plant's channel; 4 if the
    plant fails, or if the reading of a sensor does not fit its register.
    """

    def __init__(self, simulation: Simulation, registers: RegisterMap) -> None:
        self.registers = registers
        self.watchdog = Watchdog(registers.watchdog)
        self.requests = 0
        self._simulation = simulation
        self._levels = {point: point.default for point in registers.points if point.output}
        self._cells: dict[tuple[str, int], list[Point]] = {}
        """The objects at each address: several if they are fields of a register, none for the register of the
        watchdog's time."""
        for point in registers.points:
            for offset in range(point.cells):
                self._cells.setdefault((point.table, point.address + offset), []).append(point)
        if registers.watchdog_register is not None:
            self._cells["holding", registers.watchdog_register] = []

    def request(self, request: bytes) -> bytes:
        """Return the answer to one request; both start with their function code."""
        simulation = self._simulation
        self.requests += 1
        try:
            simulation.catch_up()
            self.watchdog.feed(simulation.clock(), write=request[0] in WRITE_FUNCTIONS)
            return answer(request, self)
        except OSError:  # the plant's own: a DriverError
            return bytes([request[0] | 0x80, DEVICE_FAILURE])
        except Exception as error:  # a mistake in the plant's code
            simulation.failure = error
            return bytes([request[0] | 0x80, DEVICE_FAILURE])

    def watch(self) -> None:
        """Drop the outputs if the watchdog has expired. Called when all waiting requests have been read, so that a slow
        plant does not make the watchdog expire."""
        if self.watchdog.expired(self._simulation.clock()):
            for point in self._levels:
                self._simulation.write(point.slot, point.plant_default)
                self._levels[point] = point.default

    # The four tables ------------------------------------------------------------------------------

    def read(self, table: str, address: int, count: int) -> list[int]:
        """Return the cells. Every object is read once, even if it has two registers."""
        places = [self._place(table, address + i) for i in range(count)]
        words = {point: self._words(point) for point in dict.fromkeys(point for each in places for point in each)}
        found = []
        for at, points in enumerate(places, address):
            cells = [words[point][at - point.address] for point in points]
            found.append(reduce(or_, cells) if points else self.watchdog.milliseconds)
        return found

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """Write all values or none: every address and value is checked before the first value is set. Fields of inputs
        are not changed."""
        places = [self._place(table, address + i) for i in range(len(values))]
        for points in places:
            if points and not any(point.output for point in points):
                raise ExceptionAnswer(ILLEGAL_ADDRESS)
        written = [
            (point, *_raw_and_level(point, self._cells_after(point, address, values)))
            for point in dict.fromkeys(point for each in places for point in each if point.output)
        ]
        for value, points in zip(values, places, strict=True):
            if not points:
                self.watchdog.seconds = value / 1000
        for point, raw, level in written:
            self._simulation.write(point.slot, level)
            self._levels[point] = raw

    def _cells_after(self, point: Point, address: int, values: Sequence[int]) -> Sequence[int]:
        """Return the cells of an output after these values are written from the address on. A field keeps its bits in
        cells that are not written. Raises ExceptionAnswer if only some cells of a whole value would be written."""
        at = point.address - address
        if at >= 0 and at + point.cells <= len(values):
            return values[at : at + point.cells]
        if not point.is_field:
            raise ExceptionAnswer(ILLEGAL_ADDRESS)
        present = enumerate(point.words(self._levels[point]), at)
        return [values[i] if 0 <= i < len(values) else word for i, word in present]

    def _words(self, point: Point) -> list[int]:
        if point.output:
            return point.words(self._levels[point])
        level = self._simulation.read(point.slot)
        try:
            return point.words(point.to_bus(level))
        except OverflowError:
            raise ExceptionAnswer(DEVICE_FAILURE) from None

    def _place(self, table: str, address: int) -> list[Point]:
        try:
            return self._cells[table, address]
        except KeyError:
            raise ExceptionAnswer(ILLEGAL_ADDRESS) from None


def _raw_and_level(point: Point, cells: Sequence[int]) -> tuple[int, int]:
    """Return the raw integer that these cells hold for the box, and the one for the plant."""
    try:
        raw = point.raw(cells)
        return raw, point.to_plant(raw)
    except OverflowError:
        raise ExceptionAnswer(ILLEGAL_VALUE) from None
