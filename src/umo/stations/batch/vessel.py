"""A simulated reactor: its content, its temperature, and the quality of the batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp

from .batch_recipes import AMOUNT_TOLERANCE, BOOK, STIRRING_TOLERANCE, TEMPERATURE_TOLERANCE, BatchRecipe

MATERIALS = 2
POWER, LOSS, HEAT, WALL, AMBIENCE = 120.0, 0.2, 4.0, 20.0, 20.0
"""The power of the heater in kW, the loss to the surroundings in kW/K, the heat capacity of a kg of material and that
of the vessel in kJ/K, and the temperature of the surroundings in degC."""
DENSITIES = (1.0, 0.9)
"""Densities of the raw materials, kg/l."""
VALVE_LAG, STIRRER_LAG, HEATER_LAG, THERMOMETER_LAG = 0.15, 1.0, 8.0, 4.0
"""Time constants, s."""
DRAIN, LAST = 4.0, 0.5
"""Flow through the drain, kg/s, and time constant of the flow when the vessel is nearly empty, s."""
TRACE = 0.3
"""Content below which the vessel counts as empty, kg."""


@dataclass(eq=False)
class Vessel:
    """A reactor and its content."""

    power: float
    """Power of the heater at full duty, kW."""
    amounts: list[float] = field(default_factory=lambda: [0.0] * MATERIALS)
    """Content, kg of each raw material."""
    temperature: float = AMBIENCE
    sensed: float = AMBIENCE
    heat: float = 0.0  # of the heater, kW
    speed: float = 0.0  # rpm
    feed: float = 0.0  # of the valves, 0 (closed) to 1 (open)
    drain: float = 0.0
    charged: list[float] = field(default_factory=lambda: [0.0] * MATERIALS)
    """The amounts that have come in since the vessel was empty, kg."""
    held: dict[str, float] = field(default_factory=lambda: dict.fromkeys(BOOK, 0.0))
    """The longest time at the temperature and speed of each recipe since the vessel was empty, s."""
    holding: dict[str, float] = field(default_factory=lambda: dict.fromkeys(BOOK, 0.0))

    @property
    def content(self) -> float:
        """The mass of the content, kg."""
        return self.amounts[0] + self.amounts[1]

    @property
    def volume(self) -> float:
        """The volume of the content, l."""
        return self.amounts[0] / DENSITIES[0] + self.amounts[1] / DENSITIES[1]

    def move(self, *, feed: int, drain: int, stirrer: float, heater: float, dt: float) -> None:
        """Let valves, stirrer (rpm) and heater (0 to 1) follow their levels for a time in s."""
        share = valve_share(dt)
        self.feed += (feed - self.feed) * share
        self.drain += (drain - self.drain) * share
        self.speed += (stirrer - self.speed) * dt / STIRRER_LAG
        self.heat += (self.power * min(heater, 1.0) - self.heat) * dt / HEATER_LAG

    def charge(self, amounts: Sequence[float]) -> None:
        """Add raw materials in kg, at the temperature of the ambience."""
        before = WALL + HEAT * self.content
        held, charged = self.amounts, self.charged
        for number, amount in enumerate(amounts):
            held[number] += amount
            charged[number] += amount
        after = WALL + HEAT * self.content
        self.temperature = AMBIENCE + (self.temperature - AMBIENCE) * before / after

    def warm(self, dt: float) -> None:
        """Compute the heat balance for a time in s. This time counts for the recipes with the present temperature and
        speed."""
        flow = self.heat - LOSS * (self.temperature - AMBIENCE)
        self.temperature += flow * dt / (WALL + HEAT * self.content)
        self.sensed += (self.temperature - self.sensed) * dt / THERMOMETER_LAG
        holding = self.holding
        for name, recipe in BOOK.items():
            if (
                abs(self.temperature - recipe.temperature) <= TEMPERATURE_TOLERANCE
                and abs(self.speed - recipe.stirring) <= STIRRING_TOLERANCE
            ):
                holding[name] += dt
                self.held[name] = max(self.held[name], holding[name])
            else:
                holding[name] = 0.0

    def empty(self, dt: float) -> bool:
        """Let the content out through the drain for a time in s. Return True if it has become empty."""
        had = self.content
        let_out(self.amounts, DRAIN * self.drain, dt)
        return had >= TRACE > self.content

    def made(self) -> BatchRecipe | None:
        """Return the recipe for which the content is a good batch."""
        for recipe in BOOK.values():
            if self.deviation(recipe) <= AMOUNT_TOLERANCE and self.held[recipe.name] >= recipe.hold:
                return recipe
        return None

    def deviation(self, recipe: BatchRecipe) -> float:
        """Return the largest deviation of an amount from the recipe, kg."""
        return max(abs(had - wanted) for had, wanted in zip(self.charged, recipe.amounts, strict=True))

    def begin(self) -> None:
        """Begin another batch, to which all material from now on belongs."""
        self.charged = [0.0] * MATERIALS
        self.held, self.holding = dict.fromkeys(BOOK, 0.0), dict.fromkeys(BOOK, 0.0)


def valve_share(dt: float) -> float:
    """Return the share of its way that a valve moves in a time in s."""
    return 1.0 - exp(-dt / VALVE_LAG)


def let_out(amounts: list[float], flow: float, dt: float) -> list[float]:
    """Return the amounts of each raw material that leave at a flow (kg/s) in a time (s); the flow is slower when little
    is left."""
    first, second = amounts
    content = first + second
    share = min(flow * dt / content, flow / (DRAIN * LAST) * dt, 1.0) if content > 0.0 else 0.0
    out = [first * share, second * share]
    amounts[:] = first - out[0], second - out[1]
    return out
