"""Plants on which the tuning of laws is judged: made from a seed, described by data, in parts with other families.

A plant is K prod(1 - s/zero) / prod(1 - s/pole) / s^integrators behind a dead time; before it an actuator (saturation,
dead band, backlash, stiction), behind it a sensor (noise, drift, resolution). Time scales and gains lie over decades.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from math import exp, inf, log, pi
from pathlib import Path
from typing import Any

import numpy as np

from umo.drivers.contract import Channel, Direction, Driver

DEVELOP, HELD_OUT, FRESH = "develop", "held out", "fresh"
"""The part on which the method was made; one with other families; and one with the families of that and another seed,
as a structure was added for what the second had shown."""
COUNT = 100
"""Plants of each part."""
SEEDS: Mapping[str, int] = {DEVELOP: 1, HELD_OUT: 2, FRESH: 3}
BIAS = 50.0
"""Output at which the loop is at rest, per cent."""
AMPLITUDE = 10.0
"""Of the experiment, per cent: what the guide recommends."""
RAWS = 1_000_000
"""Raw value of the middle of the sensor's range."""

Random = np.random.Generator


@dataclass(frozen=True)
class Plant:
    """One plant, its law before it is tuned, and the experiment. Times in s, outputs in per cent."""

    family: str
    gain: float
    dead_time: float
    poles: tuple[complex, ...]
    zeros: tuple[complex, ...] = ()
    integrators: int = 0
    dt: float = 1.0
    span: float = 1.0
    """Range of the sensor."""
    resolution: float = 0.0
    noise: float = 0.0
    drift: float = 0.0
    """Units of the measurement per s."""
    walk: float = 0.0
    """Random walk of the measurement in one s, standard deviation."""
    saturation: float = inf
    """Of the actuator around its bias, per cent."""
    dead_band: float = 0.0
    """Half of it, around the bias, per cent."""
    backlash: float = 0.0
    """Whole width, per cent."""
    stiction: float = 0.0
    """The actuator moves, at once, when it is so far from its command, per cent."""
    present: tuple[float, float, float] = (0.0, inf, 0.0)
    """Gain, integral time and derivative time of the law that is tuned."""
    experiment: str = "relay"
    lasts: float = 60.0
    """Duration of the experiment at most."""
    seed: int = 0

    @property
    def time(self) -> float:
        """The sum of its time constants and the dead time."""
        return self.dead_time + sum(1.0 / abs(each) for each in (*self.poles, *self.zeros))

    def described(self) -> str:
        lags = ", ".join(f"{each:.3g}" for each in self.poles)
        zeros = ", ".join(f"{each:.3g}" for each in self.zeros)
        return f"K {self.gain:.3g} L {self.dead_time:.3g} poles {lags} zeros {zeros} dt {self.dt:.3g} {self.experiment}"


def plants(part: str, count: int = COUNT) -> list[Plant]:
    """The first plants of a part; one part has families and a seed of its own."""
    families = FAMILIES[DEVELOP if part == DEVELOP else HELD_OUT]
    order = [name for name, share in families.items() for _ in range(share[0])]
    np.random.default_rng(SEEDS[part]).shuffle(order)
    made = []
    for number, name in enumerate(order[:count]):
        random = np.random.default_rng([SEEDS[part], number])
        made.append(_finished(replace(families[name][1](random), family=name, seed=number), random))
    return made


# Families --------------------------------------------------------------------------------------------------


def _log(random: Random, low: float, high: float) -> float:
    return float(exp(random.uniform(log(low), log(high))))


def _lags(*lags: float) -> tuple[complex, ...]:
    return tuple(-1.0 / each for each in lags)


def _pair(time: float, damping: float) -> tuple[complex, ...]:
    pole = complex(-damping, (1.0 - damping**2) ** 0.5) / time
    return pole, pole.conjugate()


def _plain(*lags: float, dead_time: float = 0.0, **more: Any) -> Plant:
    return Plant("", 1.0, dead_time, _lags(*lags), **more)


def _second(random: Random) -> Plant:
    return _plain(1.0, random.choice([random.uniform(0.1, 0.9), 1.0]), dead_time=random.uniform(0.05, 0.6))


def _oscillating(random: Random) -> Plant:
    return Plant("", 1.0, random.uniform(0.0, 1.0), _pair(1.0, _log(random, 0.03, 0.8)))


