"""The belt of the conveyor, and its light barriers."""

from __future__ import annotations

from typing import Annotated

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Number, Range, action
from umo.control import state_of, until, value_of
from umo.states import OnOff, TwoState

from .errors import DriveError


class Beam(TwoState):
    CLEAR = "clear"
    COVERED = "covered"


def covered(barrier: BinarySensor[Beam]) -> bool:
    return state_of(barrier) is Beam.COVERED


class Belt(Compound):
    """A belt on a frequency drive. `speed` is the reading of the drive, which does not show that the belt slips."""

    run: BinaryActuator[OnOff]
    setpoint: DigitalActuator
    speed: DigitalSensor
    deviation: Annotated[float, Number("m/s", 0.001, 0.2, tunable=True)] = 0.005
    """Largest difference between a steady setpoint and the speed, m/s; while the setpoint is not 0, at most half of the
    setpoint. The deviation causes an error of each length: 0.005 of 0.3 m/s is 1.7 %."""
    settling_time: Annotated[float, Number("s", 0.1, 5.0, tunable=True)] = 0.5
    """Time for which the deviation may be larger while the setpoint is steady, s."""

    def setup(self) -> None:
        self.position = 0.0  # what the belt has travelled, mm
        self._speed = 0.0
        self._commanded = 0.0
        self._deviating = 0.0

    def control(self) -> None:
        before, self._speed = self._speed, value_of(self.speed)
        self.position += 1000.0 * (before + self._speed) / 2 * self.dt
        commanded = self.setpoint.read() if self.run.read() is OnOff.ON else 0.0
        largest = min(self.deviation, commanded / 2) if commanded else self.deviation
        deviates = abs(self._speed - commanded) > largest and commanded == self._commanded
        self._deviating, self._commanded = (self._deviating + self.dt if deviates else 0.0), commanded
        if self._deviating > self.settling_time:
            raise DriveError(f"the drive runs at {self._speed:.3f} m/s, {commanded:.3f} m/s were commanded")

    @action(speed=lambda belt: Range.of(belt.setpoint), release="brake")
    def run_at(self, speed: float) -> None:
        """Accelerate or brake to `speed` m/s, as fast as the slew rate of the setpoint allows."""
        self.setpoint.write(speed)
        self.run.write(OnOff.ON)

    def brake(self) -> None:
        """Brake to standstill. A drive that is switched on stays switched on."""
        self.setpoint.write(0.0)

    @action
    async def halt(self) -> None:
        """Brake to standstill, then switch the drive off."""
        self.setpoint.write(0.0)
        await until(lambda: value_of(self.speed) < 0.01, timeout="10 s")
        self.run.write(OnOff.OFF)
