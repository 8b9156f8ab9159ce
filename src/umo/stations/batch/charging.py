"""The charging line, which weighs the raw materials for the reactors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Annotated

from umo import BinaryActuator, Compound, DigitalSensor, Interlock, Number
from umo.control import Lock, first, next_period, until, value_of, wait
from umo.states import OpenClosed

from .errors import ChargingError

OPEN, CLOSED = OpenClosed.OPEN, OpenClosed.CLOSED
Valve = BinaryActuator[OpenClosed]
MATERIALS = "AB"


class ChargingLine(Compound, equipment=True, max_period="200 ms"):
    """A hopper on a scale. It has an inlet for each raw material, an outlet to each reactor, and one to the waste. One
    reactor at a time uses the line, and holds `lock` meanwhile.
    """

    inlets: Sequence[Valve]
    outlets: Sequence[Valve]
    waste: Valve
    scale: DigitalSensor
    tolerance: Annotated[float, Number("kg", 0.05, 5.0, tunable=True)] = 0.4
    """Largest deviation of a weighed amount, kg."""
    overrun: Annotated[float, Number("kg", 0.0, 5.0)] = 0.7
    """Initial amount in kg that still flows after an inlet is closed; the line learns the actual amount."""
    capacity: float = 100.0
    """Load from which on the inlets are inhibited, kg."""
    empty: float = 0.3
    """Load below which the hopper is empty, kg."""
    settling_time: float = 2.0
    """Time that the scale takes to come to rest, s."""
    least_flow: float = 0.2
    """Flow below which a material counts as not flowing, kg/s."""

    def setup(self) -> None:
        self.lock = Lock()
        self.overruns = [self.overrun for _ in self.inlets]

    def interlocks(self) -> Iterator[Interlock]:
        exits = (*self.outlets, self.waste)
        yield Interlock(lambda: value_of(self.scale) > self.capacity, self.inlets, "the hopper is full")
        yield Interlock(lambda: any_open(exits), self.inlets, "the hopper is being emptied")

    async def weigh(self, amounts: Sequence[float]) -> list[float]:
        """Weigh the amounts of the raw materials into the hopper, kg. Returns the amounts that the scale shows. The
        remains of an interrupted charge go to the waste first."""
        if value_of(self.scale) > self.empty:
            await self._let_out(self.waste)
        return [await self._let_in(number, amount) for number, amount in enumerate(amounts)]

    async def discharge(self, reactor: int) -> None:
        """Empty the hopper into a reactor whose feed valve is open."""
        await self._let_out(self.outlets[reactor])

    async def _let_in(self, number: int, amount: float) -> float:
        start = value_of(self.scale)
        enough = start + amount - self.overruns[number]
        material = f"raw material {MATERIALS[number]}"
        await self._flow(self.inlets[number], lambda: value_of(self.scale) >= enough, material)
        await wait(self.settling_time)
        weighed = value_of(self.scale) - start
        error = weighed - amount
        if abs(error) > self.tolerance:
            raise ChargingError(f"{weighed:.2f} kg of {material} instead of {amount:g} kg")
        self.overruns[number] += error / 2  # half of it may be noise
        return weighed

    async def _let_out(self, valve: Valve) -> None:
        await self._flow(valve, lambda: value_of(self.scale) < self.empty, "the hopper's load")
        await wait(self.settling_time)

    async def _flow(self, valve: Valve, done: Callable[[], bool], what: str) -> None:
        """Open a valve until the condition is true. Raises ChargingError if the load stands still before."""
        number, _ = await first(until(done), self._standstill(), held_open(valve))
        if number == 1:
            load = value_of(self.scale)
            raise ChargingError(f"{what} does not flow through {valve.path}: {load:.1f} kg on the scale")

    async def _standstill(self) -> None:
        """End when the load no longer changes."""
        change, time = self.least_flow * self.settling_time, self.settling_time
        before = value_of(self.scale)
        await wait(time)
        while abs(value_of(self.scale) - before) > change:
            before = value_of(self.scale)
            await wait(time)


async def held_open(valve: Valve) -> None:
    """Keep a valve open until this sequence is cancelled."""
    try:
        while True:
            valve.write(OPEN)
            await next_period()
    finally:
        valve.write(CLOSED)


def any_open(valves: Sequence[Valve]) -> bool:
    return any(valve.read() is OPEN for valve in valves)
