"""The body of a frame: the writers in Python and in C write the same bytes."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.image_forms import BUILT, FORMS, choose
from helpers.machines import bench, sensor, wired
from umo import Compound, DigitalSensor, connect, published
from umo.cycle import forms
from umo.cycle.forms import ArrayImage, CompiledImage, ListImage
from umo.frames import body
from umo.frames.body import BODY, writer
from umo.frames.layout import SELDOM, Layout
from umo.testing import Scripted

WHOLE = st.integers(-(2**63), 2**63 - 1)
REAL = st.floats()
"""Infinity and NaN too."""


class Row(Compound):
    sensors: list[DigitalSensor]


@pytest.fixture(scope="module")
def images() -> Iterator[dict[tuple[type[Any], int], Any]]:
    """Images of connected machines of 0 to 5 objects, in each form."""
    made = {}
    with ExitStack() as stack, pytest.MonkeyPatch.context() as patch:
        for form in (ListImage, ArrayImage, CompiledImage)[: 3 if forms.extension is not None else 2]:
            choose(patch, form)
            for count in range(6):
                connection = connect(Row(sensors=[sensor() for _ in range(count)]))
                stack.enter_context(connection)
                made[form, count] = connection.image
        yield made


def layout_of(count: int, phases: int, signals: int) -> Layout:
    return Layout(({},) * count, ("",) * phases, {}, ({},) * signals)


@pytest.mark.parametrize("form", FORMS[1:])
@given(
    objects=st.lists(st.tuples(REAL, WHOLE, st.integers(0, 255)), max_size=5),
    fixed=st.tuples(WHOLE, REAL, WHOLE, WHOLE, WHOLE, WHOLE),
    seldom=st.binary(min_size=SELDOM.size, max_size=SELDOM.size),
    phases=st.lists(WHOLE, max_size=4),
    signals=st.lists(REAL, max_size=4),
    data=st.data(),
)
def test_every_writer_writes_the_same_bytes(images, form, objects, fixed, seldom, phases, signals, data):
    count = len(objects)
    commands = data.draw(st.binary(min_size=count, max_size=count))
    layout = layout_of(count, len(phases), len(signals))
    written = []
    for each in (ListImage, form):
        image = images[each, count]
        for slot, (value, raw, quality) in enumerate(objects):
            image.values[slot], image.raws[slot], image.quality[slot] = value, raw, quality
        with mmap.mmap(-1, layout.dtype.itemsize * 3) as file:
            write = writer(image, layout, file)
            write(layout.dtype.itemsize + BODY, *fixed, seldom, phases, signals, commands)
            written.append(file[:])
            del write
    assert written[0] == written[1]


GOOD: dict[str, Any] = {
    "at": BODY,
    "number": 1,
    "time": 0.5,
    "missed": 0,
    "began": 5,
    "wake": -1,
    "execution": 7,
    "seldom": bytes(SELDOM.size),
    "phases": [1, 2],
    "signals": [0.25],
    "commands": b"\0\0\0",
}


@BUILT
@pytest.mark.parametrize(
    "wrong",
    [
        {"at": -1}, {"at": BODY + (1 << 20)}, {"at": BODY + 64}, {"at": None}, {"at": 2**70}, {"number": 2**63},
        {"number": 1.0}, {"time": "0.5"}, {"time": 1}, {"missed": None}, {"seldom": b""}, {"seldom": "text"},
        {"phases": [1]}, {"phases": [1, 2, 3]}, {"phases": (1, 2)}, {"phases": [1, None]}, {"signals": []},
        {"signals": [1]}, {"signals": None}, {"commands": b"\0\0"}, {"commands": bytearray(3)},
    ],
)  # fmt: skip
def test_the_writer_in_c_refuses_what_does_not_fit_and_writes_nothing_outside_the_body(images, wrong):
    layout = layout_of(3, 2, 1)
    image = images[CompiledImage, 3]
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
def test_the_writer_in_c_is_used_where_the_image_has_the_compiled_form(monkeypatch):
    kinds = []
    for form in (CompiledImage, ListImage):
        choose(monkeypatch, form)
        m = bench()
        connection = connect(m, wired(m, Scripted()))
        with connection, published(connection, "bench") as ring:
            kinds.append(type(ring._write).__name__)
    assert kinds == ["builtin_function_or_method", "method"]


@BUILT
def test_without_the_extension_the_writer_is_in_python(images, monkeypatch):
    monkeypatch.setattr(body, "extension", None)
    layout = layout_of(3, 2, 1)
    image = images[CompiledImage, 3]
    with mmap.mmap(-1, layout.dtype.itemsize) as file:
        write = writer(image, layout, file)
        assert type(write).__name__ == "method"
        write(*GOOD.values())
        assert file[BODY : BODY + 8] == (1).to_bytes(8, "little")
