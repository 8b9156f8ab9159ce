"""Thermocouples: temperature in degC from the thermoelectric voltage in mV, reference junction at 0 degC."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import NamedTuple

from umo.errors import DeclarationError
from umo.objects.interpolation import Cubics
from umo.objects.its90 import voltages
from umo.objects.linearization import Linearization, check_covers

CELLS, FULL_CELLS = 2048, 32768
"""Number of cells in which a reference function is interpolated, over its usual range and over its whole range."""


class Limits(NamedTuple):
    """The ends of a type's range in degC. Above `usual` the voltage determines the temperature with good accuracy."""

    start: float
    usual: float
    end: float


KINDS = {
    "B": Limits(50.0, 250.0, 1820.0),
    "E": Limits(-270.0, -200.0, 1000.0),
    "J": Limits(-210.0, -210.0, 1200.0),
    "K": Limits(-270.0, -200.0, 1372.0),
    "N": Limits(-270.0, -200.0, 1300.0),
    "R": Limits(-50.0, -50.0, 1768.1),
    "S": Limits(-50.0, -50.0, 1768.1),
    "T": Limits(-270.0, -200.0, 400.0),
}
"""The ranges of ITS-90. The range of type B begins at 0 degC, but below 42 degC two temperatures have the same
voltage."""


@dataclass(frozen=True)
class Thermocouple(Linearization):
    """A thermocouple behind a converter that compensates the reference junction: degC from mV and back, by the
    reference functions of ITS-90 (NIST Monograph 175, NIST Standard Reference Database 60, IEC 60584-1).

    Types, in degC: B 50 to 1820, E -270 to 1000, J -210 to 1200, K -270 to 1372, N -270 to 1300, R and S -50 to 1768.1,
    T -270 to 400. Accuracy of the interpolation: 1e-5 degC, for type N 1e-3 degC. For an object whose range begins
    below -200 degC: 1e-4 degC down to -260 degC, and 0.05 degC below, where 1 degC is about 1 uV.
    """

    kind: str
    full: bool = field(default=False, repr=False)
    """True if the whole range is interpolated, in smaller cells; set by `over`."""
    units = "degC"

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise DeclarationError(f"there is no thermocouple of type {self.kind!r}; known: {', '.join(KINDS)}")

    def over(self, minimum: float, maximum: float) -> Thermocouple:
        limits = KINDS[self.kind]
        check_covers(self, minimum, maximum, limits.start, limits.end)
        return replace(self, full=minimum < limits.usual)

    @cached_property
    def _forward(self) -> Cubics:  # type: ignore[override]
        return _both_ways(self.kind, self.full)[1]

    @cached_property
    def _inverse(self) -> Cubics:  # type: ignore[override]
        return _both_ways(self.kind, self.full)[0]

    def __str__(self) -> str:
        return f"thermocouple {self.kind}"


@cache
def _both_ways(kind: str, full: bool) -> tuple[Cubics, Cubics]:
    """Return two functions: mV from degC, and degC from mV."""
    limits, cells = KINDS[kind], FULL_CELLS if full else CELLS
    return Cubics.both_ways(partial(voltages, kind), limits.start if full else limits.usual, limits.end, cells)
