"""A machine that makes one batch after another, for the tests of recipes. A batch takes half a second."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from umo import Compound, DigitalActuator, DigitalSensor, Number
from umo.control import wait
from umo.operation.recipe_book import RecipeBook
from umo.operation.recipes import Recipe

FOLDER = Path(__file__).parent / "brewing_recipes"
WIRING: dict[str, Any] = {
    "drivers": {"clock": {"type": "timerfd"}, "circuit": {"type": "simulated"}},
    "wire": {"timer": {"driver": "clock", "period": "10 ms"}, "heater": {"driver": "circuit"}},
    "process": {"hang_timeout": "5 s"},
}


class Brew(Recipe):
    heat: Annotated[float, Number("percent", 0.0, 100.0)]


class Brewer(Compound):
    timer: DigitalSensor
    heater: DigitalActuator

    def setup(self) -> None:
        self.book = RecipeBook(Brew, FOLDER)


def machine() -> Brewer:
    return Brewer(
        timer=DigitalSensor("sampling_period", minimum=0.0, maximum=99_999.9, resolution=1.0, synchronous=False),
        heater=DigitalActuator("percent", default=0.0, minimum=0.0, maximum=100.0, resolution=0.1),
    )


async def main(m: Brewer) -> dict[str, Any]:
    """Batches until one was made by the recipe "end"."""
    m.book.begin()
    while (recipe := m.book.next("mild")).name != "end":
        m.heater.write(recipe.heat)
        await wait(0.5)
        assert m.book.current is recipe
    return {"recipes": m.book.record}
