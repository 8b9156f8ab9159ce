"""The compound objects of the z-theta manipulator and their control (the paper's Listing 6 and section 5.4).

Each control function is a member of the object to which it belongs; the axes are in `axes.py`.
"""

from __future__ import annotations

from typing import Annotated

from umo import BinaryActuator, BinarySensor, Compound, DigitalSensor, Number, Range, action
from umo.control import Hysteresis, state_of, together, until, value_of, wait
from umo.errors import TimeExpired
from umo.states import OnOff, PassFail

from .axes import StepOutput, ThetaAxis, ZAxis
from .errors import CounterweightError, GripError

__all__ = ["Counterweight", "Gripper", "Manipulator", "StepOutput", "ThetaAxis", "ZAxis"]


class Counterweight(Compound):
    """A pneumatic cylinder carries the arm: its pressure is kept within a band."""

    vacuum: BinaryActuator[OnOff]
    pressure: DigitalSensor

    def setup(self) -> None:
        self.regulator = Hysteresis(self.pressure, self.vacuum, OnOff.ON, low=742.0, high=762.0)

    def control(self) -> None:
        self.regulator.control()

    async def carry(self) -> None:
        """Wait until the pressure carries the arm."""
        try:
            await until(lambda: value_of(self.pressure) >= self.regulator.low, timeout=5.0)
        except TimeExpired:
            raise CounterweightError(f"the counterweight stays at {self.pressure.read():.0f} counts") from None


class Gripper(Compound, when_suspended="hold"):
    """A suction cup: PASS of the pressure switch proves that it holds a part. The cup also holds the part in manual
    mode."""

    vacuum: BinaryActuator[OnOff]
    pressure: BinarySensor[PassFail]
    seal_time: Annotated[float, Number("s", 0.05, 2.0, tunable=True)] = 0.3
    """Time that the vacuum may take to build, s."""
    loss_time: Annotated[float, Number("s", 0.0, 0.5, tunable=True)] = 0.02
    """Time for which the switch may fail before a held part counts as lost, s."""

    def setup(self) -> None:
        self.holding = False
        self._failing = 0.0

    def control(self) -> None:
        if not self.holding:
            return
        if self.sealed:
            self._failing = 0.0
            return
        self._failing += self.dt
        if self._failing > self.loss_time:
            self.holding = False
            raise GripError("the part was lost: the vacuum failed while it was held")

    @property
    def sealed(self) -> bool:
        """True if there is vacuum in the cup."""
        return state_of(self.pressure) is PassFail.PASS

    @action
    async def grip(self) -> bool:
        """Switch the vacuum on. Return True if the switch closed within `seal_time`; otherwise the vacuum is off
        again."""
        self.vacuum.write(OnOff.ON)
        try:
            await until(lambda: self.sealed, timeout=self.seal_time)
        except TimeExpired:
            self.vacuum.write(OnOff.OFF)
            return False
        self.holding, self._failing = True, 0.0
        return True

    @action
    def release(self) -> None:
        """Switch the vacuum off."""
        self.holding = False
        self.vacuum.write(OnOff.OFF)


class Manipulator(
    Compound,
    stop_order=("z.motor", "theta", "counterweight", "pressure_solenoid", "z", "gripper"),
    max_period="10 ms",
):
    """The overhead manipulator. Heights are readings of the z encoder, um."""

    z: ZAxis
    theta: ThetaAxis
    counterweight: Counterweight
    gripper: Gripper
    pressure_solenoid: BinaryActuator[OnOff]
    timer: DigitalSensor
    pick_height: Annotated[float, Number("um", 55_000.0, 65_000.0, tunable=True)] = 59_800.0
    """Height at which the cup presses a part that lies on the courier."""
    clearance: Annotated[float, Number("um", 1_000.0, 10_000.0, tunable=True)] = 4_000.0
    """Distance above `pick_height` in which the arm moves slowly."""
    touch_speed: Annotated[float, Number("um/s", 1_000.0, 20_000.0, tunable=True)] = 10_000.0
    """Speed near a part, um per s."""
    turn_height: Annotated[float, Number("um", 70_000.0, 120_000.0, tunable=True)] = 80_000.0
    """Height at which a part hangs free."""
    transit_height: Annotated[float, Number("um", 100_000.0, 120_000.0, tunable=True)] = 112_000.0
    """Height from which on the courier may move."""
    courier_time: Annotated[float, Number("s", 0.0, 10.0, tunable=True)] = 1.0
    """Time that the courier takes to bring the next part, s."""
    puff_time: Annotated[float, Number("s", 0.01, 0.5, tunable=True)] = 0.05
    """Time for which the pressure blows a part off the cup, s."""
    bleed_time: Annotated[float, Number("s", 0.1, 5.0, tunable=True)] = 1.0
    """Time that the cup takes to lose its vacuum without being blown, s."""

    def setup(self) -> None:
        self.unblown = 0  # parts that were put down without the puff

    @action
    async def home(self) -> None:
        """Fill the counterbalance so that it carries the arm, then find the references of both axes."""
        await self.counterweight.carry()
        await together(self.z.home(), self.theta.home())

    @action(angle=lambda m: Range.of(m.theta.encoder))
    async def ready(self, angle: float) -> None:
        """Raise the arm out of the courier's way, and turn it to the angle at which parts are picked."""
        self.theta.check_target(angle)
        await self.z.move_to(self.transit_height)
        await together(self.theta.move_to(angle), wait(self.courier_time))

    @action
    async def pick(self) -> None:
        """Grip the part under the cup and lift it; after one retry, raise GripError."""
        if not (await self._try_grip() or await self._try_grip()):
            raise GripError("no part was gripped in 2 tries: none is under the cup, or the cup leaks")
        await self.z.move_to(self.turn_height)

    @action
    async def place(self) -> None:
        """Put the part down and blow it off the cup."""
        await self.z.move_to(self.pick_height + self.clearance)
        await self.z.move_to(self.pick_height, speed=self.touch_speed)
        await self._release()
        await self.z.move_to(self.pick_height + self.clearance, speed=self.touch_speed)
        if self.gripper.sealed:
            raise GripError("the part came up with the cup: the vacuum does not switch off")

    async def _release(self) -> None:
        """Switch the vacuum off, and puff. If the puff does not reach the cup, wait until its vacuum is gone."""
        self.gripper.release()
        self.pressure_solenoid.write(OnOff.ON)
        await wait(self.puff_time)
        blown = not self.gripper.sealed
        self.pressure_solenoid.write(OnOff.OFF)
        if not blown:
            self.unblown += 1
            self.cycle.progress("the puff does not reach the cup: waiting until its vacuum is gone")
            await wait(self.bleed_time)
        if self.gripper.sealed:
            raise GripError("the cup keeps its vacuum: the part cannot be put down")

    async def _try_grip(self) -> bool:
        """Lower the arm and grip the part. If no part is held, raise the arm, and give the courier time."""
        await self.z.move_to(self.pick_height + self.clearance)
        await self.z.move_to(self.pick_height, speed=self.touch_speed)
        if await self.gripper.grip():
            return True
        await self.z.move_to(self.transit_height)
        await wait(self.courier_time)
        return False
