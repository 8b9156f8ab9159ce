"""The least and the greatest values that a page shows: what counts, since when, and what each page is told."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

import numpy as np
import pytest

import umo
from umo.clients.page.extremes import Extremes
from umo.objects import Quality
from umo.testing import Scripted

from .conftest import Client, eventually, opened, running, serving

FRAME = np.dtype([("time", "<f8"), ("values", "<f8", (2,)), ("quality", "<u1", (2,)), ("signals", "<f8", (1,))])


def frames(*rows: tuple[float, list[float], list[Quality], float]) -> Any:
    return np.array([(time, values, quality, [signal]) for time, values, quality, signal in rows], FRAME)


def test_only_what_was_measured_counts_and_a_signal_where_it_has_a_value() -> None:
    extremes = Extremes(2, 1)
    good, held = Quality.GOOD, Quality.STALE
    extremes.add(frames((5.0, [1.0, 7.0], [good, held], nan), (5.1, [-3.0, 9.0], [good, Quality.BAD], 2.0)))
    extremes.add(frames((5.2, [99.0, 4.0], [Quality.UNREFERENCED, Quality.OUT_OF_RANGE], -np.inf)))
    assert extremes.since == 5.0
    np.testing.assert_equal(extremes.least, [-3.0, 4.0, 2.0])
    np.testing.assert_equal(extremes.greatest, [1.0, 4.0, 2.0])


@pytest.fixture
def client() -> Iterator[Client]:
    with serving() as served, opened(served.socket) as client:
        yield client


def told(client: Client, until: Any) -> dict[str, Any]:
    """The extremes of the encoder as a page puts the messages together, once they are so."""
    known: dict[str, Any] = {}
    while not until(known):
        message = client.get("extremes")
        known = {"since": message["since"], **({} if message["full"] else known)}
        known |= {str(place): pair for place, pair in message["values"].items()}
    return known


def test_a_page_is_told_extremes_and_what_changes_of_them(client: Client) -> None:
    with running(box=Scripted({"encoder": [*[5] * 60, 90, *[5] * 20, 2, *[5] * 9999]})) as run:
        paths = [entry["path"] for entry in client.get("description")["objects"]]
        encoder = str(paths.index("encoder"))
        client.send(type="extremes", id=1)
        first = told(client, lambda known: encoder in known)[encoder]
        run(70)  # the greatest one is between two states
        low, high = told(client, lambda known: known.get(encoder, [0, 0])[1] > first[1])[encoder]
        assert low < first[0]
        client.send(type="extremes", id=2, anew=True)
        run(30)
        known = told(client, lambda known: known.get(encoder, [0, high])[1] < high)
        assert known[encoder][0] > low


def test_the_extremes_of_one_page_begin_anew_without_those_of_another() -> None:
    box = Scripted({"encoder": [*[5] * 60, 90, *[5] * 9999]})
    with running(box=box, count=80) as run, serving() as served, opened(served.socket) as one:
        encoder = str([entry["path"] for entry in one.get("description")["objects"]].index("encoder"))
        one.get("state")  # what there was before is read
        one.send(type="extremes", id=1, anew=True)
        run(10)
        mine = told(one, lambda known: encoder in known)[encoder]
        with opened(served.socket) as other:
            other.get("description")
            other.send(type="extremes", id=1)
            assert told(other, lambda known: encoder in known)[encoder][1] > mine[1]


def test_what_a_page_has_begun_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from umo.clients.page.watched_run import Watched

    alive: list[Extremes] = []
    begin, end = Watched.extremes_for, Watched.end_extremes
    monkeypatch.setattr(Watched, "extremes_for", lambda self, anew: alive.append(found := begin(self, anew)) or found)
    monkeypatch.setattr(Watched, "end_extremes", lambda self, found: (end(self, found), alive.remove(found)))
    with running(), serving() as served:
        with opened(served.socket) as client:
            client.get("description")
            for number in range(3):
                client.send(type="extremes", id=number, anew=True)
            client.get("extremes")
        eventually(lambda: not alive)


def test_the_extremes_begin_with_the_oldest_period_that_the_run_keeps_also_one_before_the_server() -> None:
    with running(box=Scripted({"encoder": [90, *[5] * 9999]})) as run:
        run(30)
        with umo.attach() as station:
            oldest = station.frames(0.1)["time"][0]
        with serving() as served, opened(served.socket) as client:
            client.get("description")
            client.send(type="extremes", id=1)
            assert told(client, bool)["since"] <= oldest
