"""What an open page is told, and what it may ask."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from umo.objects import Quality
from umo.page.watched import Watched
from umo.testing import Scripted

from .conftest import Client, opened, running, serving


@pytest.fixture
def client() -> Iterator[Client]:
    with serving() as served, opened(served.socket) as client:
        yield client


def test_the_only_station_is_described_with_its_objects(client: Client) -> None:
    with running():
        description = client.get("description")
        assert (description["name"], description["wiring"], description["period"]) == ("press", "rig", 0.001)
        assert "encoder" in [entry["path"] for entry in description["objects"]]


def test_the_list_of_stations_follows_what_runs(client: Client) -> None:
    assert client.get("stations")["stations"] == []
    with running():
        (line,) = client.get("stations")["stations"]
        assert (line["name"], line["stage"]) == ("press", "running")
    (line,) = client.get("stations")["stations"]
    assert line["stage"] == "ended"


def test_a_state_has_the_values_of_the_last_frame_and_then_what_has_changed(client: Client) -> None:
    with running() as step:
        places = {entry["path"]: place for place, entry in enumerate(client.get("description")["objects"])}
        state = client.get("state")
        assert state["full"]
        assert state["values"][str(places["encoder"])][1] == 51  # the first was read at the start
        step(3)
        while (state := client.get("state"))["values"] == {}:
            pass
        assert not state["full"]
        assert state["values"][str(places["encoder"])][1] == 54


def test_live_points_have_every_peak(client: Client) -> None:
    raws = [0] * 2000
    raws[777] = 999
    with running(box=Scripted({"encoder": raws}), count=1500) as step:
        client.get("description")
        client.send(type="live", id=1, paths=["encoder"], span=10.0, width=100)
        head, times, low, high = client.get("points")
        assert head["from"] == -1
        assert len(times) <= 101
        assert high.max() > 0 == low.max()
        step(400)
        head, times, *_ = client.get("points")
        assert head["from"] == times[0] > 1.0


def test_a_window_of_no_width_has_every_sample(client: Client) -> None:
    with running(count=200):
        client.get("description")
        client.send(type="window", id=2, paths=["encoder"], start=0.0, stop=9.0, width=0)
        head, times, low, _ = client.get("points")
        assert head["id"] == 2
        assert len(times) == 200
        assert np.diff(low[0]) == pytest.approx(np.diff(low[0])[0])
        assert head["same"]


def test_a_trigger_shows_the_time_around_it(client: Client) -> None:
    with running(count=100) as step:
        client.get("description")
        now = client.get("state")["stop"]
        entry = {"path": "encoder", "kind": "rising", "level": 0.0, "before": 0.5}
        client.send(type="window", id=9, paths=["encoder"], start=now, stop=now, width=0)
        level = float(client.get("points")[2][0, -1]) * 1.5
        client.send(type="live", id=1, paths=["encoder"], span=0.1, width=100, trigger=entry | {"level": level})
        client.send(type="measure", id=3, paths=["encoder"], start=0, stop=1)
        client.get("measured")
        step(200)
        head, times, low, _ = client.get("points")
        assert head["start"] == pytest.approx(head["trigger"] - 0.05)
        assert low[0][times < head["trigger"]].max() <= level < low[0][times >= head["trigger"]].min()


@pytest.mark.parametrize(
    "message",
    [
        {"type": "live", "id": 1, "paths": ["nothing"], "span": 1, "width": 10},
        {"type": "live", "id": 1, "paths": "encoder", "span": 1, "width": 10},
        {"type": "live", "id": 1, "paths": ["encoder"], "span": "long", "width": 10},
        {"type": "live", "id": "x", "paths": ["encoder"], "span": 1, "width": 10},
        {"type": "live", "id": 1, "paths": ["encoder"] * 100, "span": 1, "width": 10},
        {"type": "live", "id": 1, "paths": ["encoder"], "span": 1, "width": 10, "trigger": {"kind": "sideways"}},
        {"type": "window", "id": 1, "paths": ["encoder"], "start": 2, "stop": 1, "width": 10},
        {"type": "window", "id": 1, "paths": ["encoder"], "start": float("nan"), "stop": 1, "width": 10},
        {"type": "dance", "id": 1},
        {"type": "watch", "name": 3},
    ],
)
def test_a_message_without_meaning_is_answered_and_the_page_goes_on(client: Client, message: dict[str, object]) -> None:
    with running():
        client.get("description")
        client.send(**message)
        assert client.get("error")["text"]
        client.send_text("not JSON")
        assert client.get("error")["text"]
        client.get("state")


def test_a_value_of_bad_quality_is_no_value_in_the_history() -> None:
    frames = np.zeros(2, [("values", "f8", 2), ("quality", "u1", 2), ("signals", "f8", 1)])
    frames["values"] = 7.0
    frames["quality"][1] = (Quality.STALE, Quality.BAD)
    rows = Watched._rows(frames)
    assert rows[1][0] == 7.0
    assert np.isnan(rows[1][1])
    assert np.isnan(rows).sum() == 1