def _first(random: Random, **more: Any) -> Plant:
    return _plain(1.0, dead_time=_log(random, 0.1, 0.6), **more)


def _conduction(random: Random) -> Plant:
    """A wall: 1 / cosh(sqrt(s)), its first six lags."""
    return _plain(*(4.0 / pi**2 / (2 * each + 1) ** 2 for each in range(6)), dead_time=random.uniform(0.0, 0.1))


def _crane(random: Random) -> Plant:
    """An integrator with a resonance."""
    return Plant("", 1.0, random.uniform(0.0, 0.3), _pair(1.0, _log(random, 0.02, 0.5)), (), 1)


def _two_times(random: Random) -> Plant:
    """A fast part of the response, and a slow one."""
    slow = _log(random, 3.0, 20.0)
    return Plant("", 1.0, random.uniform(0.05, 0.3), _lags(1.0, slow), _lags(slow * random.uniform(0.4, 0.8)))


Family = tuple[int, Callable[[Random], Plant]]
FAMILIES: Mapping[str, Mapping[str, Family]] = {
    DEVELOP: {
        "first order": (14, lambda r: _plain(1.0, dead_time=_log(r, 0.03, 1.0))),
        "long dead time": (6, lambda r: _plain(1.0, dead_time=_log(r, 1.0, 6.0))),
        "second order": (14, _second),
        "integrator": (8, lambda r: _plain(dead_time=1.0, integrators=1)),
        "lagged integrator": (8, lambda r: _plain(1.0, dead_time=_log(r, 0.05, 1.0), integrators=1)),
        "high order": (12, lambda r: _plain(*[1.0] * int(r.integers(3, 9)))),
        "oscillating": (8, _oscillating),
        "inverse response": (6, lambda r: replace(_second(r), zeros=(1.0 / _log(r, 0.2, 2.0),))),
        "double integrator": (3, lambda r: _plain(dead_time=_log(r, 0.05, 1.0), integrators=2)),
        "unstable": (5, lambda r: Plant("", 1.0, _log(r, 0.05, 0.4), (1.0,))),
        "dead band": (2, lambda r: _first(r, dead_band=r.uniform(0.5, 4.0))),
        "stiction": (2, lambda r: _first(r, stiction=r.uniform(0.5, 4.0))),
        "backlash": (4, lambda r: _first(r, backlash=r.uniform(0.5, 6.0))),
        "drift": (4, lambda r: _first(r, drift=r.normal() * 0.02, walk=abs(r.normal()) * 0.02)),
        "saturation": (2, lambda r: _first(r, saturation=r.uniform(3.0, 12.0))),
        "lead": (2, lambda r: replace(_second(r), zeros=_lags(_log(r, 0.3, 3.0)))),
    },
    HELD_OUT: {
        "first order": (12, lambda r: _plain(1.0, dead_time=_log(r, 0.02, 1.5))),
        "only dead time": (4, lambda r: _plain(0.05, dead_time=1.0)),
        "second order": (10, lambda r: _plain(1.0, r.uniform(0.02, 1.0), dead_time=_log(r, 0.02, 2.0))),
        "integrator": (8, lambda r: _plain(r.uniform(0.01, 0.2), dead_time=1.0, integrators=1)),
        "lagged integrator": (8, lambda r: _plain(1.0, r.uniform(0.1, 0.5), dead_time=0.2, integrators=1)),
        "geometric lags": (10, lambda r: _plain(*r.uniform(0.1, 0.8) ** np.arange(5))),
        "high order": (8, lambda r: _plain(*[1.0] * int(r.integers(4, 12)), dead_time=r.uniform(0.0, 2.0))),
        "conduction": (5, _conduction),
        "oscillating": (6, lambda r: replace(_oscillating(r), poles=(*_oscillating(r).poles, -_log(r, 0.3, 3.0)))),
        "crane": (3, _crane),
        "inverse response": (5, lambda r: replace(_plain(1.0, 0.4, dead_time=0.3), zeros=(1.0 / r.uniform(0.1, 1.0),))),
        "inverse integrator": (2, lambda r: replace(_plain(1.0, integrators=1), zeros=(1.0 / r.uniform(0.2, 1.0),))),
        "double integrator": (2, lambda r: _plain(0.2, dead_time=0.1, integrators=2)),
        "unstable": (4, lambda r: Plant("", 1.0, r.uniform(0.02, 0.3), (1.0, -1.0 / r.uniform(0.05, 0.3)))),
        "two times": (4, _two_times),
        "dead band": (2, lambda r: replace(_second(r), dead_band=r.uniform(0.3, 5.0))),
        "stiction and backlash": (3, lambda r: _first(r, stiction=r.uniform(0.3, 3.0), backlash=r.uniform(0.3, 3.0))),
        "drift": (3, lambda r: replace(_second(r), drift=r.normal() * 0.03, walk=abs(r.normal()) * 0.03)),
        "saturation": (1, lambda r: _first(r, saturation=r.uniform(2.0, 8.0))),
    },
}
"""How many of each, and one of a time constant and a gain of 1; drift and walk as shares of the response."""


