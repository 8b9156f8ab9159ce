"""The furnace's hardware as a driver: a thermal model of n zones behind the five functions, in raw integers.

| channel | direction, bits | meaning of the level |
| --- | --- | --- |
| heater:N | output, 16 | duty of zone N, 0.1 % a count, 0 to 1000 |
| fan:N | output, 1 | 1 = on |
| thermocouple:N | input, 16 signed | type K, 2 uV a count, referred to 0 degC; 32767 = open circuit |
| tick | input, 31 | the timer: lets one period pass, returns how many were missed |

The tunnel has as many zones as the wiring requires. Each has 2 kJ/K, a heater of 16 kW, 8 W/K to the ambience of 25
degC, 4 W/K more with its fan, and 2 W/K to each neighbour; its thermocouple follows with a time constant of 1.5 s. The
time constant of a zone is about 3 minutes. `seed` determines the spread: power +-5 %, losses +-10 %, 20 to 30 degC at
the start.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.optional import Reports
from umo.errors import ChannelError, DriverError, WiringError
from umo.objects import Thermocouple
from umo.objects.scaling import FloatArray
from umo.text import did_you_mean

IN, OUT = Direction.INPUT, Direction.OUTPUT
KINDS = {"heater": (OUT, 16, False), "fan": (OUT, 1, False), "thermocouple": (IN, 16, True)}
HEATER, FAN, THERMOCOUPLE, TICK = range(4)
FORMS = ("heater:N", "fan:N", "thermocouple:N", "tick")
FAULTS = ("broken-thermocouple", "loose-thermocouple", "shorted-thermocouple", "stuck-heater", "dead-heater")
"""Faults of a zone, `KIND:ZONE` or `KIND:ZONE@SECONDS`, 60 s after the start by default: an open circuit; an open
circuit for 1 s in every 5 s; the thermocouple reads the ambience; full power regardless of the duty; no power."""
CAPACITY, POWER, LOSS, FAN_LOSS, CONDUCTION = 2000.0, 16_000.0, 8.0, 4.0, 2.0
AMBIENCE, LAG, MAX_STEP = 25.0, 1.5, 0.1
OPEN, VOLTS, TYPE_K = 0x7FFF, 0.002, Thermocouple("K")


@dataclass(frozen=True)
class FurnaceChannel(Channel):
    kind: int = TICK
    zone: int = 0


class Plant(Driver[FurnaceChannel], Reports):
    """The furnace, simulated. When the furnace is opened again, it is as hot as before.

    Options:
        seed: seed of the random spread of the zones.
        faults: the failures, as KIND:ZONE or KIND:ZONE@SECONDS, such as stuck-heater:3@90; the kinds are
            broken-thermocouple, loose-thermocouple, shorted-thermocouple, stuck-heater, dead-heater.
    """

    simulates_time = True

    def __init__(self, *, seed: int = 0, faults: Sequence[str] = ()) -> None:
        self._seed = seed
        self._faults = [_fault(text) for text in faults]
        self._count = 0
        self._places: dict[int, tuple[Sequence[FurnaceChannel], IntArray]] = {}
        self.temperatures = np.zeros(0)
        """The actual temperatures, degC."""

    # The five functions -------------------------------------------------------------------------

    def channel(self, text: str) -> FurnaceChannel:
        if text == "tick":
            return FurnaceChannel(text, IN, 31)
        name, _, zone = text.partition(":")
        if name not in KINDS or not re.fullmatch(r"0|[1-9]\d{0,4}", zone):
            raise ChannelError(text, FORMS)
        self._count = max(self._count, int(zone) + 1)
        return FurnaceChannel(text, *KINDS[name], list(KINDS).index(name), int(zone))

    def read(self, channel: FurnaceChannel) -> int:
        if channel.kind == TICK:
            self.advance()
            return 0
        if channel.kind != THERMOCOUPLE:
            raise DriverError(f"{channel.text} is an output and cannot be read")
        return int(self._levels[channel.kind, channel.zone])

    def write(self, channel: FurnaceChannel, raw: int) -> None:
        if channel.kind not in (HEATER, FAN):
            raise DriverError(f"{channel.text} is an input and cannot be written")
        self._levels[channel.kind, channel.zone] = raw

    def read_many(self, channels: Sequence[FurnaceChannel], out: IntArray) -> None:
        out[:] = self._levels.ravel()[self._of(channels)]

    def write_many(self, channels: Sequence[FurnaceChannel], raws: IntArray) -> None:
        self._levels.ravel()[self._of(channels)] = raws

    def _of(self, channels: Sequence[FurnaceChannel]) -> IntArray:
        """Return the places of these channels among the levels. The same list is passed in every period."""
        known, places = self._places.get(id(channels), ((), np.zeros(0, np.int64)))
        if known is not channels:
            if len(self._places) > 8:  # parts are moved by lists of their own, each time another
                self._places.clear()
            places = np.array([channel.kind * self._count + channel.zone for channel in channels])
            self._places[id(channels)] = channels, places
        return places

    # Opening and time ---------------------------------------------------------------------------

    def open(self) -> None:
        """Switch the circuits on. The first call also builds the furnace."""
        if len(self.temperatures) != self._count:
            self._build(self._count)
        self._places.clear()
        self._levels = np.zeros((3, self._count), np.int64)
        self._measure()

    def _build(self, count: int) -> None:
        for kind, zone, _ in self._faults:
            if zone >= count:
                raise DriverError(f"fault {kind}:{zone}: the furnace has {count} zones")
        self._random = np.random.default_rng(self._seed)
        self._full_power = POWER * self._random.uniform(0.95, 1.05, count)
        self._loss = LOSS * self._random.uniform(0.9, 1.1, count)
        self.temperatures = self._random.uniform(20.0, 30.0, count)
        self._sensed = self.temperatures.copy()
        self._time = self._energy = self._highest = 0.0

    def advance(self, periods: int = 1) -> None:
        """Simulate a number of periods with the present levels."""
        span = periods * (self.period or MAX_STEP)
        steps = ceil(span / MAX_STEP - 1e-9)
        for _ in range(steps):
            self._step(span / steps)
        self._measure()

    def _step(self, dt: float) -> None:
        self._time += dt
        duty = _within(self._levels[HEATER] / 1000.0, 0.0, 1.0)
        self._fail(duty, {"stuck-heater": 1.0, "dead-heater": 0.0})
        t, power = self.temperatures, self._full_power * duty
        losses = self._loss + FAN_LOSS * self._levels[FAN]
        flow = (t[1:] - t[:-1]) * CONDUCTION
        heat = power - losses * (t - AMBIENCE)
        heat[:-1] += flow
        heat[1:] -= flow
        self.temperatures = t + heat * (dt / CAPACITY)
        self._sensed += (self.temperatures - self._sensed) * (dt / LAG)
        self._energy += float(power.sum()) * dt
        self._highest = max(self._highest, float(self.temperatures.max()))

    def _measure(self) -> None:
        """Compute the converters' raw integers: 0.3 counts of noise, saturating below the mark of an open circuit."""
        sensed = self._sensed.copy()
        self._fail(sensed, {"shorted-thermocouple": AMBIENCE})
        counts = TYPE_K.to_inputs(sensed) / VOLTS + self._random.normal(0.0, 0.3, len(sensed))
        counts = _within(np.rint(counts), -OPEN, OPEN - 1)
        self._fail(counts, {"broken-thermocouple": OPEN})
        if self._time % 5.0 < 1.0:
            self._fail(counts, {"loose-thermocouple": OPEN})
        self._levels[THERMOCOUPLE] = counts

    def _fail(self, values: FloatArray, those: Mapping[str, float]) -> None:
        """Give each zone that has one of these faults now the value that belongs to the fault."""
        for kind, zone, start in self._faults:
            if kind in those and self._time >= start:
                values[zone] = those[kind]

    # Truth, for tests and observers -------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """Return the highest temperature so far, the range of the present temperatures, and the energy. All of them
        come from the model and not from the thermocouples."""
        last = [round(float(end), 1) for end in (self.temperatures.min(), self.temperatures.max())]
        highest, energy = round(self._highest, 1), round(self._energy / 3.6e6, 1)
        return {"highest_degC": highest, "last_degC": last, "energy_kWh": energy}


def _within(values: FloatArray, low: float, high: float) -> FloatArray:
    """Clip in place as np.clip, in a third of the time."""
    np.maximum(values, low, out=values)
    np.minimum(values, high, out=values)
    return values


def _fault(text: str) -> tuple[str, int, float]:
    """Return the kind, the zone, and the time in s at which the fault begins."""
    kind, found = text.partition(":")[0], re.fullmatch(r"[a-z-]+:(\d+)(?:@(\d+(?:\.\d+)?))?", text)
    if kind not in FAULTS:
        raise WiringError(
            f"there is no fault {kind!r}{did_you_mean(kind, FAULTS)}; the faults are: {', '.join(FAULTS)}"
        )
    if found is None:
        raise WiringError(f"fault {text!r} is not KIND:ZONE or KIND:ZONE@SECONDS, such as {kind}:7@90")
    return kind, int(found[1]), float(found[2] or 60.0)
