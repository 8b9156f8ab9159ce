"""Twins: a machine in 3D that moves with the values of its objects. A station declares its twin in twin.py:

def twin(machine: Press) -> Twin:
    return Twin([Body("ram", [Cuboid((0.1, 0.1, 0.3))], drives=[Slide("ram.position", axis=(0, 0, -1))])])
"""

from umo.plant.twin.bodies import Body, Viewpoint
from umo.plant.twin.declared import declares_twin, place_of, twin_of
from umo.plant.twin.drives import Carried, Colour, Drive, Hinge, Joint, Slide, Visible
from umo.plant.twin.shapes import Capsule, Cuboid, Cylinder, Ellipsoid, Mesh, Shape, Sphere, turned
from umo.plant.twin.twin import Twin

__all__ = [
    "Body",
    "Capsule",
    "Carried",
    "Colour",
    "Cuboid",
    "Cylinder",
    "Drive",
    "Ellipsoid",
    "Hinge",
    "Joint",
    "Mesh",
    "Shape",
    "Slide",
    "Sphere",
    "Twin",
    "Viewpoint",
    "Visible",
    "declares_twin",
    "place_of",
    "turned",
    "twin_of",
]
