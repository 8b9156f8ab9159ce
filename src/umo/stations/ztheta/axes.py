"""The two axes: a servo motor that lifts, a stepper motor that turns. Homing and motion are those of `umo.control`."""

from __future__ import annotations

from umo import BinaryActuator
from umo.control import IndexPulse, ServoAxis, StepperAxis, until
from umo.states import EnableDisable, UpDown


class ZAxis(ServoAxis):
    """The lifting axis, in um; positive is up. The preset of the wired counter corresponds to `index`. The gains fit
    the 12-bit DAC and its amplifier, and were measured on the plant (docs/ztheta.md)."""

    encoder_zero: BinaryActuator[EnableDisable]
    index: float = 121_999.4
    """Position of the encoder's index pulse, um."""
    stop: float = 129_500.0
    """Position of the upper end stop, um."""
    gain: float = 4.3e-3
    integral_time: float = 0.1
    derivative_time: float = 1e-3
    filter_time: float = 1e-3
    feed_forward: float = 3.1416e-5
    inertia: float = 2.25e-7
    friction: float = 0.0955
    velocity: float = 100_000.0
    acceleration: float = 1.0e6
    jerk: float = 2.0e7
    window: float = 30.0
    following_error: float = 500.0
    search_speed: float = 20_000.0
    search_output: float = 2.0
    stall: float = 2_000.0

    def setup(self) -> None:
        super().setup()
        self.homing = IndexPulse(
            enable=self.encoder_zero,
            index=self.index,
            stop=self.stop,
            jump=5_000.0,
            tolerance=500.0,
            clearance=5_000.0,
        )


class StepOutput(BinaryActuator[UpDown]):
    """The step signal: `step` sends one step (the paper's section 5.4: one step is a member of T_Motor_Step_Output)."""

    __slots__ = ()

    async def step(self) -> None:
        """Make one step in the present direction: UP for a period, DOWN for a period."""
        for level in (UpDown.UP, UpDown.DOWN):
            self.write(level)
            await until(lambda level=level: self.read() is level)  # type: ignore[misc]


class ThetaAxis(StepperAxis):
    """The turning axis, in deg; clockwise is positive. The index pulse sets the counter to 0, at which the encoder
    reads 227.4438."""

    step: StepOutput
    encoder_zero: BinaryActuator[EnableDisable]
    index: float = 227.4438
    """Position of the index pulse, deg."""
    stop: float = 271.0
    """Position of the clockwise end stop, deg."""
    step_size: float = 0.225
    velocity: float = 80.0
    acceleration: float = 300.0
    jerk: float = 3_000.0
    window: float = 0.135
    following_error: float = 3.0
    settling_time: float = 0.5
    search_speed: float = 60.0
    stall: float = 20.0

    def setup(self) -> None:
        super().setup()
        self.homing = IndexPulse(
            enable=self.encoder_zero,
            index=self.index,
            stop=self.stop,
            jump=5.0,
            tolerance=1.0,
            clearance=15.0,
        )
