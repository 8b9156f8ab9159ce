"""Twins: a machine in 3D that moves with the values of its objects. A station declares its twin in twin.py:

def twin(machine: Press) -> Twin:
    return Twin([Body("ram", [Box((0.1, 0.1, 0.3))], drives=[Slide("ram.position", axis=(0, 0, -1))])])
"""

from umo.twin.drives import Carried, Colour, Drive, Hinge, Joint, Slide, Visible
from umo.twin.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Shape, Sphere, turned
from umo.twin.station import twin_of
from umo.twin.twin import Body, Twin, View

__all__ = [
    "Body",
    "Box",
    "Capsule",
    "Carried",
    "Colour",
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
    "View",
    "Visible",
    "turned",
    "twin_of",
]
