"""How a run ended, as the page tells it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.machines import bench, wired
from helpers.runs import Run
from umo import connect, published
from umo.clients.page.ending import UNKNOWN_END, BoxInWords, Ending, ending_of
from umo.clients.page.feed import Feed
from umo.clients.page.watched_run import Watched
from umo.cycle.events import CommandState, Event
from umo.cycle.showing import frame_of
from umo.cycle.stopping import TimeLimit
from umo.process.frames import Reader, rings
from umo.system.device_record import DeviceRecord
from umo.testing import Scripted, VirtualTimer, periods

from .conftest import eventually, opened, running, search, serving


class Strange(Exception):
    """Its text comes from code that is not umo's."""

    def __str__(self) -> str:
        raise AssertionError("code of the user's was called before the outcome was reported")


def run_that(ends: Callable[[connect[Any]], None]) -> Ending | None:
    """A run that ends like this, as a page sees it."""
    m, feed = bench(), Feed()
    connection = connect(m, wired(m, Scripted({"encoder": range(1, 100)}), clock=VirtualTimer()))
    try:
        with connection, published(connection, "press", "rig"):
            periods(m, 5)
            search(feed)
            ends(connection)
    except Exception:  # it is what the test is about
        pass
    try:
        return seen(feed)
    finally:
        feed.close()


def seen(feed: Feed) -> Ending | None:
    feed.look(states=True)
    (watched,) = feed.watched.values()
    watched.look_around()
    return watched.ending


def fail(error: Exception) -> Callable[[connect[Any]], None]:
    def ends(connection: connect[Any]) -> None:
        raise error

    return ends


@pytest.mark.parametrize(
    ("ends", "failed", "text"),
    [
        (lambda connection: None, False, "the application has ended"),
        (lambda connection: connection.stop.request(), False, "stopped by the program"),
        (
            lambda connection: TimeLimit(0, connection.stop)(frame_of(connection.machine)),
            False,
            "stopped by its time limit",
        ),
        (lambda connection: connection.stop.request(signal.SIGINT), False, "stopped by SIGINT"),
        (fail(ValueError("no part under the cup")), True, "ValueError: no part under the cup (tests/clients/page/"),
        (fail(Strange()), True, "Strange (tests/clients/page/test_ending.py"),
    ],
)
def test_a_run_tells_how_it_ended(ends: Callable[[connect[Any]], None], failed: bool, text: str) -> None:
    ending = run_that(ends)
    assert ending is not None
    assert ending.failed is failed
    assert text.split(" (")[0] == ending.text.split(" (")[0]


def test_a_page_is_told_how_the_run_ended() -> None:
    with serving() as served, opened(served.socket) as client:
        with running():
            client.get("description")
        told = {"failed": False, "text": "the application has ended"}
        assert eventually(lambda: client.get("stations")["stations"][0].get("ending")) == told
        assert client.get("state")["ending"] == told


@pytest.mark.parametrize(("killed", "text"), [("control", "was killed (SIGKILL)"), ("guardian", "the guardian")])
@pytest.mark.full
def test_of_a_killed_run_the_page_says_so(tmp_path: Path, killed: str, text: str) -> None:
    process_box.Cells(tmp_path / "box")
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    feed = Feed()
    search(feed)
    os.kill(getattr(run, killed), signal.SIGKILL)
    assert run.outcome().failure is not None
    ending = seen(feed)
    assert ending is not None and ending.failed
    assert text in ending.text
    feed.close()


def test_the_unsafe_end_of_the_next_run_is_not_told_of_the_one_before() -> None:
    last = Event(1.0, "", "stopped by ann", state=CommandState.CANCELLED)
    about = {"station": "press", "devices": ["bus 1"], "started": time.time() - 60.0}
    record = DeviceRecord(["bus 1"], "press", "rig")
    record.begin(False)
    of_the_next = about | {"started": time.time()}
    record.stopped("device not reached", ["valve"])
    assert ending_of(about, last, BoxInWords()) == Ending(False, "stopped by ann")
    assert ending_of(of_the_next, last, BoxInWords()) == Ending(True, "device not reached; not reached: valve")


def test_an_end_that_nobody_could_tell_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.process.frames.publish.tell_end", lambda *given: None)
    with running():
        watched = Watched(Reader(rings()[0]))
        watched.read()
    watched._heard -= 60.0  # a period of a minute
    watched.read()
    watched.look_around()
    assert watched.ending is None  # the guardian may still tell it
    monkeypatch.setattr("umo.clients.page.watched_run.ENDING_TIME", 0.0)
    watched.look_around()
    assert watched.ending == Ending(True, UNKNOWN_END)
    watched.close()
