"""What a gateway publishes of a ring."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from bench.fleet.rings import MadeRing, value
from helpers.fleets import Sent
from helpers.publishing import RingMemory
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.run_words import FULL, WordFrame
from umo.clients.fleet.station_publisher import MAX_DELTAS, StationPublisher
from umo.cycle.stage import Stage
from umo.process.frames.frame_server import sockets
from umo.process.frames.layout import Live
from umo.process.frames.search import frames_at

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
OBJECTS = 3000
"""So many that a ring has few frames."""


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> RingMemory:
    return RingMemory(monkeypatch)


@pytest.fixture
def ring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, memory: RingMemory) -> Any:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path))
    made = MadeRing("made", OBJECTS)
    yield made
    made.close()


def publisher(sent: Sent) -> StationPublisher:
    reader = frames_at(sockets()[0])
    return StationPublisher(sent, StationKey("c1", "made"), reader, 0.1)  # type: ignore[arg-type]


def test_each_frame_is_published_once_as_it_stands_in_the_ring(ring: MadeRing) -> None:
    sent = Sent()
    this = publisher(sent)
    words = WordFrame(this.reader.layout)
    for _ in range(5):
        ring.step()
        assert this.look()
        assert this.look()
    deltas = [words.parse(each) for each in sent.messages]
    assert [each.number for each in deltas] == list(range(5))
    image = deltas[0].words.copy()
    for each in deltas:
        words.apply(each, image)
        assert (words.frame(image)["values"] == value(each.number, OBJECTS)).all()


def test_a_gateway_that_was_stopped_for_longer_than_the_ring_goes_on_with_what_is_there(ring: MadeRing) -> None:
    sent = Sent()
    this = publisher(sent)
    ring.step()
    this.look()
    slots = this.reader.slots
    for _ in range(slots + MAX_DELTAS + 50):
        ring.step()
    while this.latest is None or this.latest[0] < ring.number - 1:
        before = len(sent.messages)
        this.look()
        assert len(sent.messages) > before
    numbers = [WordFrame(this.reader.layout).parse(each).number for each in sent.messages]
    assert numbers == [0, *range(ring.number - slots + 1, ring.number)]
    assert WordFrame(this.reader.layout).parse(sent.messages[1]).flags & FULL


def test_a_run_whose_last_frame_is_damaged_ends(ring: MadeRing, memory: RingMemory) -> None:
    sent = Sent()
    this = publisher(sent)
    ring.step()
    ring.step()
    memory.set_sequence(1, 0)
    memory.set_live(Live.STATE, Stage.ENDED)
    assert this.look()
    assert not this.look()
    last = WordFrame(this.reader.layout).parse(sent.messages[-1])
    assert (last.number, last.is_last) == (1, True)


def test_the_status_is_made_anew_only_where_something_of_it_has_changed(
    ring: MadeRing, memory: RingMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    monkeypatch.setattr("umo.clients.fleet.station_publisher.status_of", lambda reader: {"made": made.append(1)})
    monkeypatch.setattr("umo.clients.fleet.station_publisher.STATUS_PAUSE", 0.0)
    this = publisher(Sent())
    begun = len(made)
    for _ in range(3):
        ring.step()
        this.look()
    assert len(made) == begun + 1  # as the first frame has come
    memory.set_live(Live.MISSED, 1)
    ring.step()
    this.look()
    assert len(made) == begun + 2


def test_a_gateway_with_another_rate_publishes_another_run_as_its_numbers_are_of_other_frames(ring: MadeRing) -> None:
    reader = frames_at(sockets()[0])
    slow = StationPublisher(Sent(), StationKey("c1", "made"), reader, 0.3)  # type: ignore[arg-type]
    assert slow.stride != publisher(Sent()).stride
    assert slow.run != publisher(Sent()).run == publisher(Sent()).run
