"""The recipes of the batch plant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from umo.errors import OptionError
from umo.text import did_you_mean


@dataclass(frozen=True)
class Recipe:
    """What a batch is made of, and how."""

    name: str
    amounts: tuple[float, float]
    """Of the raw materials A and B, kg."""
    temperature: float
    """degC."""
    hold: float
    """Time for which it is kept at its temperature, s."""
    stirring: float
    """Speed of the stirrer, rpm."""


BOOK = {
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


def chosen(names: str) -> Sequence[Recipe]:
    """The recipes of a text such as "glue, soap". OptionError for an unknown name, or if there is none."""
    found = [name.strip() for name in names.split(",") if name.strip()]
    for name in found:
        if name not in BOOK:
            raise OptionError(f"--recipes: no recipe {name!r}{did_you_mean(name, BOOK)}; there are: {', '.join(BOOK)}")
    if not found:
        raise OptionError(f"--recipes names none; there are: {', '.join(BOOK)}")
    return [BOOK[name] for name in found]


def in_words(counts: Mapping[str, int]) -> str:
    """How many batches of which recipe: "glue 2, soap 1"."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
