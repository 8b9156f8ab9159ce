"""The tank in 3D, for the tab Twin of `umo show page`. Lengths in m; values of objects are converted from their
units."""

from umo.plant.twin import Body, Colour, Cuboid, Cylinder, Slide, Sphere, Twin

from .control import Tank

VALVE = {"CLOSED": "#3a4048", "OPEN": "#2ea043"}


def twin(machine: Tank) -> Twin:
    return Twin(
        [
            Body("tank", [Cuboid((0.3, 0.3, 0.52), position=(0, 0, 0.26), colour="#b6bec8", opacity=0.25)]),
            Body("water", [Cuboid((0.28, 0.28, 0.01), colour="#2f7fd6")], drives=[Slide("level", axis=(0, 0, 1))]),
            Body("inlet", [Cylinder(0.02, 0.1)], position=(0, 0, 0.6), drives=[Colour("inlet", VALVE)]),
            Body("drain", [Cylinder(0.02, 0.1)], position=(0, 0, -0.06), drives=[Colour("drain", VALVE)]),
            Body("overflow", [Sphere(0.02)], position=(0.17, 0, 0.51),
                 drives=[Colour("overflow", {"PASS": "#3a4048", "FAIL": "#e5342b"})]),
        ]
    )  # fmt: skip
