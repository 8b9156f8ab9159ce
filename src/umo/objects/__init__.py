"""The parts from which a machine is declared: the four atomic objects, compounds, units, ranges and linearizations, and
their values as text (`objects.presentation`). This package knows neither the time of a period nor the driver of an
object."""

from umo.objects.action import Action, action, actions_of
from umo.objects.actuators import Actuator, BinaryActuator, DigitalActuator
from umo.objects.atomic import Atomic, Binary, Digital
from umo.objects.compound import Compound
from umo.objects.description import described
from umo.objects.interlock import Interlock
from umo.objects.linearization import LookupTable, Polynomial
from umo.objects.node import Node
from umo.objects.numbers import MachineNumber, numbers_of
from umo.objects.paths import atoms, children, find, path_of, walk
from umo.objects.quality import Quality
from umo.objects.range import Number, Range
from umo.objects.sensors import BinarySensor, DigitalSensor, Sensor
from umo.objects.thermocouple import Thermocouple
from umo.objects.vector import Vector

__all__ = [
    "Action",
    "Actuator",
    "Atomic",
    "Binary",
    "BinaryActuator",
    "BinarySensor",
    "Compound",
    "Digital",
    "DigitalActuator",
    "DigitalSensor",
    "Interlock",
    "LookupTable",
    "MachineNumber",
    "Node",
    "Number",
    "Polynomial",
    "Quality",
    "Range",
    "Sensor",
    "Thermocouple",
    "Vector",
    "action",
    "actions_of",
    "atoms",
    "children",
    "described",
    "find",
    "numbers_of",
    "path_of",
    "walk",
]
