"""umo, Universal Mechatronic Objects: the object layer between device drivers and control software.

Declare a machine's actuators and sensors, wire each to a driver's channel in a TOML file, and write control
code that does not depend on the circuits. After Muir and Horner, "Mechatronic objects for
real-time control software development" (1998).

Here is what every program needs. The rest has a module each: two-state types `umo.states`, errors `umo.errors`, control
laws and axes `umo.control`, what a driver needs `umo.drivers`, what tests need `umo.testing`.
"""

from umo.cycle import Frame, connect, drive, run
from umo.errors import TaskFailed, UmoError
from umo.frames import published
from umo.objects import (
    BinaryActuator,
    BinarySensor,
    Compound,
    DigitalActuator,
    DigitalSensor,
    Interlock,
    LookupTable,
    Number,
    Polynomial,
    Quality,
    Range,
    Thermocouple,
    Vector,
    action,
)
from umo.process import RunFailed, Started, start
from umo.remote import attach
from umo.wiring import check

__all__ = [
    "BinaryActuator",
    "BinarySensor",
    "Compound",
    "DigitalActuator",
    "DigitalSensor",
    "Frame",
    "Interlock",
    "LookupTable",
    "Number",
    "Polynomial",
    "Quality",
    "Range",
    "RunFailed",
    "Started",
    "TaskFailed",
    "Thermocouple",
    "UmoError",
    "Vector",
    "action",
    "attach",
    "check",
    "connect",
    "drive",
    "published",
    "run",
    "start",
]
