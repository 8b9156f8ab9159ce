"""The extensions in C: they are built where they can be, and do what Python does with the same numbers."""

from __future__ import annotations

import math
import mmap
import struct
import subprocess
import sys
import sysconfig
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import umo
from helpers.image_forms import BUILT
from umo.cycle import forms
from umo.frames import body
from umo.objects.scaling import to_value

SOURCES = ["cycle/scan.c", "frames/body.c"]
COMPILER = (sysconfig.get_config_var("CC") or "").split()
HEADERS = Path(sysconfig.get_paths()["include"])


@pytest.mark.skipif(
    not COMPILER or which(COMPILER[0]) is None or not (HEADERS / "Python.h").exists(),
    reason="no C compiler, or no headers of Python",
)
@pytest.mark.parametrize("source", SOURCES)
def test_where_a_compiler_is_they_are_built_without_a_warning(source: str, tmp_path: Path) -> None:
    path = Path(umo.__file__).parent / source
    strict = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-c", str(path), "-o", str(tmp_path / "out.o")]
    done = subprocess.run([*COMPILER, "-fPIC", f"-I{HEADERS}", *strict], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert body.is_compiled()


def arrays(*lengths: int) -> list[Any]:
    return [np.zeros(length) for length in lengths]


# The image ----------------------------------------------------------------------------------------------

RAW = st.integers(-(2**63), 2**63 - 1) | st.integers(-99, 99) | st.sampled_from([2**53 + 1, -(2**53) - 1])
SCALE = st.tuples(
    st.floats(allow_nan=False) | st.sampled_from([1.0, -1.0, 0.1, -0.3, 1e-18, 5e-324]),
    st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 1.5, -7.3]),
)
BOUND = st.sampled_from([0.0, 10.0, 1e19, math.inf])


@BUILT
@given(st.lists(st.tuples(RAW, SCALE, BOUND, BOUND), max_size=6))
def test_a_block_is_converted_as_each_number_by_itself(objects: list[Any]) -> None:
    count = len(objects)
    moved = np.array([raw for raw, *_ in objects], np.int64)
    scales = np.array([(*scale, -low, high) for _, scale, low, high in objects]).reshape(-1)
    raws, values, times = np.zeros(count, np.int64), np.full(count, 3.0), np.full(count, 4.0)
    outside = forms.extension.Inputs(moved, scales, raws, values, times, 7).convert(5.0)
    expected, refused = [3.0] * count, []
    for place, (raw, scale, low, high) in enumerate(objects):
        value = to_value(raw, *scale)
        if -low <= value <= high:
            expected[place] = value
        else:
            refused.append((7 + place, value))
    assert values.tobytes() == np.array(expected).tobytes()
    assert raws.tolist() == moved.tolist()
    assert [(slot, bits(value)) for slot, value in outside] == [(slot, bits(value)) for slot, value in refused]
    assert times.tolist() == [4.0 if refused else 5.0] * count


def bits(value: float) -> bytes:
    return b"nan" if math.isnan(value) else struct.pack("d", value)


@BUILT
def test_a_product_is_rounded_before_the_sum() -> None:
    """0.1 * 3 - 0.3 is 5.6e-17; in one operation, without rounding in between, 2.8e-17."""
    moved, (raws, values, times) = np.array([3]), arrays(1, 1, 1)
    scales = np.array([0.1, -0.3, -1.0, 1.0])
    assert forms.extension.Inputs(moved, scales, raws, values, times, 0).convert(0.0) == []
    assert values[0] == 0.1 * 3 - 0.3


@BUILT
def test_what_was_pending_is_committed() -> None:
    moved, pending = np.array([5, -6]), np.array([0.5, -0.6])
    raws, values, times = np.zeros(2, np.int64), *arrays(2, 2)
    forms.extension.Outputs(moved, pending, raws, values, times).commit(1.5)
    assert [raws.tolist(), values.tolist(), times.tolist()] == [[5, -6], [0.5, -0.6], [1.5, 1.5]]


@BUILT
@pytest.mark.parametrize("lengths", [(2, 8, 2, 2, 1), (2, 2, 2, 2, 2), (2, 9, 2, 2, 2), (3, 8, 2, 2, 2)])
def test_an_input_block_takes_only_views_that_fit_together(lengths: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="differ in length"):
        forms.extension.Inputs(*arrays(*lengths), 0)


@BUILT
def test_an_output_block_takes_only_views_that_fit_together() -> None:
    with pytest.raises(ValueError, match="differ in length"):
        forms.extension.Outputs(*arrays(2, 8, 2, 2, 2))
    with pytest.raises(ValueError, match="differ in length"):
        forms.extension.Outputs(*(bytearray(7) for _ in range(5)))


@BUILT
@pytest.mark.parametrize("place", [2, 3, 4])
def test_a_block_is_not_made_of_views_that_cannot_be_written_to(place: int) -> None:
    views = arrays(2, 2, 2, 2, 2)
    views[place].flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        forms.extension.Outputs(*views)


@BUILT
def test_a_time_that_is_not_a_number_is_refused() -> None:
    for call in (
        forms.extension.Inputs(*arrays(2, 8, 2, 2, 2), 0).convert,
        forms.extension.Outputs(*arrays(2, 2, 2, 2, 2)).commit,
    ):
        with pytest.raises(TypeError):
            call("now")


# Frames -------------------------------------------------------------------------------------------------


@BUILT
def test_a_body_is_not_written_to_memory_that_is_read_only() -> None:
    with mmap.mmap(-1, 4096, access=mmap.ACCESS_READ) as file, pytest.raises(BufferError):
        body.extension.Body(file, *arrays(1, 1, 1), 100)


# Memory -------------------------------------------------------------------------------------------------


@BUILT
def test_views_are_let_go_of() -> None:
    views = arrays(2, 2, 2, 2, 2)
    before = [sys.getrefcount(view) for view in views]
    for _ in range(100):
        forms.extension.Outputs(*views).commit(1.0)
        body.extension.Body(*views[:4], 16)
        with pytest.raises(ValueError, match="differ"):
            forms.extension.Inputs(*views, 0)
    assert [sys.getrefcount(view) for view in views] == before


@BUILT
def test_values_out_of_bounds_leave_nothing_behind() -> None:
    scales = np.array([1.0, 0.0, 5.0, 6.0] * 3)
    convert = forms.extension.Inputs(np.arange(3) + 100, scales, np.arange(3), *arrays(3, 3), 1000).convert
    assert kept(lambda: convert(1.5)) < 2000


def kept(call: Callable[[], object]) -> int:
    """Bytes more after 1,000 calls."""
    call()
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(1000):
            call()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after - before
