"""Many zones under PI on Vectors against the same in plain numpy by hand.

A period is `sample`, the law, `update`: temperatures from raw integers, errors, integrals, duties within their ranges,
raw integers. By hand: the same operations on the same arrays of the same driver, with the range check of the readings;
no quality, no time, no pending and commanded values, and one set of objects fixed for ever. tests/project/test_bench.py
shows that both give the same raw integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from statistics import median
from typing import Any

import numpy as np

from bench.driver import Fill
from bench.scan import Case, Figure, quiet, take_turns
from umo import Compound, DigitalActuator, DigitalSensor, Thermocouple, Vector, connect
from umo.control import VectorServo

ZONES = 1000
DT, GAIN, INTEGRAL_TIME, SETPOINT = 0.1, 0.5, 40.0, 800.0
LIMITS = (0.0, 1300.0)
KINDS = {"linear": (0.1, None), "type K": (0.002, Thermocouple("K"))}
"""Resolution (degC or mV) and linearization of the temperatures."""


class HeatedZone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor


class Tunnel(Compound):
    zones: list[HeatedZone]


class OnVectors:
    """umo, as a program would use it."""

    def __init__(self, count: int, kind: str) -> None:
        resolution, linearization = KINDS[kind]
        scale: dict[str, Any] = {"resolution": resolution, "linearization": linearization}
        self.tunnel = Tunnel(
            zones=[
                HeatedZone(
                    heater=DigitalActuator("percent", default=0, minimum=0, maximum=100, resolution=0.1),
                    temperature=DigitalSensor("degC", minimum=LIMITS[0], maximum=LIMITS[1], **scale),
                )
                for _ in range(count)
            ]
        )
        zones = self.tunnel.zones
        sensors, heaters = Vector(z.temperature for z in zones), Vector(z.heater for z in zones)
        self.law = VectorServo(sensors, heaters, gain=GAIN, integral_time=INTEGRAL_TIME)
        self.driver = Fill(count, count)
        wire = {f"zones.{i}.temperature": {"driver": "box", "channel": f"in:{i}"} for i in range(count)}
        wire |= {f"zones.{i}.heater": {"driver": "box", "channel": f"out:{i}"} for i in range(count)}
        self.connection = connect(self.tunnel, {"drivers": {"box": self.driver}, "wire": wire})
        self.connection.__enter__()

    def close(self) -> None:
        self.connection.__exit__(None, None, None)

    def period(self, periods: int) -> None:
        tunnel, law = self.tunnel, self.law
        for _ in range(periods):
            tunnel.sample()
            law.control(SETPOINT, dt=DT)
            tunnel.update()


class InNumpy:
    """By hand."""

    def __init__(self, count: int, kind: str) -> None:
        self.driver = Fill(count, count)
        self.inputs = tuple(self.driver.channel(f"in:{i}") for i in range(count))
        self.outputs = tuple(self.driver.channel(f"out:{i}") for i in range(count))
        self.raws = np.zeros(count, np.int64)
        self.integral = np.zeros(count)
        self.resolution, self.linearization = KINDS[kind]

    def period(self, periods: int) -> None:
        for _ in range(periods):
            self.driver.read_many(self.inputs, self.raws)
            temperatures = self.raws * self.resolution
            if self.linearization is not None:
                temperatures = self.linearization.to_values(temperatures)
            if not ((temperatures >= LIMITS[0]) & (temperatures <= LIMITS[1])).all():
                raise ValueError("a temperature is out of its range")
            proportional = GAIN * (SETPOINT - temperatures)
            growth = proportional * (DT / INTEGRAL_TIME)
            wanted = proportional + self.integral + growth
            duties = np.clip(wanted, 0.0, 100.0)
            limited = duties != wanted
            if limited.any():
                growth[limited & ((wanted - duties) * growth > 0)] = 0.0
            self.integral += growth
            self.driver.write_many(self.outputs, np.rint(duties / 0.1).astype(np.int64))


def readings(count: int, kind: str) -> Any:
    """Raw integers of 600 to 900 degC."""
    temperatures = np.random.default_rng(1).uniform(600.0, 900.0, count)
    resolution, linearization = KINDS[kind]
    inputs = temperatures if linearization is None else linearization.to_inputs(temperatures)
    return np.rint(inputs / resolution).astype(np.int64)


def make(count: int, kind: str, stack: ExitStack) -> tuple[OnVectors, InNumpy]:
    """Both, with the same readings."""
    on_vectors, in_numpy = OnVectors(count, kind), InNumpy(count, kind)
    stack.callback(on_vectors.close)
    for one in (on_vectors, in_numpy):
        one.driver.inputs[:] = readings(count, kind)
    return on_vectors, in_numpy


def measure(rounds: int, count: int = ZONES, kinds: Sequence[str] = tuple(KINDS)) -> dict[str, Figure]:
    """us a period, by kind and row: "linear, umo", "linear, numpy" and so on, in turns."""
    with ExitStack() as stack:
        cases = [
            Case(kind, count, row, one.period)
            for kind in kinds
            for row, one in zip(("umo", "numpy"), make(count, kind, stack), strict=True)
        ]
        with quiet():
            take_turns(cases, rounds)
    return {f"{case.work}, {case.row}": Figure(min(case.times), median(case.times)) for case in cases}
