"""A machine of 12 outputs and 12 inputs; every period it writes all outputs and looks at all inputs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import KW_ONLY
from time import monotonic_ns
from typing import Annotated, Any

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Number, Quality
from umo.states import OnOff, ZeroOne

from . import disk
from .cells import CLOCK, KEPT, MAX_AGE, OPERATED, PERIODS, WRONG


class Machine(Compound):
    timer: DigitalSensor
    motors: Sequence[DigitalActuator]
    valves: Sequence[BinaryActuator[OnOff]]
    switches: Sequence[BinarySensor[ZeroOne]]
    counts: Sequence[DigitalSensor]
    clock: DigitalSensor

    cells: Any = None

    def begin(self) -> None:
        """The application has begun."""

    def control(self) -> None:
        if self.cells is None:  # the application has not begun
            return
        self._look()
        self.cells[PERIODS] += 1
        for i, motor in enumerate(self.motors):
            motor.write(5.0 + i + self.cells[PERIODS] % 10 / 10)
        for valve in self.valves:
            valve.write(OnOff.ON)

    def _look(self) -> None:
        """A reading that is good is what the box has: no input changes but its clock, which tells the age. A process
        that stands still within a period goes on with what it has read in it."""
        for i, switch in enumerate(self.switches):
            wrong = switch.read() is not (ZeroOne.ONE if i % 3 == 0 else ZeroOne.ZERO)
            self.cells[WRONG] += wrong and switch.quality is Quality.GOOD
        for i, count in enumerate(self.counts):
            self.cells[WRONG] += count.read() != 1000 + 111 * i and count.quality is Quality.GOOD
        now = monotonic_ns()
        age = (now // CLOCK - int(self.clock.read())) % 65_536 * CLOCK * 1e-9
        period = (now - self._machine.whole.phases.began) * 1e-9
        self.cells[WRONG] += self.cells[MAX_AGE] * 1e-3 + period < age and self.clock.quality is Quality.GOOD


class Keeping(Machine):
    """All its kept numbers are those of one period."""

    _: KW_ONLY
    count: Annotated[int, Number(kept=True)] = 0
    double: Annotated[float, Number("mm", kept=True)] = 0.0
    odd: Annotated[bool, Number(kept=True)] = False
    state: Annotated[OnOff, Number(kept=True)] = OnOff.OFF

    def control(self) -> None:
        super().control()
        if self.cells is not None:
            self.count = self.cells[PERIODS]
            self.double, self.odd = 2.0 * self.count, self.count % 2 == 1
            self.state = OnOff.ON if self.odd else OnOff.OFF


def machine() -> Machine:
    disk.replace_it()  # a keeper is forked from the process that declares the machine
    if os.environ.get(KEPT) == OPERATED:
        from .operated import operated  # the others have no alarms and units

        return operated(parts())
    return (Keeping if os.environ.get(KEPT) else Machine)(**parts())


def parts() -> dict[str, Any]:
    """The objects of a machine, by name."""
    return {
        "timer": DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        "motors": [
            DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01, limits="clamp")
            for _ in range(2)
        ],
        "valves": [BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for _ in range(10)],
        "switches": [BinarySensor(ZeroOne, one=ZeroOne.ONE) for _ in range(8)],
        "clock": DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0),
        "counts": [DigitalSensor("count", minimum=0.0, maximum=65_535.0, resolution=1.0) for _ in range(4)],
    }
