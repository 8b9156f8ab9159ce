"""The objects that are measured, the same for all four implementations.

The mix is that of the z-theta station (the paper's Listing 5 and Figure 4): of 13 objects 8 are actuators, 1 digital
and 7 binary, and 5 are sensors, 4 digital and 1 binary, in a z axis, a theta axis, a counterweight, a gripper and the
manipulator that holds them. More objects are more manipulators, the last one cut off after as many groups as fit.
Two changes make the work larger and let every row do the same: all objects are synchronous, and a counter stands where
the station has its timer (that is a 14th object here, not counted and not read).
"""

from __future__ import annotations

import random
from dataclasses import dataclass

SIZES = (13, 100, 1_000, 10_000)
GROUPS = (
    ("z", 1, 2),
    ("theta", 1, 3),
    ("counterweight", 1, 1),
    ("gripper", 1, 1),
    ("solenoid", 0, 1),
    ("counter", 1, 0),
)
"""A manipulator's groups in order: name, number of sensors, number of actuators."""
RAW_RANGES = ((43_689, 59_625), (-939_000, 80_000), (0, 1_000), (0, 1), (0, 99_999))
"""What a manipulator's sensors read, all within the declared ranges."""


@dataclass(frozen=True)
class Layout:
    """How a number of objects divides up."""

    count: int
    manipulators: int
    """Whole ones."""
    rest: tuple[str, ...]
    """Names of the groups of the last, partial one."""
    sensors: int
    actuators: int


def layout(count: int) -> Layout:
    """ValueError for a count that would cut a group in two."""
    manipulators, left = divmod(count, 13)
    rest = []
    sensors, actuators = 5 * manipulators, 8 * manipulators
    for name, inputs, outputs in GROUPS:
        if left <= 0:
            break
        rest.append(name)
        sensors, actuators, left = sensors + inputs, actuators + outputs, left - inputs - outputs
    if left:
        raise ValueError(f"{count} objects cut a group in two")
    return Layout(count, manipulators, tuple(rest), sensors, actuators)


def readings(plan: Layout, seed: int = 1) -> list[int]:
    """Raw integers for every sensor, in declared order."""
    chance = random.Random(seed)
    return [chance.randint(*RAW_RANGES[i % 5]) for i in range(plan.sensors)]


def commands(plan: Layout, seed: int = 1) -> list[float]:
    """A value for every actuator, in declared order: volts where i % 8 == 0, else 0.0 or 1.0."""
    chance = random.Random(seed)
    return [chance.uniform(-10.0, 10.0) if i % 8 == 0 else float(chance.randint(0, 1)) for i in range(plan.actuators)]
