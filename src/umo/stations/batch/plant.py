"""The batch plant's hardware as a driver: hopper, valves and reactors behind the five functions, in raw integers.

| channel | direction, bits | meaning of the level |
| --- | --- | --- |
| inlet:N | output, 1 | 1 = open: raw material N (0, 1) flows into the hopper |
| outlet:N | output, 1 | 1 = open: the hopper empties towards reactor N (0, 1), if its feed valve is open |
| waste | output, 1 | 1 = open: the hopper empties to the waste |
| scale | input, 16 signed | load of the hopper, 0.01 kg a count |
| feed:N, drain:N | output, 1 | 1 = open |
| stirrer:N | output, 16 | speed, 0.1 rpm a count |
| heater:N | output, 16 | duty, 0.1 % a count |
| thermometer:N | input, 16 signed | 0.01 degC a count |
| level:N | input, 16 signed | 0.1 l a count |
| tick | input, 31 | the timer: lets one period pass, returns 0 |

Time constants: valves 0.15 s, stirrer 1 s, heater (120 kW) 8 s, thermometer 4 s, scale 0.3 s. Raw materials come at 2.0
and 1.5 kg/s, the hopper empties at 5 kg/s, a reactor at 4 kg/s. `seed` decides the spread of flows and heaters (5 %),
and the noise. No channel carries the data of `report`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import ceil, exp
from random import Random
from typing import Any

from umo.drivers import Channel, ChannelError, Direction, Driver, IntArray, Reports

from .batch_recipes import BatchRecipe, in_words
from .vessel import MATERIALS, POWER, Vessel, let_out, valve_share

IN, OUT = Direction.INPUT, Direction.OUTPUT
REACTORS = 2
KINDS = {
    **dict.fromkeys(("inlet", "outlet", "feed", "drain"), (OUT, 1, False)),
    **dict.fromkeys(("stirrer", "heater"), (OUT, 16, False)),
    **dict.fromkeys(("thermometer", "level"), (IN, 16, True)),
}
CHANNELS = {f"{kind}:{n}": Channel(f"{kind}:{n}", *about) for kind, about in KINDS.items() for n in range(REACTORS)}
CHANNELS |= {"waste": Channel("waste", OUT, 1), "scale": Channel("scale", IN, 16, signed=True)}
CHANNELS |= {"tick": Channel("tick", IN, 31)}
INLETS, OUTLETS = [f"inlet:{n}" for n in range(MATERIALS)], [f"outlet:{n}" for n in range(REACTORS)]
VESSEL_OUTPUTS = [(f"feed:{n}", f"drain:{n}", f"stirrer:{n}", f"heater:{n}") for n in range(REACTORS)]
VESSEL_INPUTS = [(f"thermometer:{n}", f"level:{n}") for n in range(REACTORS)]
INFLOWS, DISCHARGE = (2.0, 1.5), 5.0
"""Flows of the raw materials into the hopper, and out of it, kg/s."""
SCALE_LAG = 0.3
"""Time constant of the scale, s."""
MAX_STEP = 0.1


class Plant(Driver, Reports):
    """The batch plant, simulated. When the plant is opened again, it is as full and as warm as before.

    Options:
        seed: decides the spread of flows and heaters, and the noise.
    """

    simulates_time = True

    def __init__(self, *, seed: int = 0) -> None:
        self._random = random = Random(seed)
        self.levels = dict.fromkeys(CHANNELS, 0)
        self.vessels = [Vessel(POWER * random.uniform(0.95, 1.05)) for _ in range(REACTORS)]
        self.hopper = [0.0] * MATERIALS
        """The load of the hopper, kg of each raw material."""
        self._inflows = [flow * random.uniform(0.95, 1.05) for flow in INFLOWS]
        self._inlets, self._outlets, self._waste = [0.0] * MATERIALS, [0.0] * REACTORS, 0.0
        self._load = 0.0  # as the scale follows it
        self.good: list[tuple[int, BatchRecipe]] = []
        """The good batches that were drained: reactor and recipe."""
        self.wrong = 0
        """Number of other batches that were drained."""
        self.wasted = 0.0  # kg
        self.deviation = 0.0  # largest of an amount in a good batch, kg
        self._measure()

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.advance()
        return self.levels[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        channel.check(raw)
        self.levels[channel.text] = raw

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        for place, channel in enumerate(channels):
            out[place] = self.read(channel)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        levels = self.levels
        for channel, raw in zip(channels, raws.tolist(), strict=True):
            if raw != levels[channel.text] or channel.direction is IN:
                self.write(channel, raw)

    def advance(self, periods: int = 1) -> None:
        """Simulate a number of periods with the present levels."""
        span = periods * (self.period or MAX_STEP)
        steps = ceil(span / MAX_STEP - 1e-9)
        for _ in range(steps):
            self._step(span / steps)
        self._measure()

    def _step(self, dt: float) -> None:
        levels = self.levels
        self._move_valves(dt)
        for (feed, drain, stirrer, heater), vessel in zip(VESSEL_OUTPUTS, self.vessels, strict=True):
            vessel.move(
                feed=levels[feed],
                drain=levels[drain],
                stirrer=levels[stirrer] / 10.0,
                heater=levels[heater] / 1000.0,
                dt=dt,
            )
        self._weigh(dt)
        for n, vessel in enumerate(self.vessels):
            vessel.warm(dt)
            if vessel.empty(dt):
                self._judge(n, vessel)

    def _move_valves(self, dt: float) -> None:
        """Move the valves of the charging line."""
        levels, share = self.levels, valve_share(dt)
        self._waste += (levels["waste"] - self._waste) * share
        for valves, names in ((self._inlets, INLETS), (self._outlets, OUTLETS)):
            for n, name in enumerate(names):
                valves[n] += (levels[name] - valves[n]) * share

    def _weigh(self, dt: float) -> None:
        """Let raw materials flow into the hopper, and its load through the open outlets. The scale follows."""
        for n, flow in enumerate(self._inflows):
            self.hopper[n] += flow * self._inlets[n] * dt
        for n, vessel in enumerate(self.vessels):
            vessel.charge(let_out(self.hopper, DISCHARGE * min(self._outlets[n], vessel.feed), dt))
        self.wasted += sum(let_out(self.hopper, DISCHARGE * self._waste, dt))
        self._load += (sum(self.hopper) - self._load) * (1.0 - exp(-dt / SCALE_LAG))

    def _judge(self, number: int, vessel: Vessel) -> None:
        """Judge a batch that has left its reactor."""
        recipe = vessel.made()
        if recipe is None:
            self.wrong += 1
        else:
            self.deviation = max(self.deviation, vessel.deviation(recipe))
            self.good.append((number, recipe))
        vessel.begin()

    def _measure(self) -> None:
        noise, levels = self._random.gauss, self.levels
        levels["scale"] = round((self._load + noise(0.0, 0.02)) / 0.01)
        for (thermometer, level), vessel in zip(VESSEL_INPUTS, self.vessels, strict=True):
            levels[thermometer] = round(min(vessel.sensed + noise(0.0, 0.03), 300.0) / 0.01)
            levels[level] = round((vessel.volume + noise(0.0, 0.1 + vessel.speed / 500.0)) / 0.1)

    # Truth, for tests and observers -------------------------------------------------------------

    def report(self) -> dict[str, Any]:
        """Return a report on the batches that left the reactors: the number of good batches by recipe, the number of
        other batches, the largest deviation of an amount in a good batch, and the amount of waste."""
        return {
            "batches_good": len(self.good),
            "good": in_words(Counter(recipe.name for _, recipe in self.good)),
            "batches_wrong": self.wrong,
            "largest_deviation_kg": round(self.deviation, 2),
            "wasted_kg": round(self.wasted, 1),
        }