def _finished(plant: Plant, random: Random) -> Plant:
    """With its scales of time and gain, its sensor, its law and the experiment."""
    scale, gain = _log(random, 0.02, 50.0), _log(random, 0.01, 100.0) * (1.0 if random.random() < 0.8 else -1.0)
    stretch: Callable[[tuple[complex, ...]], tuple[complex, ...]] = lambda each: tuple(one / scale for one in each)  # noqa: E731
    time = plant.time * scale
    gain /= scale**plant.integrators
    full = abs(gain) * AMPLITUDE * max(time, 1e-9) ** plant.integrators
    noise = full * float(random.choice([0.0, 0.001, 0.003, 0.01, 0.03], p=[0.2, 0.25, 0.2, 0.2, 0.15]))
    span = full * random.uniform(15.0, 40.0)
    plant = replace(
        plant,
        gain=gain,
        dead_time=plant.dead_time * scale,
        poles=stretch(plant.poles),
        zeros=stretch(plant.zeros),
        dt=max(float(f"{time / _log(random, 20.0, 200.0):.2g}"), 0.001),
        span=span,
        resolution=span / float(random.choice([1000.0, 4096.0, 65536.0], p=[0.1, 0.4, 0.5])),
        noise=noise,
        drift=plant.drift * full / time,
        walk=plant.walk * full / time**0.5,
        experiment=str(random.choice(["relay", "step"], p=[0.6, 0.4])),
        lasts=40.0 * time,
    )
    return replace(_plain_numbers(plant), present=tuple(map(float, _present(plant))))


def _plain_numbers(plant: Plant) -> Plant:
    """Without numpy's numbers, whose texts are not Python's."""
    return replace(plant, **{name: float(each) for name, each in vars(plant).items() if isinstance(each, float)})


def _present(plant: Plant) -> tuple[float, float, float]:
    """A law with which the loop is stable, and slow."""
    time, gain = plant.time, plant.gain
    if any(each.real > 0.0 for each in plant.poles):
        lag = max(1.0 / each.real for each in plant.poles)
        return ((lag / max(plant.dead_time, 0.05 * lag)) ** 0.5 * -1.0 / gain, inf, 0.0)
    if plant.integrators == 2:
        return (0.02 / gain / time**2, inf, 10.0 * time)
    if plant.integrators:
        return (0.1 / gain / time * _damping(plant), inf, 0.0)
    return (0.2 / gain * _damping(plant), time, 0.0)


def _damping(plant: Plant) -> float:
    return min([1.0, *(-1.5 * each.real / abs(each) for each in plant.poles if each.imag)])


# A station with the plant ----------------------------------------------------------------------------------

OBJECTS = """
from math import inf

from umo import Compound, DigitalActuator, DigitalSensor, Number
from umo.control import Servo


class Loop(
    Compound,
    numbers={{
        "servo.gain": Number("percent/mm", -1e12, 1e12, tunable=True),
        "servo.integral_time": Number("s", 1e-6, 1e12, tunable=True),
    }},
):
    valve: DigitalActuator
    level: DigitalSensor
    timer: DigitalSensor

    def setup(self) -> None:
        gain, integral_time, derivative_time = {present}
        self.servo = Servo(
            self.level, self.valve, gain=gain, integral_time=integral_time, derivative_time=derivative_time,
            filter_time=derivative_time / 10.0,
        )
        self.servo.integral = {bias}

    def control(self) -> None:
        self.servo.control(0.0, dt=self.dt)


def machine() -> Loop:
    return Loop(
        valve=DigitalActuator("percent", default={bias}, minimum=0.0, maximum=100.0, resolution=0.001),
        level=DigitalSensor(
            "mm", minimum=-{half!r}, maximum={half!r}, resolution={resolution!r}, zero_offset={offset!r}
        ),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo.control import wait


async def main(m):
    await wait(1e9)
"""
WIRING = """
[drivers.plant]
type = "helpers.tuning_plants:SimulatedPlant"
description = "{description}"

[wire]
"timer" = {{ driver = "plant", channel = "tick", period = "{period:.9g} s" }}
"valve" = {{ driver = "plant", channel = "valve" }}
"level" = {{ driver = "plant", channel = "level" }}

[process]
hang_timeout = "60 s"
"""


