"""Thermocouples: temperature in degC from the thermoelectric voltage in mV, reference junction at 0 degC."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from umo.errors import DeclarationError
from umo.objects.interpolation import Cubics
from umo.objects.linearization import Linearization, check_covers, horner
from umo.objects.scaling import FloatArray


class Reference(NamedTuple):
    """The voltage in mV from `start` degC on: sum of c[i] t^i, and b[0] exp(b[1] (t - b[2])^2) if there is a `b`."""

    start: float
    c: tuple[float, ...]
    b: tuple[float, float, float] | None = None

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Voltage and derivative, mV/K."""
        voltage = horner(self.c, t)
        slope = horner([i * c for i, c in enumerate(self.c)][1:], t)
        if self.b is not None:
            b0, b1, b2 = self.b
            bump = b0 * np.exp(b1 * (t - b2) ** 2)
            voltage += bump
            slope += bump * (2.0 * b1 * (t - b2))
        return voltage, slope


_K = (
    Reference(
        -200.0,
        (
            0.0,
            0.394501280250e-01,
            0.236223735980e-04,
            -0.328589067840e-06,
            -0.499048287770e-08,
            -0.675090591730e-10,
            -0.574103274280e-12,
            -0.310888728940e-14,
            -0.104516093650e-16,
            -0.198892668780e-19,
            -0.163226974860e-22,
        ),
    ),
    Reference(
        0.0,
        (
            -0.176004136860e-01,
            0.389212049750e-01,
            0.185587700320e-04,
            -0.994575928740e-07,
            0.318409457190e-09,
            -0.560728448890e-12,
            0.560750590590e-15,
            -0.320207200030e-18,
            0.971511471520e-22,
            -0.121047212750e-25,
        ),
        (0.118597600000, -0.118343200000e-03, 0.126968600000e03),
    ),
)
CELLS = 2048
"""Number of cells in which a reference function is interpolated."""
KINDS = {"K": (_K, 1372.0)}
"""Reference functions by ranges, and the end of the last one in degC."""


@dataclass(frozen=True)
class Thermocouple(Linearization):
    """A thermocouple behind a converter that compensates the reference junction: degC from mV, by the reference
    functions of ITS-90 (NIST Monograph 175, NIST Standard Reference Database 60, IEC 60584-1), to 1e-6 degC.

    Types: K, -200 to 1372 degC.
    """

    kind: str
    units = "degC"

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise DeclarationError(f"no thermocouple of type {self.kind!r}; known: {', '.join(KINDS)}")

    def over(self, minimum: float, maximum: float) -> Thermocouple:
        pieces, end = KINDS[self.kind]
        check_covers(self, minimum, maximum, pieces[0].start, end)
        return self

    @cached_property
    def _forward(self) -> Cubics:  # type: ignore[override]
        return _both_ways(self.kind)[1]

    @cached_property
    def _inverse(self) -> Cubics:  # type: ignore[override]
        return _both_ways(self.kind)[0]

    def __str__(self) -> str:
        return f"thermocouple {self.kind}"


@cache
def _both_ways(kind: str) -> tuple[Cubics, Cubics]:
    """mV from degC, and degC from mV."""
    pieces, end = KINDS[kind]
    return Cubics.both_ways(lambda t: _reference(pieces, t), pieces[0].start, end, CELLS)


def _reference(pieces: tuple[Reference, ...], t: FloatArray) -> tuple[FloatArray, FloatArray]:
    voltage, slope = np.empty((2, len(t)))
    for number, piece in enumerate(pieces):
        of = t >= piece.start if number else np.ones(len(t), np.bool_)
        voltage[of], slope[of] = piece.at(t[of])
    return voltage, slope
