"""Row (d): the Python that a person would write for this machine without umo.

One class with plain attributes for each group of objects, numbers in place, one driver call for all inputs and one for
all outputs; range check on the command, scaling both ways; no quality, no time, no pending and commanded value.
The driver gets int64 arrays, as from umo.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.mix import Layout

VOLTS_PER_BIT = 10.0 / 2047


class ZAxis:
    def __init__(self) -> None:
        self.position = 0.0
        self.motor = 0
        self.zero = 0

    def sample(self, raws: Sequence[int], at: int) -> None:
        self.position = raws[at] * 4.64357 - 147_871.0

    def command(self, volts: float, zero: int) -> None:
        if not -10.0 <= volts <= 10.0:
            raise ValueError(f"{volts} V")
        self.motor = round(volts / VOLTS_PER_BIT)
        self.zero = zero

    def update(self, raws: Any, at: int) -> None:
        raws[at] = self.motor
        raws[at + 1] = self.zero

    def values(self) -> list[float]:
        return [self.position]


class ThetaAxis:
    def __init__(self) -> None:
        self.angle = 0.0
        self.step = 0
        self.direction = 0
        self.zero = 0

    def sample(self, raws: Sequence[int], at: int) -> None:
        self.angle = raws[at] * 0.000529483 + 227.4438

    def command(self, step: int, direction: int, zero: int) -> None:
        self.step = step
        self.direction = direction
        self.zero = zero

    def update(self, raws: Any, at: int) -> None:
        raws[at] = self.step
        raws[at + 1] = self.direction
        raws[at + 2] = self.zero

    def values(self) -> list[float]:
        return [self.angle]


class Vacuum:
    """Counterweight and gripper: a valve and what its pressure sensor reads."""

    def __init__(self) -> None:
        self.pressure = 0
        self.valve = 0

    def sample(self, raws: Sequence[int], at: int) -> None:
        self.pressure = raws[at]

    def command(self, valve: int) -> None:
        self.valve = valve

    def update(self, raws: Any, at: int) -> None:
        raws[at] = self.valve

    def values(self) -> list[float]:
        return [float(self.pressure)]


class Manipulator:
    def __init__(self) -> None:
        self.z = ZAxis()
        self.theta = ThetaAxis()
        self.counterweight = Vacuum()
        self.gripper = Vacuum()
        self.solenoid = 0
        self.counter = 0

    def sample(self, raws: Sequence[int], at: int) -> None:
        self.z.sample(raws, at)
        self.theta.sample(raws, at + 1)
        self.counterweight.sample(raws, at + 2)
        self.gripper.sample(raws, at + 3)
        self.counter = raws[at + 4]

    def command(
        self, volts: float, z_zero: int, step: int, direction: int, zero: int, weight: int, vacuum: int, release: int
    ) -> None:
        self.z.command(volts, z_zero)
        self.theta.command(step, direction, zero)
        self.counterweight.command(weight)
        self.gripper.command(vacuum)
        self.solenoid = release

    def update(self, raws: Any, at: int) -> None:
        self.z.update(raws, at)
        self.theta.update(raws, at + 2)
        self.counterweight.update(raws, at + 5)
        self.gripper.update(raws, at + 6)
        raws[at + 7] = self.solenoid

    def values(self) -> list[float]:
        parts = (self.z, self.theta, self.counterweight, self.gripper)
        return [value for part in parts for value in part.values()] + [float(self.counter)]


class Solenoid:
    """What is left of the manipulator when it is cut off there."""

    def __init__(self) -> None:
        self.valve = 0

    def sample(self, raws: Sequence[int], at: int) -> None:
        pass

    def command(self, valve: int) -> None:
        self.valve = valve

    def update(self, raws: Any, at: int) -> None:
        raws[at] = self.valve

    def values(self) -> list[float]:
        return []


PARTS: dict[str, tuple[type[Any], int, int]] = {
    "z": (ZAxis, 1, 2),
    "theta": (ThetaAxis, 1, 3),
    "counterweight": (Vacuum, 1, 1),
    "gripper": (Vacuum, 1, 1),
    "solenoid": (Solenoid, 0, 1),
}


class ByHand:
    """All manipulators of one size on one driver."""

    def __init__(self, plan: Layout, driver: Any) -> None:
        self.driver = driver
        self.inputs = tuple(driver.channel(f"in:{i}") for i in range(plan.sensors))
        self.outputs = tuple(driver.channel(f"out:{i}") for i in range(plan.actuators))
        self.raws_in = np.zeros(plan.sensors, np.int64)
        self.raws_out = np.zeros(plan.actuators, np.int64)
        self.parts: list[tuple[Any, int, int, int]] = []
        """Each part, where its inputs and its outputs start, and how many outputs it has."""
        read = written = 0
        for kind, inputs, outputs in [(Manipulator, 5, 8)] * plan.manipulators + [PARTS[name] for name in plan.rest]:
            self.parts.append((kind(), read, written, outputs))
            read, written = read + inputs, written + outputs
        self.single = self.parts[0][0] if len(self.parts) == 1 else None
        self.orders: list[tuple[Any, tuple[Any, ...]]] = []

    def prepare(self, commands: Sequence[float]) -> None:
        numbers = [value if i % 8 == 0 else int(value) for i, value in enumerate(commands)]
        self.orders = [(part, tuple(numbers[at : at + size])) for part, _, at, size in self.parts]

    def load(self, readings: Sequence[int]) -> None:
        self.driver.inputs[:] = readings

    def sample_update(self, periods: int) -> None:
        for _ in range(periods):
            self.sample()
            self.update()

    def write(self, periods: int) -> None:
        for _ in range(periods):
            for part, values in self.orders:
                part.command(*values)

    def period(self, periods: int) -> None:
        for _ in range(periods):
            self.sample()
            for part, values in self.orders:
                part.command(*values)
            self.update()

    def sample(self) -> None:
        self.driver.read_many(self.inputs, self.raws_in)
        raws = self.raws_in.tolist()
        if self.single is not None:
            self.single.sample(raws, 0)
        else:
            for part, at, _, _ in self.parts:
                part.sample(raws, at)

    def update(self) -> None:
        raws = self.raws_out
        if self.single is not None:
            self.single.update(raws, 0)
        else:
            for part, _, at, _ in self.parts:
                part.update(raws, at)
        self.driver.write_many(self.outputs, self.raws_out)

    def values(self) -> list[float]:
        return [value for part, _, _, _ in self.parts for value in part.values()]

    def raws(self) -> list[int]:
        return [int(raw) for raw in self.driver.outputs]