def station(plant: Plant, folder: Path) -> Path:
    """The folder of a station whose loop has this plant."""
    place = folder / "loop"
    (place / "wiring").mkdir(parents=True)
    description = place / "plant.json"
    description.write_text(json.dumps(asdict(plant), default=lambda each: [each.real, each.imag]))
    present = "({}, {}, {})".format(*(repr(each) for each in plant.present))
    texts = {
        "objects.py": OBJECTS.format(
            present=present,
            bias=BIAS,
            half=plant.span / 2.0,
            resolution=plant.resolution,
            offset=-RAWS * plant.resolution,
        ),
        "application.py": APPLICATION,
        "wiring/simulated.toml": WIRING.format(description=description, period=plant.dt),
    }
    for file, text in texts.items():
        (place / file).write_text(text.lstrip())
    return place


def described_in(file: Path) -> Plant:
    """The plant of a station."""
    told = json.loads(file.read_text())
    for name in ("poles", "zeros"):
        told[name] = tuple(complex(*each) if isinstance(each, list) else complex(each) for each in told[name])
    return Plant(**{each.name: told[each.name] for each in fields(Plant)})


CHANNELS = {
    "tick": Channel("tick", Direction.INPUT, 31),
    "valve": Channel("valve", Direction.OUTPUT, 31),
    "level": Channel("level", Direction.INPUT, 31),
}


class SimulatedPlant(Driver):
    """The plant, from one period to the next.

    Options:
        description: the file that describes it.
    """

    simulates_time = True

    def __init__(self, *, description: str) -> None:
        self.plant = described_in(Path(description))
        self.state = PlantState(self.plant)
        self.valve = BIAS

    def channel(self, text: str) -> Channel:
        return CHANNELS[text]

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.state.advance(self.valve - BIAS)
            return 0
        return max(round(self.state.measured() / self.plant.resolution) + RAWS, 0)

    def write(self, channel: Channel, raw: int) -> None:
        self.valve = raw / 1000.0


@dataclass
class PlantState:
    """The state of a plant, at rest."""

    plant: Plant
    _position: float = field(default=0.0, init=False)
    """Of the actuator, after stiction and backlash."""
    _stem: float = field(default=0.0, init=False)
    _disturbance: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        from helpers.true_margins import sampled_parts

        self.random = np.random.default_rng(self.plant.seed)
        self._before, self._after, self._out, whole = sampled_parts(self.plant)
        self._x = np.zeros(len(self._out))
        self._waiting = deque([0.0] * (whole + 1), whole + 2)

    def advance(self, command: float) -> None:
        """One period with this output, from the bias."""
        plant = self.plant
        self._waiting.append(self._actuated(command))
        old, new = self._waiting[0], self._waiting[1]
        for (kept, driven), position in ((self._before, old), (self._after, new)):
            self._x = kept @ self._x + driven * position
        self._disturbance += plant.drift * plant.dt
        if plant.walk:
            self._disturbance += plant.walk * plant.dt**0.5 * self.random.standard_normal()

    def measured(self) -> float:
        noise = self.plant.noise * self.random.standard_normal() if self.plant.noise else 0.0
        return float(self._out @ self._x) + self._disturbance + noise

    def _actuated(self, command: float) -> float:
        plant = self.plant
        if abs(command - self._stem) >= plant.stiction:
            self._stem = command
        half = plant.backlash / 2.0
        self._position = min(max(self._position, self._stem - half), self._stem + half)
        found = min(max(self._position, -plant.saturation), plant.saturation)
        return float(np.sign(found) * max(abs(found) - plant.dead_band, 0.0))
