"""The twin of the conveyor: parts on the belt as detected by the entry barrier, barriers, diverter and lamps.

Places along x are those of `tracking.Tracking`, from the entry barrier, in m. A part that the diverter pushes off is
drawn up to the diverter, because no object shows which part it was.
"""

from umo.plant.twin import Body, Carried, Colour, Cuboid, Cylinder, Slide, Sphere, Twin, Viewpoint, turned

from .control import Conveyor

FRAME, BELT, STEEL, DARK = "#59636e", "#30363d", "#b6bec8", "#3a4048"
GREEN, RED = "#2ea043", "#e5342b"
TOP = 0.2
"""Height of the belt, m."""
LEG = TOP - 0.05
START, END = -0.15, 0.6


def twin(machine: Conveyor) -> Twin:
    diverter, exit_at = machine.sorter.diverter_at / 1000.0, machine.sorter.distance / 1000.0
    middle, length = (START + END) / 2, END - START
    return Twin(
        [
            Body("frame", [
                Cuboid((length, 0.16, 0.03), position=(middle, 0, TOP - 0.04), colour=FRAME),
                *(Cuboid((0.03, 0.14, LEG), position=(x, 0, LEG / 2), colour=FRAME) for x in (-0.1, 0.55)),
            ]),
            Body("belt", [Cuboid((length, 0.12, 0.02), position=(middle, 0, TOP - 0.01), colour=BELT)]),
            Body("part", position=(0, 0, TOP), drives=[
                Carried("sorter.entry", "COVERED", speed="sorter.belt.speed", over=diverter + 0.02, size=(0.06, 0.04)),
            ]),
            _barrier("entry", 0.0),
            _barrier("exit", exit_at),
            Body("diverter", [Cuboid((0.05, 0.02, 0.05)), Cylinder(0.006, 0.1, rotation=turned((1, 0, 0), 90),
                                                                position=(0, 0.06, 0), colour=STEEL)],
                 position=(diverter, 0.09, TOP + 0.03),
                 drives=[Slide("sorter.diverter", axis=(0, -1, 0), scale=0.08),
                         Colour("sorter.diverter", {"OFF": STEEL, "ON": "#f0a020"}, shape=0)]),
            Body("chute", [Cuboid((0.1, 0.16, 0.008), rotation=turned((1, 0, 0), 30), colour=STEEL)],
                 position=(diverter, -0.15, TOP - 0.06)),
            Body("drive", [Cylinder(0.035, 0.1, rotation=turned((1, 0, 0), 90))], position=(0.55, 0.14, TOP - 0.05),
                 drives=[Colour("sorter.belt.run", {"OFF": DARK, "ON": GREEN})]),
            Body("speed", [Cuboid((0.02, 0.004, 0.03))], position=(0.55, -0.083, TOP - 0.04),
                 drives=[Colour("sorter.belt.speed", {0: DARK, 1: GREEN})]),
            Body("emergency stop", [Sphere(0.018),
                                    Cuboid((0.05, 0.02, 0.05), position=(0, 0.015, 0), colour="#e8c21c")],
                 position=(-0.1, -0.1, TOP - 0.03),
                 drives=[Colour("sorter.emergency_stop", {"CLOSED": "#8b1a14", "OPEN": "#ff4a3d"}, shape=0)]),
        ],
        view=Viewpoint((0.55, -0.85, 0.75), (0.24, 0, 0.17)),
    )  # fmt: skip


def _barrier(name: str, place: float) -> Body:
    """Two posts, and the beam between them: red while it is covered."""
    beam = Cylinder(0.002, 0.15, position=(0, 0, TOP + 0.02), rotation=turned((1, 0, 0), 90))
    posts = (Cuboid((0.015, 0.015, 0.1), position=(0, y, TOP), colour=DARK) for y in (-0.08, 0.08))
    return Body(
        name,
        [beam, *posts],
        position=(place, 0, 0),
        drives=[Colour(f"sorter.{name}", {"CLEAR": GREEN, "COVERED": RED}, shape=0)],
    )
