"""One place turns raw integers and values into each other."""

from __future__ import annotations

import shutil
import subprocess
from ctypes import CDLL, c_double
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from umo.generate.controller_folder import RUNTIME
from umo.objects.scaling import to_raw, to_raws, to_steps, to_value, to_values

RESOLUTIONS = st.floats(1e-6, 1e6) | st.floats(-1e6, -1e-6)
OFFSETS = st.floats(-1e9, 1e9)
RAWS = st.integers(-(2**31), 2**32)


def bits(array: np.ndarray) -> list[int]:
    return array.view(np.int64).tolist()


@given(st.lists(st.tuples(st.floats(-1e12, 1e12), RESOLUTIONS, OFFSETS), min_size=1, max_size=20))
def test_scalar_and_vector_form_of_to_raw_agree(rows):
    assume(all(abs((value - offset) / resolution) < 2**62 for value, resolution, offset in rows))
    values, resolutions, offsets = (np.array(column) for column in zip(*rows, strict=True))
    assert to_raws(values, resolutions, offsets).tolist() == [to_raw(*row) for row in rows]


@given(st.lists(st.tuples(st.integers(-(2**53), 2**53), RESOLUTIONS, OFFSETS), min_size=1, max_size=20), st.booleans())
def test_scalar_and_vector_form_of_to_value_agree(rows, in_place):
    raws, resolutions, offsets = (np.array(column, float) for column in zip(*rows, strict=True))
    plain = bits(np.array([to_value(*row) for row in rows]))
    assert bits(to_values(raws, resolutions, offsets, raws if in_place else None)) == plain
    unshifted = bits(np.array([raw * resolution for raw, resolution, _ in rows]))
    assert bits(to_values(np.array([raw for raw, *_ in rows]), resolutions, None)) == unshifted


FORMS_IN_C = """
typedef double umo_real;
#include "umo_scaling.h"
double value(double raw, double per_bit, double of_zero) { return umo_to_value(raw, per_bit, of_zero); }
double steps(double value, double per_bit, double of_zero) { return umo_to_steps(value, per_bit, of_zero); }
"""


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    """The two forms of `umo_scaling.h`, of blocks and of controllers."""
    if (compiler := shutil.which("cc")) is None:
        pytest.skip("needs a C compiler")
    folder = tmp_path_factory.mktemp("scaling")
    (folder / "forms.c").write_text(FORMS_IN_C)
    options = ["-std=c99", "-O3", "-ffp-contract=off", "-Wall", "-Werror", "-fPIC", "-shared", f"-I{RUNTIME}"]
    subprocess.run([compiler, *options, "-o", folder / "forms.so", folder / "forms.c"], check=True)
    found = CDLL(str(folder / "forms.so"))
    for form in (found.value, found.steps):
        form.restype, form.argtypes = c_double, (c_double, c_double, c_double)
    return found


@given(number=st.floats(-1e12, 1e12), resolution=RESOLUTIONS, offset=OFFSETS)
def test_the_form_in_c_is_that_of_python_to_the_bit(in_c, number, resolution, offset):
    columns = (np.array([number]), np.array([resolution]), np.array([offset]))
    forms = [in_c.value(number, resolution, offset), in_c.steps(number, resolution, offset)]
    assert forms == [to_values(*columns)[0], to_steps(*columns)[0]]
    assert forms[0] == to_value(number, resolution, offset)
    assert round(forms[1]) == to_raw(number, resolution, offset)


@given(RAWS, st.sampled_from([1.0, -1.0, 0.5, -0.25, 2.0, 1024.0]), st.integers(-1000, 1000))
def test_half_a_step_rounds_to_even_in_each_way(raw, resolution, offset):
    value = (raw + 0.5) * resolution + offset  # exact in binary
    even = raw if raw % 2 == 0 else raw + 1
    assert to_raw(value, resolution, offset) == even
    assert to_raws(np.array([value]), np.array([resolution]), np.array([float(offset)])).tolist() == [even]


@pytest.mark.parametrize(("value", "raw"), [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2), (-2.5, -2)])
def test_half_to_even(value, raw):
    assert to_raw(value, 1.0, 0.0) == raw


@given(st.integers(-(2**24), 2**24), RESOLUTIONS, st.floats(-1e6, 1e6))
def test_every_raw_survives_the_way_to_a_value_and_back(raw, resolution, offset):
    assume(abs(offset / resolution) < 2**40)  # the offset must leave the count room in a float
    assert to_raw(to_value(raw, resolution, offset), resolution, offset) == raw


@given(st.floats(-1e6, 1e6), RESOLUTIONS, st.floats(-1e6, 1e6))
def test_a_value_comes_back_within_half_a_resolution(value, resolution, offset):
    back = to_value(to_raw(value, resolution, offset), resolution, offset)
    slack = 4 * (abs(value) + abs(offset) + abs(back)) * 2.0**-52
    assert abs(Fraction(back) - Fraction(value)) <= Fraction(abs(resolution)) / 2 + Fraction(slack)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), RESOLUTIONS, OFFSETS)
def test_scaling_keeps_the_order_or_with_a_negative_resolution_turns_it(a, b, resolution, offset):
    low, high = sorted((a, b))
    first, second = to_raw(low, resolution, offset), to_raw(high, resolution, offset)
    assert first <= second if resolution > 0 else first >= second


@given(st.integers(0, 1))
def test_an_inverted_bit_is_resolution_minus_one_and_offset_one(level):
    assert to_value(level, -1.0, 1.0) == 1 - level
    assert to_raw(1.0 - level, -1.0, 1.0) == level


def test_the_papers_numbers():
    assert to_value(43689, 4.64357, -147871.0) == pytest.approx(55_002, abs=1)
    assert to_raw(55_000.0, 4.64357, -147_871.0) == 43689
    assert to_raw(129_000.0, 4.64357, -147_871.0) == 59625
    assert to_raw(10.0, 10.0 / 2047.0, 0.0) == 2047
    assert to_raw(-10.0, 10.0 / 2047.0, 0.0) == -2047


def test_it_divides_and_never_multiplies_by_a_reciprocal():
    halves = [k + 0.5 for k in range(2000)]
    assert [to_raw(h * 0.1, 0.1, 0.0) for h in halves] == [round(h * 0.1 / 0.1) for h in halves]
    assert any(round(h * 0.1 * (1 / 0.1)) != to_raw(h * 0.1, 0.1, 0.0) for h in halves)
