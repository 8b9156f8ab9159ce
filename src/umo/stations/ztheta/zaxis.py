"""The z axis: a servo motor, its encoder, and the bit that lets the index pulse load the counter."""

from __future__ import annotations

import enum

from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, EnableDisable
from umo.control import HOMING, Claim, Profile, Servo, next_period, until, value_of, wait

from .errors import AxisError, HomingError

JUMP = 5_000.0
"""No arm moves so far in a period, um: the counter was loaded with its preset, or wrapped at its width."""


class Mode(enum.Enum):
    """Who commands the motor."""

    IDLE = "idle"  # 0 V: the counterweight carries the arm
    SEARCH = "search"  # constant speed, open loop, while the count means nothing
    SERVO = "servo"


class ZAxis(Compound):
    """Moves in um; positive is up. The wired counter's preset stands for `index`."""

    motor: DigitalActuator
    encoder: DigitalSensor
    encoder_zero: BinaryActuator[EnableDisable]
    index: float = 121_999.4
    """Where the encoder's index pulse stands, um."""
    upper_stop: float = 129_500.0
    """Where the upper end stop stands, um."""
    search_speed: float = 20_000.0
    """Speed of homing, um per s."""
    following_error: float = 500.0
    """Largest distance between setpoint and encoder, um; beyond it the axis does not follow."""

    def setup(self) -> None:
        # gains of the 12-bit DAC and its amplifier, measured on the plant (docs/ztheta.md)
        self.servo = Servo(
            self.encoder,
            self.motor,
            gain=4.3e-3,
            integral_time=0.1,
            derivative_time=1e-3,
            filter_time=1e-3,
            feed_forward=3.1416e-5,
            inertia=2.25e-7,
            friction=0.0955,
        )
        self.profile = Profile(velocity=100_000.0, acceleration=1.0e6, jerk=2.0e7)
        self.claim = Claim(self)
        self.mode = Mode.IDLE
        self._search_volts = 0.0

    def control(self) -> None:
        if self.mode is Mode.SERVO:
            dt, servo = self.dt, self.servo
            servo.control(*self.profile.step(dt), dt=dt)
            if abs(servo.error) > self.following_error:
                raise AxisError(f"z does not follow: {servo.error / 1e3:.2f} mm behind its setpoint")
        else:
            self.motor.write(self._search_volts if self.mode is Mode.SEARCH else 0.0)

    async def move_to(self, position: float, *, speed: float | None = None) -> None:
        """To a position in um, at most `speed` um per s, jerk-limited; ends when the encoder has arrived."""
        with self.claim.of("move_to"):
            await self._travel(position, self.profile.velocity if speed is None else speed)

    async def home(self) -> None:
        """Find the reference: up until the counter jumps to its preset or the arm meets its stop, then down.

        Ends at rest below the index. HomingError when no index was found and the count is not known either.
        """
        with self.claim.of("home"):
            self.encoder_zero.write(EnableDisable.ENABLE)
            try:
                found = await self._search(+1) or await self._search_down()
            finally:
                self.mode = Mode.IDLE
                self.encoder_zero.write(EnableDisable.DISABLE)
            self.encoder.referenced()
            self._take_over(found)
            await self._travel(self.index - 5_000.0, self.search_speed)

    def _take_over(self, speed: float) -> None:
        """The servo takes the arm over at the speed that it has."""
        self.servo.reset()
        self.profile.hold(value_of(self.encoder, HOMING), speed)
        self.mode = Mode.SERVO

    async def _travel(self, position: float, speed: float) -> None:
        duration = self.profile.to(position, velocity=speed)
        await wait(duration)
        await until(lambda: abs(self.servo.error) < 30.0, timeout=1.0)

    async def _search(self, sign: int, reach: float = 200_000.0) -> float:
        """Drive up (+1) or down (-1); the speed at which the index was met, or 0.0 at standstill or after `reach`."""
        self._search_volts = sign * (self.search_speed * self.servo.feed_forward + self.servo.friction)
        self.mode = Mode.SEARCH
        travelled = before = quiet = 0.0
        last = value_of(self.encoder, HOMING)
        while travelled < reach:
            await next_period()
            value = value_of(self.encoder, HOMING)
            if abs(value - last) < JUMP:
                travelled += abs(value - last)
            elif abs(value - self.index) < 1_000.0:
                return sign * self.search_speed
            last = value
            quiet += self.dt
            if quiet >= 0.1:
                if travelled - before < 100.0:
                    break
                before, quiet = travelled, 0.0
        return 0.0

    async def _search_down(self) -> float:
        """No jump on the way up. Either the arm began above the index, or the count was known already, from a
        run before: then it is right at the stop, and crossing the index changes nothing."""
        at_stop = value_of(self.encoder, HOMING)
        found = await self._search(-1, reach=1.5 * (self.upper_stop - self.index))
        if found:
            return found
        here = value_of(self.encoder, HOMING)
        if abs(at_stop - self.upper_stop) < 300.0 and here < self.index - 1_000.0:
            return -self.search_speed
        if here == at_stop:
            raise HomingError("z does not move, or its encoder is dead: the count stood still both ways")
        raise HomingError(f"z found no index pulse: the encoder read {at_stop:.0f} um at the stop, then {here:.0f} um")
