"""The recipes of the batch plant."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Name = Literal["glue", "paint", "soap"]


@dataclass(frozen=True)
class Recipe:
    """What a batch is made of, and how."""

    name: Name
    amounts: tuple[float, float]
    """Of the raw materials A and B, kg."""
    temperature: float
    """degC."""
    hold: float
    """Time for which it is kept at its temperature, s."""
    stirring: float
    """Speed of the stirrer, rpm."""


BOOK: dict[Name, Recipe] = {
    recipe.name: recipe
    for recipe in (
        Recipe("glue", (40.0, 20.0), temperature=60.0, hold=60.0, stirring=90.0),
        Recipe("paint", (50.0, 10.0), temperature=50.0, hold=90.0, stirring=60.0),
        Recipe("soap", (30.0, 30.0), temperature=75.0, hold=45.0, stirring=120.0),
    )
}
"""All recipes, by name."""
AMOUNT_TOLERANCE, TEMPERATURE_TOLERANCE, STIRRING_TOLERANCE = 0.5, 2.0, 5.0
"""Deviations that a good batch may have: of each amount in kg, while it is held in K and rpm."""


def in_words(counts: Mapping[Name, int]) -> str:
    """How many batches of which recipe: "glue 2, soap 1"."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
