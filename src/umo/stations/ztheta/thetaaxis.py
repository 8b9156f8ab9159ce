"""The theta axis: a stepper behind a step and a direction output, and an encoder that finds lost steps."""

from __future__ import annotations

import math

from umo import BinaryActuator, Compound, DigitalSensor, EnableDisable, Rotation, UpDown
from umo.control import HOMING, STEPS_PER_PERIOD, Claim, Profile, Stepping, next_period, until, value_of, wait

from .errors import AxisError, HomingError


class StepOutput(BinaryActuator[UpDown]):
    """The step signal: `step` sends one (the paper's section 5.4: one step is a member of T_Motor_Step_Output)."""

    __slots__ = ()

    async def step(self) -> None:
        """One step, in the direction that stands: UP for a period, DOWN for a period."""
        for level in (UpDown.UP, UpDown.DOWN):
            self.write(level)
            await until(lambda level=level: self.read() is level)  # type: ignore[misc]


class ThetaAxis(Compound):
    """Turns in deg; clockwise is positive. The index pulse zeroes the counter, where the encoder reads 227.4438."""

    step: StepOutput
    direction: BinaryActuator[Rotation]
    encoder: DigitalSensor
    encoder_zero: BinaryActuator[EnableDisable]
    step_angle: float = 0.225
    """One step, deg: 1,600 a revolution."""
    index: float = 227.4438
    """Where the index pulse stands, deg."""
    stop: float = 271.0
    """Where the clockwise end stop stands, deg."""
    search_speed: float = 60.0
    """Speed of homing, deg per s."""
    following_error: float = 3.0
    """Largest distance between command and encoder, deg; one lost electrical cycle is more than that."""

    def setup(self) -> None:
        self.profile = Profile(velocity=80.0, acceleration=300.0, jerk=3_000.0)
        self.stepping = Stepping(self.step, self.direction)
        self.claim = Claim(self)
        self._offset = 0.0  # the angle at which the step count is 0
        self._watched = False

    @property
    def commanded(self) -> float:
        """The angle that the steps sent so far stand for, deg."""
        return self._offset + self.stepping.count * self.step_angle

    def control(self) -> None:
        # by one period, also after missed ones: a step takes two periods, so the motor could only catch up too fast
        position = self.profile.step(self.period).position
        self.stepping.control((position - self._offset) / self.step_angle)
        if self._watched and abs((angle := value_of(self.encoder)) - self.commanded) > self.following_error:
            raise AxisError(
                f"theta lost steps: the encoder reads {angle:.2f} deg, {self.commanded:.2f} deg were commanded"
            )

    async def move_to(self, angle: float, *, speed: float | None = None) -> None:
        """To an angle in deg, at most `speed` deg per s, jerk-limited; ends when the encoder has arrived."""
        with self.claim.of("move_to"):
            await self._travel(angle, self.profile.velocity if speed is None else speed)

    async def home(self) -> None:
        """Turn clockwise to the stop; what the encoder reads there proves whether it passed the index.

        If not (it began beyond the index), turn back past the index and once more to the stop; else
        HomingError. Ends at rest, a little before the stop.
        """
        with self.claim.of("home"):
            self._watched = False
            await self._synchronize()
            self.encoder_zero.write(EnableDisable.ENABLE)
            start = value_of(self.encoder, HOMING)
            reading = await self._search_stop()
            if abs(reading - self.stop) > 1.0:
                await self._travel(self.commanded - 1.4 * (self.stop - self.index), self.search_speed)
                reading = await self._search_stop()
            self.encoder_zero.write(EnableDisable.DISABLE)
            if abs(reading - start) < 1.0:
                raise HomingError("theta does not turn, or its encoder is dead: the count stood still both ways")
            if abs(reading - self.stop) > 1.0:
                raise HomingError(
                    f"theta found no index pulse: the encoder reads {reading:.1f} deg at the stop, not {self.stop:.1f}"
                )
            await self._travel(self.commanded - 15.0, self.search_speed)
            self.encoder.referenced()
            await self._synchronize()
            self._watched = True

    async def _travel(self, angle: float, speed: float) -> None:
        limit = STEPS_PER_PERIOD * self.step_angle / self.period
        duration = self.profile.to(angle, velocity=min(speed, limit))
        await until(
            lambda: self.profile.done and abs(self.commanded - angle) <= self.step_angle, timeout=3 * duration + 1.0
        )
        if self._watched and await self._count_lost_steps():
            await self._travel(angle, speed)

    async def _count_lost_steps(self) -> int:
        """Once the rotor has come to rest: the whole steps that the encoder misses; they are counted from now on."""
        for _ in range(math.ceil(0.5 / self.period)):
            if abs(value_of(self.encoder) - self.commanded) < 0.6 * self.step_angle:
                return 0
            await next_period()
        lost = round((value_of(self.encoder) - self.commanded) / self.step_angle)
        self._offset += lost * self.step_angle
        self.profile.hold(self.commanded)
        return lost

    async def _synchronize(self) -> None:
        """Let the rotor come to rest; then count from where the encoder says that it is."""
        await wait(0.3)
        self._offset = value_of(self.encoder, HOMING) - self.stepping.count * self.step_angle
        self.profile.hold(self.commanded)

    async def _search_stop(self) -> float:
        """Turn clockwise until the encoder gains nothing more; the largest angle that it read there.

        At the stop the rotor falls back by an electrical cycle again and again, so the largest counts.
        """
        limit = STEPS_PER_PERIOD * self.step_angle / self.period
        self.profile.to(self.commanded + 2 * (self.stop + 360.0), velocity=min(self.search_speed, limit))
        before = peak = mark = value_of(self.encoder, HOMING)
        since = self.commanded
        while self.commanded - since < 20.0:
            await next_period()
            value = value_of(self.encoder, HOMING)
            zeroed = abs(value - before) > 5.0  # the index was passed
            peak = value if zeroed else max(peak, value)
            if zeroed or peak > mark + 0.5:
                mark, since = peak, self.commanded
            before = value
        self.profile.hold(self.commanded)
        return peak
