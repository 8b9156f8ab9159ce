"""Excitations of a loop: the values that are written to its output during an experiment, and the end of the experiment.
The computations use plain numbers."""

from __future__ import annotations

from math import floor, inf, isfinite, log10, sqrt

from umo.digits import number_text

MOST_KEPT = 256
"""The largest number of measurements that are kept to detect whether a step has settled."""
FEWEST_KEPT = 48
SETTLED_SHARE = 0.02
"""A step has settled when the measurement's change over the last third of the step is below this share of the whole
change."""
SMALLER = 0.5
"""The share of the amplitude that is used in the last part of an experiment. This third level shows whether the process
is linear."""
MAX_TURN_TIME = 4.0
"""Longest time for the smaller amplitude to turn the measurement, as a multiple of the longest half cycle."""
LEAST_SHARE = 0.001
"""The least share of the range that is offered as an amplitude."""
NOISE_FACTOR = 10.0
"""The hysteresis of a relay, as a multiple of the standard deviation of the noise."""


class Baseline:
    """The loop before the experiment: the means of output and measurement, and the noise. All numbers are finite,
    because the law refuses other numbers."""

    def __init__(self) -> None:
        self.count = 0
        self.output = self.measurement = self.time = 0.0
        self._last = self._squares = 0.0

    def add(self, output: float, measurement: float, dt: float) -> None:
        if self.count:
            self._squares += (measurement - self._last) ** 2
        self.count, self._last, self.time = self.count + 1, measurement, self.time + dt
        self.output += (output - self.output) / self.count
        self.measurement += (measurement - self.measurement) / self.count

    @property
    def noise(self) -> float:
        """Standard deviation of the measurement from one sample to the next."""
        return sqrt(self._squares / 2.0 / (self.count - 1)) if self.count > 1 else 0.0


class RelaySwitching:
    """A relay that switches the output up and down around the old output, whenever the measurement leaves a band around
    the old measurement. In the last cycles the output goes up by a smaller amplitude, as long as this amplitude turns
    the measurement."""

    def __init__(self, base: Baseline, amplitude: float, rising: bool, hysteresis: float, cycles: int) -> None:
        """`rising`: whether a larger output makes the measurement rise."""
        self.low, self.high = base.output - amplitude, base.output + amplitude
        self._smaller = base.output + SMALLER * amplitude
        self._middle, self._hysteresis, self._rising = base.measurement, hysteresis, rising
        self._cycles, self._rises, self._up = cycles, 0, True
        self._full = cycles - (cycles - 1) // 2
        """The number of cycles with the whole amplitude."""
        self._time = self._longest = 0.0
        """The duration in s of this half cycle, and of the longest half cycle with the whole amplitude."""

    def next(self, measurement: float, dt: float) -> float | None:
        """Return the next output, or None at the end."""
        self._time += dt
        away = (measurement - self._middle) * (1.0 if self._rising else -1.0)
        if away > self._hysteresis and self._up:
            self._turn()
        elif away < -self._hysteresis and not self._up:
            self._turn()
            self._rises += 1
        return None if self._rises > self._cycles else self._level if self._up else self.low

    def _turn(self) -> None:
        self._up = not self._up
        if self._rises <= self._full:
            self._longest = max(self._longest, self._time)
        self._time = 0.0

    @property
    def _level(self) -> float:
        smaller = self._rises > self._full and self._time <= MAX_TURN_TIME * self._longest
        return self._smaller if smaller else self.high

    @property
    def progress(self) -> str:
        return f"relay: cycle {min(self._rises + 1, self._cycles)} of {self._cycles}"


class StepChange:
    """An excitation that adds a step to the old output until the measurement has settled, and then a smaller step for
    the same time."""

    def __init__(self, base: Baseline, amplitude: float) -> None:
        self.base, self.amplitude = base, amplitude
        self._times: list[float] = []
        self._kept: list[float] = []
        self._time = 0.0
        self._pause = 0.0
        """The least time in s between two measurements that are kept."""
        self._settled: float | None = None
        """The time in s after which the measurement had settled; None before that."""

    @property
    def low(self) -> float:
        return min(self.base.output, self.base.output + self.amplitude)

    @property
    def high(self) -> float:
        return max(self.base.output, self.base.output + self.amplitude)

    def next(self, measurement: float, dt: float) -> float | None:
        """Return the next output, or None at the end."""
        self._time += dt
        if self._settled is not None:
            smaller = self.base.output + SMALLER * self.amplitude
            return smaller if self._time <= 2.0 * self._settled else None
        if not self._times or self._time - self._times[-1] >= self._pause:
            self._times.append(self._time)
            self._kept.append(measurement)
            if len(self._kept) >= MOST_KEPT:
                del self._times[::2], self._kept[::2]
                self._pause = 1.5 * self._time / MOST_KEPT
            if self._has_settled():
                self._settled = self._time
        return self.base.output + self.amplitude

    def _has_settled(self) -> bool:
        count = len(self._kept)
        if count < FEWEST_KEPT:
            return False
        tenth = count // 10
        end, before = _mean(self._kept[-tenth:]), _mean(self._kept[-4 * tenth : -3 * tenth])
        change = abs(end - self.base.measurement)
        noise = self.base.noise / sqrt(tenth)
        return change > 10.0 * noise and abs(end - before) < SETTLED_SHARE * change + 3.0 * noise

    @property
    def progress(self) -> str:
        return f"step: {self._time:.0f} s"


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def room_for(base: Baseline, amplitude: float, low: float, high: float, both: bool) -> float:
    """Return the largest amplitude of this sign that fits between the bounds, or, with `both`, on both sides of the old
    output."""
    up, down = high - base.output, base.output - low
    room = min(up, down) if both else up if amplitude > 0.0 else down
    return max(room, 0.0) if isfinite(room) else inf


def fitting(base: Baseline, low: float, high: float, span: float, units: str) -> str:
    """Return the largest amplitudes that fit between the bounds. `span`: the width of the output's range, of which an
    amplitude is a share if the width is finite."""
    up, down = (room_for(base, sign, low, high, both=False) for sign in (1.0, -1.0))
    rooms = {"a relay of ": min(up, down), "a step of ": up, "a step of -": down}
    told = [f"{kind}{_share(room, span, units)}" for kind, room in rooms.items() if _is_usable(room, span)]
    return f"at most {' or '.join(told)}" if told else "no amplitude"


def _is_usable(room: float, span: float) -> bool:
    return isfinite(room) and room > (LEAST_SHARE * span if isfinite(span) else 0.0)


def _share(room: float, span: float, units: str) -> str:
    """Return an amplitude, rounded down: a share of the range, or a number in its unit."""
    value = 100.0 * room / span if isfinite(span) else room
    digit = 10.0 ** (floor(log10(value)) - 1)
    text = number_text(floor(value / digit) * digit)
    return f"{text}%" if isfinite(span) else f"{text} {units}"
