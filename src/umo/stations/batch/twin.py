"""The twin of the batch plant: the hopper above, two reactors below it, their contents, and every valve. The content of
a vessel is a column that rises out of its base, which hides the unfilled part.
"""

from collections.abc import Iterator, Mapping
from math import atan2, degrees, hypot

from umo.plant.twin import Body, Colour, Cuboid, Cylinder, Slide, Sphere, Twin, Viewpoint, turned

from .control import BatchPlant

STEEL, DARK, GLASS, FRAME = "#b6bec8", "#3a4048", "#dfe7ee", "#59636e"
GREEN, AMBER = "#2ea043", "#f0a020"
WARMTH: Mapping[float, str] = {20: "#3f7fc4", 40: "#8a6fb0", 60: "#d1602f", 80: "#e5342b"}
"""Colours of a reactor's content by its temperature, degC."""
BASE, HEIGHT, RADIUS = 0.9, 0.8, 0.32
"""The measures of a reactor in m: height of its base, height and radius of the vessel above it. 150 l fill the
vessel."""
LITRE = HEIGHT / 150.0
"""Rise of the content for a litre, m."""
HOPPER, HOPPER_HEIGHT, KILOGRAM = 2.8, 0.4, 0.4 / 100.0
"""The measures of the hopper in m: height of its bottom, its height, and the rise of its load for a kg."""
DISTANCE = 1.1
"""Distance of the reactors from the middle, m."""


Coordinates = tuple[float, float, float]


def twin(machine: BatchPlant) -> Twin:
    places = [DISTANCE * (2 * number - 1) for number in range(len(machine.reactors))]
    bodies = [*_line(len(machine.line.inlets)), *(body for n, x in enumerate(places) for body in _reactor(n, x))]
    return Twin([_frame(), *bodies], view=Viewpoint((0.0, -6.6, 2.7), (0.0, 0.0, 1.75)))


def _frame() -> Body:
    posts = (Cuboid((0.06, 0.06, HOPPER), position=(x, 0.45, HOPPER / 2), colour=FRAME) for x in (-0.45, 0.45))
    beam = Cuboid((0.96, 0.5, 0.06), position=(0, 0.22, HOPPER - 0.12), colour=FRAME)
    return Body("frame", [*posts, beam])


def _line(inlets: int) -> Iterator[Body]:
    yield Body(
        "load",
        [Cylinder(0.26, HOPPER_HEIGHT, position=(0, 0, -HOPPER_HEIGHT / 2), colour="#c9a26b")],
        position=(0, 0, HOPPER),
        drives=[Slide("line.scale", axis=(0, 0, 1), scale=KILOGRAM, per="kg", range=(0.0, HOPPER_HEIGHT))],
    )
    yield Body(
        "hopper",
        [
            Cylinder(0.29, HOPPER_HEIGHT + 0.02, position=(0, 0, -0.21), colour=STEEL),
            Cylinder(0.28, HOPPER_HEIGHT, position=(0, 0, HOPPER_HEIGHT / 2), colour=GLASS, opacity=0.25),
        ],
        position=(0, 0, HOPPER),
    )
    for number in range(inlets):
        x = 0.3 * (number - (inlets - 1) / 2)
        yield _valve(f"line.inlets.{number}", (x, 0, HOPPER + 0.7), (x, 0, HOPPER + 0.95), (x, 0, HOPPER + 0.45))
    yield _valve("line.waste", (0, 0, HOPPER - 0.65), (0, 0, HOPPER - 0.4), (0, 0, HOPPER - 0.95))


def _reactor(number: int, x: float) -> Iterator[Body]:
    name = f"reactors.{number}"
    top = BASE + HEIGHT
    yield Body(
        f"{name} content",
        [Cylinder(RADIUS - 0.02, HEIGHT, position=(0, 0, -HEIGHT / 2))],
        position=(x, 0, BASE),
        drives=[
            Slide(f"{name}.level", axis=(0, 0, 1), scale=LITRE, per="l", range=(0.0, HEIGHT)),
            Colour(f"{name}.temperature", WARMTH),
        ],
    )
    yield Body(
        name,
        [
            Cylinder(RADIUS + 0.01, BASE - 0.02, position=(0, 0, BASE / 2 - 0.01), colour=STEEL),
            Cylinder(RADIUS, HEIGHT, position=(0, 0, BASE + HEIGHT / 2), colour=GLASS, opacity=0.25),
            Cylinder(RADIUS + 0.02, 0.04, position=(0, 0, top), colour=STEEL),
            Cylinder(0.015, HEIGHT, position=(0, 0, BASE + HEIGHT / 2 + 0.05), colour=STEEL),
        ],
        position=(x, 0, 0),
    )
    yield Body(
        f"{name} heater",
        [Cylinder(RADIUS + 0.03, 0.12, position=(0, 0, BASE - 0.1))],
        position=(x, 0, 0),
        drives=[Colour(f"{name}.heater", {0: DARK, 100: "#ff7a1a"})],
    )
    yield Body(
        f"{name} stirrer",
        [Cylinder(0.09, 0.2)],
        position=(x, 0, top + 0.14),
        drives=[Colour(f"{name}.stirrer", {0: DARK, 120: GREEN})],
    )
    yield _valve(f"{name}.drain", (x, -RADIUS - 0.16, 0.22), (x, -RADIUS, 0.22), (x, -RADIUS - 0.3, 0.22))
    feed = x * 0.82
    yield _valve(f"line.outlets.{number}", (x * 0.5, 0, 2.41), (x * 0.15, 0, 2.55), (feed, 0, 2.28))
    yield _valve(f"{name}.feed", (feed, 0, 2.02), (feed, 0, 2.3), (feed, 0, top))


def _valve(path: str, place: Coordinates, start: Coordinates, end: Coordinates) -> Body:
    """Return a valve on its pipe, which is bright while it is open."""
    x, y, z = (b - a for a, b in zip(start, end, strict=True))
    middle = [(a + b) / 2 - c for a, b, c in zip(start, end, place, strict=True)]
    turn = turned((1, 0, 0), 90) if y else turned((0, 1, 0), degrees(atan2(x, z)))
    pipe = Cylinder(0.03, hypot(x, y, z), position=middle, rotation=turn, colour=STEEL)
    return Body(
        path, [Sphere(0.07), pipe], position=place, drives=[Colour(path, {"CLOSED": DARK, "OPEN": AMBER}, shape=0)]
    )
