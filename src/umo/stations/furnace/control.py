"""The control of the furnace: PI control of all zones in one calculation. Each zone has an interlock and a fault."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np

from umo import (
    BinaryActuator,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    Number,
    Quality,
    Range,
    Vector,
    action,
)
from umo.control import Servo, VectorServo, until, value_of, wait
from umo.errors import RangeError, TimeExpired
from umo.states import OnOff

from .errors import HeatingError, OverTemperature, TooManyFaults

PLACES, SHARES = (0.0, 0.35, 0.75, 1.0), (0.4, 1.0, 1.0, 0.35)
"""Places along the tunnel, and the set temperatures there as shares of the peak: heating, soaking, cooling zones."""
GAINS = {
    "heating.gain": Number("percent/K", 0.0, 20.0, tunable=True),
    "heating.integral_time": Number("s", 5.0, 400.0, tunable=True),
}
NAMED = 10  # zones in a message


class Zone(Compound):
    heater: DigitalActuator
    fan: BinaryActuator[OnOff]
    temperature: DigitalSensor
    limit: float = 1000.0
    """Temperature above which the heater is inhibited, degC."""

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: value_of(self.temperature) > self.limit, [self.heater], "over-temperature")


class ZoneWithLaw(Zone, numbers={"setpoint": Number("degC", shown=True), **GAINS}):
    """A zone with a separate PI, so that the zone may run on a separate controller."""

    gain: float = 4.0
    """The gain of the PI, percent per K."""
    integral_time: float = 40.0
    """The integral time of the PI, s."""

    def setup(self) -> None:
        self.heating = Servo(self.temperature, self.heater, gain=self.gain, integral_time=self.integral_time)
        self.setpoint, self.heats = 0.0, False

    def control(self) -> None:
        if not self.heats:
            return
        quality = self.temperature.quality
        if quality == Quality.BAD or quality == Quality.OUT_OF_RANGE:
            self.heater.write(0.0)
        else:
            self.heating.control(self.setpoint, dt=self.dt)


class Furnace(
    Compound,
    numbers={"setpoint": Number("degC", shown=True), "faulted_zones": Number(shown=True), **GAINS},
    max_period="1 s",
):
    zones: Sequence[Zone]
    timer: DigitalSensor
    gain: float = 4.0
    """Gain of each zone's PI, percent per K."""
    integral_time: float = 40.0
    """Integral time of each zone's PI, s."""
    tolerance: Annotated[float, Number("K", 1.0, 20.0, tunable=True)] = 5.0
    """The distance from its set temperature within which a zone counts as arrived, K."""
    following_error: Annotated[float, Number("K", 20.0, 200.0, tunable=True)] = 60.0
    """Distance below its setpoint from which on a zone counts as not heating, K."""
    margin: float = 25.0
    """Distance above its limit from which on a zone counts as impossible to switch off, K."""
    frozen_after: int = 300
    """The number of successive equal readings after which a converter counts as frozen, because a working converter has
    noise."""
    most_faulted: float = 0.1
    """The largest share of the zones that may be faulted. One of several zones may always be faulted."""

    def setup(self) -> None:
        self.heaters = Vector(zone.heater for zone in self.zones)
        self.fans = Vector(zone.fan for zone in self.zones)
        self.temperatures = Vector(zone.temperature for zone in self.zones)
        self.heating = VectorServo(self.temperatures, self.heaters, gain=self.gain, integral_time=self.integral_time)
        self.limits = np.array([zone.limit for zone in self.zones])
        self.have_laws = np.array([isinstance(zone, ZoneWithLaw) for zone in self.zones])
        self.with_laws = tuple((n, zone) for n, zone in enumerate(self.zones) if isinstance(zone, ZoneWithLaw))
        self._clear()

    def _clear(self) -> None:
        """Forget the state of an earlier run."""
        self.heating.reset()
        self.setpoints, self.targets = np.zeros(len(self.zones)), np.zeros(len(self.zones))
        self.ramp = 0.0  # K/s
        self.faulted = np.zeros(len(self.zones), np.bool_)
        self._last = np.zeros(len(self.zones))
        self._equal = np.zeros(len(self.zones), np.int64)  # readings in a row that were as the last one
        self.soak_errors = np.zeros(len(self.zones))  # the largest error of each zone since the soak began, K
        self.soaking = False
        self.setpoint, self.faulted_zones, self.phase = 0.0, 0, ""

    def control(self) -> None:
        if not self.ramp:
            return
        temperatures = self.temperatures.read()
        self._check_zones(temperatures)
        step = self.ramp * self.dt
        self.setpoints = self.setpoints + np.clip(self.targets - self.setpoints, -step, step)
        self.heating.control(self.setpoints, dt=self.dt, enabled=~(self.faulted | self.have_laws))
        for n, zone in self.with_laws:
            zone.setpoint, zone.heats = self.setpoints[n], not self.faulted[n]
        errors = np.where(self.faulted, 0.0, self.setpoints - temperatures)
        self.fans.write((self.faulted | (temperatures > self.limits)).astype(np.float64))
        if self.soaking:
            self.soak_errors = np.maximum(self.soak_errors, np.abs(errors))
        self.setpoint = float(self.setpoints.max())
        if (cold := errors > self.following_error).any():
            raise HeatingError(f"{_named(cold)}: {errors.max():.0f} K below the setpoint")

    def _check_zones(self, temperatures: Any) -> None:
        """Make a zone faulted (heater off, fan on) if its temperature is invalid or does not change at all."""
        quality = self.temperatures.quality
        invalid = (quality == Quality.BAD) | (quality == Quality.OUT_OF_RANGE)
        hot = (temperatures > self.limits + self.margin) & ~invalid  # no zone leaves the range without passing here
        if hot.any():
            hottest = np.where(hot, temperatures, 0.0).max()
            raise OverTemperature(f"{_named(hot)}: {hottest:.0f} degC, the heater does not switch off")
        self._equal = np.where(temperatures == self._last, self._equal + 1, 0)
        self._last = temperatures
        found = (invalid | (self._equal >= self.frozen_after)) & ~self.faulted
        if not found.any():
            return
        self.faulted = self.faulted | found
        self.faulted_zones = int(self.faulted.sum())
        self.heaters.write(0.0, where=found)
        self.say(self.phase)
        if self.faulted.all() or self.faulted_zones > max(1, int(self.most_faulted * len(self.zones))):
            raise TooManyFaults(f"{self.faulted_zones} of {len(self.zones)} zones are faulted: {_named(self.faulted)}")

    def say(self, phase: str, done: int | None = None) -> None:
        """Report the phase, and the faulted zones."""
        self.phase = phase
        self.cycle.progress(phase + (f", {_named(self.faulted)} faulted" if self.faulted_zones else ""), done, 2)

    @property
    def hottest(self) -> float:
        """The highest temperature that `heat_up` accepts, degC."""
        return float(self.limits.min()) - self.margin

    @action(peak=lambda furnace: Range("degC", 100.0, furnace.hottest), ramp=Range("K/s", 0.1, 4.0))
    async def heat_up(self, peak: float, ramp: float) -> None:
        """Heat up to the profile with its highest temperature `peak` (degC), at `ramp` (K/s). Raises HeatingError if
        this takes longer than `peak / ramp` plus a minute."""
        if not 100.0 <= peak <= self.hottest:
            raise RangeError(f"peak must be 100 to {self.hottest:g} degC, not {peak:g}")
        if not 0.1 <= ramp <= 4.0:
            raise RangeError(f"ramp must be 0.1 to 4 K/s, not {ramp:g}")
        self._clear()
        self.say("heating up", done=0)
        places = np.linspace(0.0, 1.0, len(self.zones)) if len(self.zones) > 1 else np.array([0.5])
        self.setpoints = np.nan_to_num(self.temperatures.read())  # NaN: a zone that was never read is faulted
        self.targets, self.ramp = peak * np.interp(places, PLACES, SHARES), ramp
        try:
            await until(lambda: not self._away().any(), timeout=peak / ramp + 60.0, stays="5 s")
        except TimeExpired:
            raise HeatingError(f"{_named(self._away())} not within {self.tolerance:g} K in time") from None

    @action(duration=Range("s", 0.0, 36_000.0))
    async def soak(self, duration: float) -> None:
        """Keep the profile for `duration` s."""
        self.say("soaking", done=1)
        self.soak_errors, self.soaking = np.zeros(len(self.zones)), True
        await wait(duration)

    @action
    def switch_off(self) -> None:
        """Switch the heaters off, so that the furnace cools down."""
        self.ramp = 0.0
        for _, zone in self.with_laws:
            zone.heats = False
        self.heaters.write(0.0)

    def results(self) -> dict[str, Any]:
        """Return the results of the soak: the number of good zones, the other zones, and the largest error of each zone
        (K; None for a faulted zone)."""
        errors = [None if bad else round(float(e), 1) for e, bad in zip(self.soak_errors, self.faulted, strict=True)]
        good = int(((self.soak_errors <= self.tolerance) & ~self.faulted).sum())
        return {"zones_good": good, "zones_faulted": _named(self.faulted) or "none", "soak_errors_K": errors[:1000]}

    def _away(self) -> Any:
        """Return which zones are not at their set temperatures yet."""
        return (np.abs(self.targets - self.temperatures.read()) > self.tolerance) & ~self.faulted


def _named(zones: Any) -> str:
    """Return the zones of an array of booleans, for messages."""
    numbers = np.flatnonzero(zones)
    more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
    return f"zone{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers[:NAMED]))}{more}" if len(numbers) else ""
