"""The twin of the furnace: its zones in rows, coloured by temperature, with a heater and a fan each."""

from collections.abc import Iterator, Mapping

from umo.plant.twin import Body, Colour, Cuboid, Cylinder, Twin

from .control import Furnace

GLOW: Mapping[float, str] = {
    20: "#4a5568", 200: "#5b3a6e", 400: "#8f2d56", 600: "#d1402f", 800: "#f2802a", 1000: "#ffd34d", 1300: "#fff6d8"
}  # fmt: skip
"""Colours of a zone by its temperature, degC."""
ROW = 20
"""Number of zones in a row."""
WIDTH, DEPTH, HEIGHT, GAP = 0.22, 0.6, 0.4, 0.02
"""Size of a zone and space to the next, m."""


def twin(machine: Furnace) -> Twin:
    return Twin(body for number in range(len(machine.zones)) for body in _zone(number))


def _zone(number: int) -> Iterator[Body]:
    name, (row, column) = f"zones.{number}", divmod(number, ROW)
    place = (column * (WIDTH + GAP), row * 2 * DEPTH, 0.3)
    yield Body(
        name,
        [Cuboid((WIDTH, DEPTH, HEIGHT), position=(0, 0, HEIGHT / 2))],
        position=place,
        drives=[Colour(f"{name}.temperature", GLOW)],
    )
    yield Body(
        f"{name} heater",
        [Cuboid((WIDTH, DEPTH, 0.06), position=(0, 0, -0.06))],
        parent=name,
        drives=[Colour(f"{name}.heater", {0: "#3a4048", 100: "#ff7a1a"})],
    )
    yield Body(
        f"{name} fan",
        [Cylinder(0.07, 0.05, position=(0, 0, HEIGHT + 0.025))],
        parent=name,
        drives=[Colour(f"{name}.fan", {"OFF": "#5a636e", "ON": "#35a7ff"})],
    )
