"""The body of a frame: the writers in Python and in C write the same bytes."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.conversions import BUILT, choose
from helpers.machines import sensor
from umo import Compound, DigitalSensor, connect
from umo.cycle.image import Image
from umo.process.frames.layout import USAGE_PACKING, Layout
from umo.process.frames.ring import BODY, writer

WHOLE = st.integers(-(2**63), 2**63 - 1)
REAL = st.floats()
"""Infinity and NaN too."""
BYTE = st.integers(0, 255)


class Row(Compound):
    sensors: list[DigitalSensor]


@pytest.fixture(scope="module")
def images() -> Iterator[list[Image]]:
    """Images of connected machines of 0 to 5 objects."""
    made = []
    with ExitStack() as stack:
        for count in range(6):
            connection = connect(Row(sensors=[sensor() for _ in range(count)]))
            stack.enter_context(connection)
            made.append(connection.image)
        yield made


def layout_of(count: int, phases: int, signals: int) -> Layout:
    return Layout(({},) * count, ("",) * phases, {}, ({},) * signals)


@BUILT
@given(
    objects=st.lists(st.tuples(REAL, WHOLE, BYTE, BYTE), max_size=5),
    fixed=st.tuples(WHOLE, REAL, WHOLE, WHOLE, WHOLE, WHOLE),
    seldom=st.binary(min_size=USAGE_PACKING.size, max_size=USAGE_PACKING.size),
    phases=st.lists(WHOLE, max_size=4),
    signals=st.lists(REAL, max_size=4),
)
def test_both_writers_write_the_same_bytes(images, objects, fixed, seldom, phases, signals):
    image = images[len(objects)]
    for slot, (value, raw, quality, restriction) in enumerate(objects):
        image.values[slot], image.raws[slot] = value, raw
        image.quality[slot], image.restrictions[slot] = quality, restriction
    layout = layout_of(len(objects), len(phases), len(signals))
    written = []
    for way in ("numpy", "compiled"):
        with mmap.mmap(-1, layout.dtype.itemsize * 3) as file, pytest.MonkeyPatch.context() as patch:
            choose(patch, way)
            write = writer(image, layout, file)
            write(layout.dtype.itemsize + BODY, *fixed, seldom, phases, signals)
            written.append(file[:])
            del write
    assert written[0] == written[1]
    frame = np.frombuffer(written[0], layout.dtype)[1]
    assert frame["values"].tobytes() == image.values.tobytes()
    assert frame["raws"].tolist() == image.raws.tolist()
    assert frame["quality"].tolist() == image.quality.tolist()
    assert frame["restrictions"].tolist() == image.restrictions.tolist()


GOOD: dict[str, Any] = {
    "at": BODY,
    "number": 1,
    "time": 0.5,
    "missed": 0,
    "began": 5,
    "wake": -1,
    "execution": 7,
    "seldom": bytes(USAGE_PACKING.size),
    "phases": [1, 2],
    "signals": [0.25],
}


@BUILT
@pytest.mark.parametrize(
    "wrong",
    [
        {"at": -1}, {"at": BODY + (1 << 20)}, {"at": BODY + 64}, {"at": None}, {"at": 2**70}, {"number": 2**63},
        {"number": 1.0}, {"time": "0.5"}, {"time": 1}, {"missed": None}, {"seldom": b""}, {"seldom": "text"},
        {"phases": [1]}, {"phases": [1, 2, 3]}, {"phases": (1, 2)}, {"phases": [1, None]}, {"signals": []},
        {"signals": [1]}, {"signals": None},
    ],
)  # fmt: skip
def test_the_writer_in_c_refuses_what_does_not_fit_and_writes_nothing_outside_the_body(images, wrong):
    layout = layout_of(3, 2, 1)
    image = images[3]
    with mmap.mmap(-1, layout.dtype.itemsize) as file:
        write = writer(image, layout, file)
        write(*GOOD.values())
        with pytest.raises((ValueError, TypeError, OverflowError)):
            write(*(GOOD | wrong).values())
        with pytest.raises(ValueError, match="does not fit"):
            write(*list(GOOD.values())[:-1])
        assert file[:BODY] == bytes(BODY)
        assert file[layout.content :] == bytes(layout.dtype.itemsize - layout.content)
        del write


@BUILT
def test_without_the_extension_the_writer_is_in_python(images, monkeypatch):
    choose(monkeypatch, "numpy")
    layout = layout_of(3, 2, 1)
    image = images[3]
    with mmap.mmap(-1, layout.dtype.itemsize) as file:
        write = writer(image, layout, file)
        assert type(write).__name__ == "method"
        write(*GOOD.values())
        assert file[BODY : BODY + 8] == (1).to_bytes(8, "little")
