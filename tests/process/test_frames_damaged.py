"""A reader of any content gives frames, fewer frames, or an error of its own."""

from __future__ import annotations

import struct
import tempfile
from functools import cache
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import bench, relay, wired
from umo import connect, published
from umo.cycle.events import Event
from umo.errors import FramesError
from umo.process.frames import Reader, Stage, blackbox
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, periods


@given(st.lists(st.tuples(st.integers(0, 1 << 20), st.binary(min_size=1, max_size=16)), max_size=20), st.data())
@settings(max_examples=2 * settings().max_examples)
def test_whatever_stands_in_a_ring_a_reader_gives_frames_or_an_error_of_its_own(
    patches: list[tuple[int, bytes]], data: st.DataObject
) -> None:
    """Flipped, zeroed, cut, and absurd numbers where numbers stand."""
    content = bytearray(recorded())
    numbers = [b"\xff" * 8, bytes(8), b"\xff" * 7 + b"\x7f", b"\x00" * 7 + b"\x80", struct.pack("<q", -1), b"\x01" * 8]
    for place in data.draw(st.lists(st.integers(0, 511), max_size=6)):
        content[8 * place : 8 * place + 8] = data.draw(st.sampled_from(numbers))
    for at, patch in patches:
        at %= len(content)
        content[at : at + len(patch)] = patch
    del content[data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content)))) :]
    with tempfile.NamedTemporaryFile(suffix=".box") as file:
        file.write(content)
        file.flush()
        try:
            reader = Reader(Path(file.name))
        except FramesError:
            return
        with reader:
            look_at_all(reader)


def look_at_all(reader: Reader) -> None:
    """Everything that a reader has to tell."""
    frames = reader.read()
    assert len(frames) <= reader.slots
    assert reader.lost >= 0
    for frame in [*frames[:3], *frames[-3:]]:
        reader.values(frame)
        reader.journal(frame)
        [reader.inhibited(frame, number) for number in range(len(reader.paths))]
    reader.latest(), reader.last(10), reader.read(5)
    assert len(reader.events()) <= 512
    reader.events(-5), reader.entries(-1, 5), reader.entries(1 << 62, 1 << 63)
    reader.tunables(), reader.now(), reader.taken, reader.dropped
    assert reader.state is Stage.ENDED
    reader.told_bytes()


@cache
def recorded() -> bytes:
    """A short run with events, a journal and missed periods: a file like a black box."""
    m = bench(valve=relay(synchronous=False))
    connection = connect(m, wired(m, Scripted(), clock=VirtualTimer([0, 2])))
    with connection, published(connection, "bench") as ring, Reader(ring.path) as reader:
        connection.machine.events.add(Event(0.5, "motor", "happened"))
        m.valve.write(OnOff.ON)
        periods(m, 5)
        with tempfile.TemporaryDirectory() as place:
            blackbox.save(reader, Path(place) / "x.box", "a test")
            return (Path(place) / "x.box").read_bytes()
