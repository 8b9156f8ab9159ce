"""The control code, which runs once per period (the controls developer's file). It does not depend on the circuits."""

from typing import Annotated

from umo import BinaryActuator, BinarySensor, Compound, DigitalSensor, Number, Range, TaskFailed, action
from umo.control import Hysteresis, state_of, until, value_of
from umo.states import OpenClosed, PassFail


class Tank(Compound, stop_order=("inlet", "drain"), max_period="200 ms"):
    inlet: BinaryActuator[OpenClosed]
    drain: BinaryActuator[OpenClosed]
    level: DigitalSensor
    overflow: BinarySensor[PassFail]
    timer: DigitalSensor
    band: Annotated[float, Number("mm", 1.0, 50.0, tunable=True)] = 10.0
    """Largest distance of the level from its target, mm. The table `[parameters]` of a wiring and `umo tune number` can
    set it."""

    def setup(self) -> None:
        self.target = 0.0
        self.regulator = Hysteresis(self.level, self.inlet, OpenClosed.OPEN, low=0.0, high=0.0)

    def control(self) -> None:
        if state_of(self.overflow) is PassFail.FAIL:
            raise TaskFailed("the tank overflows")
        self.regulator.low, self.regulator.high = self.target - self.band, self.target + self.band
        self.regulator.control()

    def aim(self, target: float) -> None:
        """Keep the level at `target` mm from now on."""
        self.target = target

    @action(target=Range("mm", 0.0, 450.0))
    async def fill(self, target: float) -> None:
        """Fill up to a level within 60 s, and keep that level."""
        self.aim(target)
        await until(lambda: value_of(self.level) >= target, timeout="60 s")

    @action(target=Range("mm", 10.0, 450.0))
    async def empty(self, target: float) -> None:
        """Drain down to a level within 60 s."""
        self.aim(target - 2 * self.band)
        self.drain.write(OpenClosed.OPEN)
        try:
            await until(lambda: value_of(self.level) <= target, timeout="60 s")
        finally:
            self.drain.write(OpenClosed.CLOSED)
