"""A controller box in front of a plant: its registers and its watchdog. No network in here."""

from __future__ import annotations

from collections.abc import Sequence

from .modbus_server import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionAnswer, answer
from .register_map import Point, RegisterMap
from .simulation import Simulation

WRITE_FUNCTIONS = frozenset((5, 6, 15, 16, 23))


class Watchdog:
    """Armed by a write, fed by every request; expires once after `seconds` without one (0: never)."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.drops = 0
        self._armed = False
        self._fed = 0.0

    @property
    def milliseconds(self) -> int:
        """The time as its register holds it; a time above 0 is never 0, which is off."""
        return min(max(round(self.seconds * 1000), 1 if self.seconds else 0), 0xFFFF)

    def feed(self, now: float, *, write: bool) -> None:
        self._fed = now
        self._armed = self._armed or write

    def expired(self, now: float) -> bool:
        """True once: the outputs are to be dropped now."""
        if not self._armed or self.seconds == 0 or now - self._fed < self.seconds:
            return False
        self._armed = False
        self.drops += 1
        return True


class Box:
    """One register map of a plant.

    The plant is brought up to the moment of each request, so that the answer is the present state, however coarse the
    timer of the event loop. Reads of outputs give what was written. Exceptions: 2 for an address that is not mapped,
    an input that is written, half of a 32-bit value that is written; 3 for a written value that does not fit the
    plant's channel; 4 if the plant fails, or what a sensor reads does not fit its register.
    """

    def __init__(self, simulation: Simulation, registers: RegisterMap) -> None:
        self.registers = registers
        self.watchdog = Watchdog(registers.watchdog)
        self.requests = 0
        self._simulation = simulation
        self._levels = {point: point.default for point in registers.points if point.output}
        self._cells: dict[tuple[str, int], tuple[Point | None, int]] = {
            (point.table, point.address + offset): (point, offset)
            for point in registers.points
            for offset in range(point.cells)
        }
        """Object at each address, and which of its cells; None: the watchdog's time."""
        if registers.watchdog_register is not None:
            self._cells["holding", registers.watchdog_register] = (None, 0)

    def request(self, request: bytes) -> bytes:
        """The answer to one request, both from their function code on."""
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
        """Drop the outputs if the watchdog has expired. Called when all waiting requests have been read, so a slow
        plant does not make the watchdog expire."""
        if self.watchdog.expired(self._simulation.clock()):
            for point in self._levels:
                self._simulation.write(point.slot, point.plant_default)
                self._levels[point] = point.default

    # The four tables ------------------------------------------------------------------------------

    def read(self, table: str, address: int, count: int) -> list[int]:
        """Every object is read once, also if it takes two registers."""
        places = [self._place(table, address + i) for i in range(count)]
        words = {point: self._words(point) for point in dict.fromkeys(point for point, _ in places)}
        return [words[point][offset] for point, offset in places]

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """All or nothing: every address and value is looked at before the first is set."""
        written: list[tuple[Point | None, int, int]] = []
        at = 0
        while at < len(values):
            point, offset = self._place(table, address + at)
            size = 1 if point is None else point.cells
            cells = values[at : at + size]
            if offset or len(cells) < size or not (point is None or point.output):
                raise ExceptionAnswer(ILLEGAL_ADDRESS)
            written.append((point, *_raw_and_level(point, cells)))
            at += size
        for point, raw, level in written:
            if point is None:
                self.watchdog.seconds = raw / 1000
            else:
                self._simulation.write(point.slot, level)
                self._levels[point] = raw

    def _words(self, point: Point | None) -> list[int]:
        if point is None:
            return [self.watchdog.milliseconds]
        if point.output:
            return point.words(self._levels[point])
        level = self._simulation.read(point.slot)
        try:
            return point.words(point.to_bus(level))
        except OverflowError:
            raise ExceptionAnswer(DEVICE_FAILURE) from None

    def _place(self, table: str, address: int) -> tuple[Point | None, int]:
        try:
            return self._cells[table, address]
        except KeyError:
            raise ExceptionAnswer(ILLEGAL_ADDRESS) from None


def _raw_and_level(point: Point | None, cells: Sequence[int]) -> tuple[int, int]:
    """Raw integers that these cells hold for the box, and for the plant."""
    if point is None:
        return cells[0], 0
    try:
        raw = point.raw(cells)
        return raw, point.to_plant(raw)
    except OverflowError:
        raise ExceptionAnswer(ILLEGAL_VALUE) from None
