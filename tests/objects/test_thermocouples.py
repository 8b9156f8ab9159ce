"""Thermocouples of all letters against the tables of NIST (Standard Reference Database 60, ITS-90; Monograph 175),
which print 1 uV: type_t.tab of the database, table 9 of type K, the ends of the ranges of the inverse functions, and
values that the tables have at round temperatures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.tiers import some
from umo import DigitalSensor, Thermocouple
from umo.errors import DeclarationError
from umo.objects.its90 import references, voltages
from umo.objects.thermocouple import KINDS

TABLES: dict[str, dict[float, float]] = {
    "B": {
        100: 0.033, 200: 0.178, 250: 0.291, 500: 1.242, 700: 2.431, 1000: 4.834, 1300: 7.848, 1600: 11.263,
        1820: 13.820,
    },
    "E": {
        -270: -9.835, -250: -9.718, -200: -8.825, -100: -5.237, 0: 0.0, 100: 6.319, 200: 13.421, 500: 37.005,
        1000: 76.373,
    },
    "J": {
        -210: -8.095, -200: -7.890, -100: -4.633, 0: 0.0, 100: 5.269, 200: 10.779, 500: 27.393, 760: 42.919,
        1000: 57.953, 1200: 69.553,
    },
    "K": {
        -270: -6.458, -260: -6.441, -250: -6.404, -240: -6.344, -230: -6.262, -220: -6.158, -210: -6.035,
        -200: -5.891, -190: -5.730, -150: -4.913, 0: 0.0, 100: 4.096, 500: 20.644, 1000: 41.276, 1372: 54.886,
    },
    "N": {
        -270: -4.345, -250: -4.313, -200: -3.990, -100: -2.407, 0: 0.0, 100: 2.774, 200: 5.913, 600: 20.613,
        1000: 36.256, 1300: 47.513,
    },
    "R": {
        -50: -0.226, 0: 0.0, 100: 0.647, 250: 1.923, 500: 4.471, 1000: 10.506, 1200: 13.228, 1600: 18.849,
        1664.5: 19.739, 1768.1: 21.103,
    },
    "S": {
        -50: -0.236, 0: 0.0, 100: 0.646, 250: 1.874, 500: 4.233, 1000: 9.587, 1300: 13.159, 1600: 16.777,
        1664.5: 17.536,
    },
    "T": {
        -270: -6.258, -260: -6.232, -250: -6.180, -240: -6.105, -230: -6.007, -220: -5.888, -210: -5.753,
        -200: -5.603, -150: -4.648, -100: -3.379, -50: -1.819, 0: 0.0, 100: 4.279, 200: 9.288, 400: 20.872,
    },
}  # fmt: skip
PRINTED = 0.0005001
"""mV: half of the last digit."""


def ways() -> Iterator[tuple[str, Thermocouple, float]]:
    """Each type over its usual range, and over all of it."""
    for kind, limits in KINDS.items():
        for start in dict.fromkeys([limits.usual, limits.start]):
            yield kind, Thermocouple(kind).over(start, limits.end), start


QUICK = ("B50", "K-270", "N-200")
WAYS = some(lambda case: case.id in QUICK, [pytest.param(*way, id=f"{way[0]}{way[2]:g}") for way in ways()])


@pytest.mark.parametrize(("kind", "one", "start"), WAYS)
def test_voltages_and_temperatures_are_those_of_the_tables(kind: str, one: Thermocouple, start: float) -> None:
    shown = {t: mv for t, mv in TABLES[kind].items() if t >= start}
    assert len(shown) > 5
    for temperature, voltage in shown.items():
        assert one.to_input(temperature) == pytest.approx(voltage, abs=PRINTED)
        (slope,) = voltages(kind, np.array([float(temperature)]))[1]
        found = one.to_value(voltage)
        if temperature > -260:  # below, half a microvolt is more than half a degree
            assert found == pytest.approx(temperature, abs=1.2 * PRINTED / slope + 1e-3)
        assert one.to_value(one.to_input(temperature)) == pytest.approx(temperature, abs=0.06 if start < -200 else 2e-3)


@pytest.mark.parametrize(("kind", "one", "start"), WAYS)
def test_the_interpolation_is_as_exact_as_it_says(kind: str, one: Thermocouple, start: float) -> None:
    t = np.linspace(start, KINDS[kind].end, 100_001)
    mv = voltages(kind, t)[0]
    off = np.abs(one.to_values(mv) - t)
    exact = 1e-3 if kind == "N" else 1e-4 if start < KINDS[kind].usual else 1e-5
    assert off[t > -260].max() < exact
    assert off.max() < 0.05
    assert np.abs(one.to_inputs(t) - mv).max() < 2e-5


@pytest.mark.parametrize("kind", some(lambda kind: kind in "BK", KINDS))
@settings(max_examples=10, deadline=None)
@given(share=st.tuples(st.floats(0, 1), st.floats(0, 1)).filter(lambda pair: abs(pair[0] - pair[1]) > 1e-3))
def test_a_range_within_that_of_its_type_is_accepted_and_any_beyond_is_refused(
    kind: str, share: tuple[float, float]
) -> None:
    start, _, end = KINDS[kind]
    low, high = (start + each * (end - start) for each in sorted(share))
    one = Thermocouple(kind).over(low, high)
    assert one.to_value(one.to_input(low)) == pytest.approx(low, abs=0.06)
    for beyond in ((start - 0.1, high), (low, end + 0.1)):
        with pytest.raises(DeclarationError, match=f"the thermocouple {kind} covers {start:g} to {end:g}, not "):
            Thermocouple(kind).over(*beyond)


def test_the_ranges_of_a_type_follow_each_other_and_the_voltage_has_no_step() -> None:
    assert sorted(references()) == sorted(KINDS)
    for kind, pieces in references().items():
        assert pieces[-1].end == KINDS[kind].end
        for one, other in pairwise(pieces):
            assert one.end == other.start
            (before,), (after,) = (each.at(np.array([one.end]))[0] for each in (one, other))
            assert before == pytest.approx(after, abs=2e-5)


def test_a_sensor_of_a_cryostat_reads_down_to_its_end() -> None:
    sensor = DigitalSensor("degC", minimum=-270.0, maximum=50.0, resolution=0.0001, linearization=Thermocouple("K"))
    assert "thermocouple K" in sensor.describe()
    with pytest.raises(DeclarationError, match="covers -270 to 1372"):
        DigitalSensor("degC", minimum=-271.0, maximum=50.0, resolution=0.0001, linearization=Thermocouple("K"))
