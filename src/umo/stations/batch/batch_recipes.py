"""The recipes of the batch plant: recipes/*.toml."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from umo import Number
from umo.operation.recipes import Recipe, read_recipes

Name = Literal["glue", "paint", "soap"]
FOLDER = Path(__file__).parent / "recipes"


class BatchRecipe(Recipe):
    """A recipe of a batch: materials and steps."""

    amounts: Annotated[tuple[float, float], Number("kg", 5.0, 60.0)]
    """The amounts of the raw materials A and B, kg."""
    temperature: Annotated[float, Number("degC", 20.0, 95.0)]
    """The temperature of the batch, degC."""
    hold: Annotated[float, Number("s", 0.0, 3600.0)]
    """Time for which the batch is kept at its temperature, s."""
    stirring: Annotated[float, Number("rpm", 0.0, 150.0)]
    """Speed of the stirrer, rpm."""


BOOK = read_recipes(BatchRecipe, FOLDER)
"""All recipes by name. The plant judges a batch by them."""
AMOUNT_TOLERANCE, TEMPERATURE_TOLERANCE, STIRRING_TOLERANCE = 0.5, 2.0, 5.0
"""The deviations that a good batch may have: of each amount, in kg; and, while the batch is held, of the temperature in
K and of the speed in rpm."""


def in_words(counts: Mapping[str, int]) -> str:
    """Return the number of batches of each recipe as text, such as "glue 2, soap 1"."""
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))
