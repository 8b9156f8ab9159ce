"""Stepper axes: a stepper motor behind a step and a direction output, with a position sensor."""

from __future__ import annotations

from umo.control.axis import Axis, Interruption
from umo.control.axis_state import AxisState
from umo.control.checks import check_numbers
from umo.control.inputs import value_of
from umo.control.stepping import STEPS_PER_PERIOD, Stepping
from umo.cycle.sequences import wait
from umo.digits import number_text
from umo.errors import AxisError
from umo.objects import Actuator, BinaryActuator
from umo.objects.presentation.value_text import measure
from umo.states import Rotation, UpDown

_DISABLED, _HOMING, _FREE = AxisState.DISABLED, AxisState.HOMING, Interruption.NONE  # an attribute of an Enum is a call

MAX_CORRECTIONS = 3
"""The largest number of times that a motion compensates for lost steps."""


class StepperAxis(Axis):
    """An axis that is driven by a stepper motor. Lost steps are detected by the encoder.

        theta = StepperAxis(
            step=BinaryActuator(UpDown, ...), direction=BinaryActuator(Rotation, ...), step_size=0.225,
            encoder=DigitalSensor("deg", ...), velocity=80.0, acceleration=300.0, jerk=3e3,
            window=0.1, following_error=3.0, homing=..., search_speed=60.0, stall=20.0,
        )

    CW increases the position. `window` is at least half a step. If the encoder shows lost steps at the end of a motion,
    they are compensated. At most 0.4 steps are made in a period (`STEPS_PER_PERIOD`), which limits the speed. Missed
    periods delay the motion, because a stepper cannot catch up. If more than one step was due in the missed periods,
    the motor has stopped and starts again with a ramp.
    """

    step: BinaryActuator[UpDown]
    direction: BinaryActuator[Rotation]
    step_size: float
    """Size of one step, in units of the encoder."""
    rest_time: float = 0.3
    """Time in s in which the rotor comes to rest."""

    def setup(self) -> None:
        super().setup()
        check_numbers(self, above_0=("step_size",), not_negative=("rest_time",))
        self.stepping = Stepping(self.step, self.direction)
        self._offset = 0.0  # the position at which the step count is 0
        self._ramp = 0.0  # s until a motor that has started with a ramp has its speed again

    @property
    def commanded(self) -> float:
        """The position that corresponds to the steps sent so far."""
        return self._offset + self.stepping.count * self.step_size

    def control(self) -> None:
        if self._state is _DISABLED:
            self.step.write(self.step.default)
            self.direction.write(self.direction.default)
            return
        if self._interrupted is not _FREE and not self._inhibited:
            self._go_on()
        reading = value_of(self.encoder, self._accept)
        clock = self._machine.clock
        if clock.ticks > 1:
            self._resume((clock.ticks - 1) * clock.period)
        if self._ramp > 0.0:
            self._ramp -= clock.period
        position = self.profile.step(clock.period).position
        self.stepping.control((position - self._offset) / self.step_size)
        near = abs(self.commanded - reading) <= self.following_error  # NaN is not
        beyond = not near and self._state is not _HOMING
        if (beyond or self.stepping.refused) and self._inhibited:
            self._interrupt()
        elif beyond:
            raise AxisError(
                f"{self._path} lost steps: the encoder reads {measure(reading, self.encoder.units)}, "
                f"{number_text(self.commanded)} were commanded"
            )

    def _resume(self, missed: float) -> None:
        """Continue after missed periods, in which no step was made. `missed`: their time in s. A motor that would have
        made more than one step stands still, and starts again with a ramp. While the ramp lasts, it does not start
        again, so that even an axis that is always late arrives."""
        position, velocity, _ = self.profile.setpoint
        if self._ramp <= 0.0 and missed * abs(velocity) > self.step_size:
            self._ramp = abs(velocity) / self.profile.acceleration + self.profile.acceleration / self.profile.jerk
            self.profile.hold(position)
            self._plan_anew()

    @property
    def _outputs(self) -> tuple[Actuator, ...]:
        return self.step, self.direction

    @property
    def _inhibited(self) -> bool:
        return self.step.inhibited is not None or self.direction.inhibited is not None

    @property
    def error(self) -> float:
        """The commanded position minus the last reading."""
        return self.commanded - self.encoder.read()

    async def _settle(self) -> None:
        await wait(self.rest_time)
        self._stand()

    def _stand(self) -> None:
        self._offset = value_of(self.encoder, self._accept) - self.stepping.count * self.step_size
        self.profile.hold(self.commanded)

    def _shift(self, distance: float) -> None:
        super()._shift(distance)
        self._offset += distance

    def _speed(self, wanted: float) -> float:
        return min(wanted, self.profile.velocity, STEPS_PER_PERIOD * self.step_size / self.cycle.period)

    def _arrived(self, position: float) -> bool:
        return super()._arrived(position) and abs(self.commanded - position) <= self.step_size

    def _correct(self, position: float, corrections: int) -> None:
        lost = round(self.error / self.step_size)
        if not lost or corrections > MAX_CORRECTIONS:
            super()._correct(position, corrections)
        self._offset -= lost * self.step_size
        self.profile.hold(self.commanded)
        self._replan()
