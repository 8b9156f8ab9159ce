"""Frames of the link, in Python and in C: what one makes the other reads, and damage is found."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from ctypes import CDLL, CFUNCTYPE, POINTER, Structure, byref, c_bool, c_uint8, c_uint16, c_uint32, create_string_buffer
from ctypes import c_char as char
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.generating import needs_a_compiler
from umo.generate.c_compiler import FLAGS, compiler
from umo.generate.controller_folder import BOARDS
from umo.generate.split.link_frames import FrameReader, framed, with_zeros, without_zeros

LONGEST = 1000
bodies = st.one_of(
    st.binary(min_size=1, max_size=600),
    st.integers(240, 520).map(lambda n: b"\1" * n),
    st.lists(st.sampled_from([b"\0", b"\xff", b"\1" * 253, b"\2" * 254, b"\3" * 255]), min_size=1, max_size=3).map(
        b"".join
    ),
)


class CReader(Structure):
    """umo_frame_reader"""

    _fields_ = (
        ("bytes", POINTER(char)),
        ("size", c_uint16),
        ("length", c_uint16),
        ("damaged", c_uint16),
        ("code", c_uint8),
        ("left", c_uint8),
        ("begun", c_bool),
        ("bad", c_bool),
    )


class InC:
    """The frames of umo_frames.c."""

    def __init__(self, library: Path) -> None:
        self._lib: Any = CDLL(str(library))
        self._lib.umo_frame_take.restype = c_bool
        self._lib.umo_crc32.restype = c_uint32

    def framed(self, body: bytes) -> bytes:
        sent = bytearray()
        put = CFUNCTYPE(None, c_uint8)(sent.append)
        self._lib.umo_frame_send(create_string_buffer(body, len(body) + 4), c_uint16(len(body)), put)
        return bytes(sent)

    def reader(self, longest: int = LONGEST) -> Callable[[bytes], Iterator[bytes]]:
        room, reader = create_string_buffer(longest + 4), CReader()
        self._lib.umo_frame_begin(byref(reader), room, c_uint16(longest + 4))

        def take(data: bytes) -> Iterator[bytes]:
            for byte in data:
                if self._lib.umo_frame_take(byref(reader), c_uint8(byte)):
                    yield room.raw[: reader.length]

        return take


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> InC:
    library = tmp_path_factory.mktemp("frames") / "frames.so"
    cc = compiler()
    assert cc is not None
    source = BOARDS / "link" / "umo_frames.c"
    subprocess.run([cc, *FLAGS, "-fPIC", "-shared", "-o", library, source], check=True)
    return InC(library)


@given(bodies)
def test_a_body_comes_back_and_no_zero_is_inside(body: bytes) -> None:
    line = framed(body)
    assert line[:1] == line[-1:] == b"\0"
    assert 0 not in line[1:-1]
    assert FrameReader(LONGEST).take(line) == [body]


@given(bodies)
@example(b"\1" * 254)
@example(b"\1" * 254 + b"\0")
@example(b"\0" * 300)
def test_stuffing_is_that_of_another_implementation(body: bytes) -> None:
    cobs = pytest.importorskip("cobs.cobs", reason="needs PyPI's cobs")
    assert cobs.decode(without_zeros(body)) == body
    assert with_zeros(cobs.encode(body)) == body


@needs_a_compiler
@given(bodies)
@example(b"\1" * 250)
@example(b"\0" * 300)
def test_c_and_python_read_each_other(in_c: InC, body: bytes) -> None:
    assert FrameReader(LONGEST).take(in_c.framed(body)) == [body]
    assert list(in_c.reader()(framed(body))) == [body]
    assert in_c._lib.umo_crc32(body, c_uint16(len(body))) == crc32(body)


@needs_a_compiler
@given(st.lists(bodies, max_size=5), st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 255)), max_size=6))
def test_of_a_damaged_line_both_read_the_same_and_only_what_was_sent(
    in_c: InC, sent: list[bytes], damage: list[tuple[int, int]]
) -> None:
    line = bytearray(b"".join(map(framed, sent)))
    for at, byte in damage:
        if line:
            line[at % len(line)] = byte
    reader = FrameReader(LONGEST)
    found = reader.take(bytes(line))
    assert list(in_c.reader()(bytes(line))) == found
    for body in found:
        assert body in sent
    if not damage:
        assert (found, reader.damaged) == (sent, 0)


@needs_a_compiler
@given(st.one_of(st.binary(max_size=400), st.binary(max_size=400).map(without_zeros)))
def test_noise_is_no_frame_and_the_next_frame_is_read(in_c: InC, noise: bytes) -> None:
    body = b"\7after"
    assert FrameReader(LONGEST).take(noise + framed(body)) == [body]
    assert list(in_c.reader()(noise + framed(body))) == [body]


@needs_a_compiler
@given(st.integers(0, 40))
def test_a_frame_that_is_too_long_is_left_out(in_c: InC, more: int) -> None:
    line = framed(b"\5" * (20 + more)) + framed(b"\6" * 20)
    expected = [b"\5" * 20] * (more == 0) + [b"\6" * 20]
    assert FrameReader(20).take(line) == expected
    assert list(in_c.reader(20)(line)) == expected
    for piece in range(1, 4):
        reader = FrameReader(20)
        pieces = (line[at : at + piece] for at in range(0, len(line), piece))
        assert [body for each in pieces for body in reader.take(each)] == expected
