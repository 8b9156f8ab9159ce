"""What an open page is told, and what it may ask."""

from __future__ import annotations

import logging
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPException
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from umo.clients.page import feed
from umo.clients.page.ending import BoxInWords
from umo.clients.page.feed import Feed
from umo.clients.page.page_client import PageClient
from umo.clients.page.server import Options, listen, server
from umo.clients.page.session import MAX_REQUESTS, InitialStation
from umo.clients.page.subscriptions import Subscription
from umo.clients.page.watched_run import Watched
from umo.errors import FramesError
from umo.objects import Quality
from umo.process.frames import Reader
from umo.process.frames.client_memory import size_of
from umo.process.frames.frame_server import FrameServer, folder
from umo.process.frames.layout import Layout, arrange
from umo.process.frames.memory import RunDescriptors, fill
from umo.recording.scope.history import History
from umo.testing import Scripted

from .conftest import PATIENCE, TOKEN, Client, alarming, eventually, opened, running, search, serving


@pytest.fixture
def client() -> Iterator[Client]:
    with serving() as served, opened(served.socket) as client:
        yield client


def test_the_only_station_is_described_with_its_objects(client: Client) -> None:
    with running():
        description = client.get("description")
        assert (description["name"], description["wiring"], description["period"]) == ("press", "rig", 0.001)
        assert description["qualities"][0] == ["●", "good"]
        assert "encoder" in [entry["path"] for entry in description["objects"]]


def test_the_list_of_stations_follows_what_runs(client: Client) -> None:
    assert client.get("stations")["stations"] == []
    with running():
        (line,) = client.get("stations")["stations"]
        assert (line["name"], line["stage"]) == ("press", "running")
    (line,) = client.get("stations")["stations"]
    assert line["stage"] == "ended"


def test_the_list_of_stations_tells_alarms_and_faults_of_each(client: Client) -> None:
    with alarming() as go_wrong:
        before = eventually(lambda: client.get("stations")["stations"])
        assert [(line["faults"], line["alarms"]) for line in before] == [([], [])]
        go_wrong(5)
        (told,) = client.get("stations")["stations"]
        assert told["faults"] == ["cell: could not be read: box: unplugged; cell.limit"]
        assert len(told["alarms"]) == 3
        assert "cell.full: too full (medium, unacknowledged)" in told["alarms"]
    (line,) = client.get("stations")["stations"]
    assert "alarms" not in line


def test_of_two_stations_with_one_name_the_one_of_the_folder_is_shown_first() -> None:
    first = InitialStation("press", "/b/press")
    with running(place=Path("/a/press")), serving(first=first) as served, opened(served.socket) as client:
        while not client.get("stations")["stations"]:
            pass
        with running(place=Path("/b/press")):
            assert client.get("description")["place"] == first.place


def test_a_page_that_comes_back_is_not_shown_another_station_of_that_name(client: Client) -> None:
    with running(place=Path("/b/press")):
        client.get("description")
        client.send(type="watch", name="press", place="/a/press")
        with running("oven"):
            eventually(lambda: len(client.get("stations")["stations"]) == 2)
            client.send(type="measure", id=1, paths=["encoder"], start=0, stop=1)
            assert client.get("error")["text"] == "no station is chosen"
        client.send(type="watch", name="press", place="/b/press")
        assert client.get("description")["place"] == "/b/press"


def test_of_two_runs_in_one_folder_the_one_of_the_pid_is_shown_first() -> None:
    with running(), running():
        looking = Feed()
        search(looking)
        one, other = looking.watched.values()
        one.about["pid"] = 7
        assert InitialStation("press", "", 7).among([one, other]) is one
        assert InitialStation("press", "", 8).among([one, other]) is other  # 8 has ended; another run goes on
        looking.close()


def test_a_run_that_has_ended_gives_its_name_only_to_the_next_one_of_its_folder() -> None:
    looking = Feed()
    for place in ("/a/press", "/b/press", "/a/press"):
        with running(place=Path(place)):
            search(looking)
        looking.look(states=True)
    first, second = looking.watched.values()
    assert (first.place, second.place) == ("/b/press", "/a/press")
    assert (first.name.startswith("press (pid "), second.name) == (True, "press")
    looking.close()


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


def test_states_are_made_only_for_the_run_that_a_page_shows(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    real = Watched.state

    def counted(watched: Watched, full: bool) -> str:
        made.append(watched.station)
        return real(watched, full)

    monkeypatch.setattr(Watched, "state", counted)
    with running("press"), running("oven"):
        eventually(lambda: len(client.get("stations")["stations"]) == 2)
        client.send(type="watch", name="press")
        first = client.get("state")["number"]
        eventually(lambda: client.get("state")["number"] > first + 3)
        assert len(made) > 3
        assert set(made) == {"press"}


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


def test_a_window_of_many_pixels_has_every_sample(client: Client) -> None:
    with running(count=200):
        client.get("description")

        def points() -> Any:
            client.send(type="window", id=2, paths=["encoder"], start=0.0, stop=9.0, width=8192)
            found = client.get("points")
            return found if len(found[1]) >= 200 else None  # the server may not have read all periods yet

        head, times, low, _ = eventually(points)
        assert head["id"] == 2
        assert len(times) == 200
        assert np.diff(low[0]) == pytest.approx(np.diff(low[0])[0])
        assert head["same"]


def test_a_trigger_shows_the_time_around_it(client: Client) -> None:
    with running(count=100) as step:
        client.get("description")
        now = client.get("state")["stop"]
        entry = {"path": "encoder", "kind": "rising", "level": 0.0, "before": 0.5}
        client.send(type="window", id=9, paths=["encoder"], start=now, stop=now, width=1)
        level = float(client.get("points")[2][0, -1]) * 1.5
        client.send(type="live", id=1, paths=["encoder"], span=0.1, width=100, trigger=entry | {"level": level})
        client.send(type="measure", id=3, paths=["encoder"], start=0, stop=1)
        client.get("measured")
        step(200)
        head, times, low, _ = client.get("points")
        assert head["start"] == pytest.approx(head["trigger"] - 0.05)
        assert low[0][times < head["trigger"]].max() <= level < low[0][times >= head["trigger"]].min()


def test_a_page_is_answered_while_something_is_measured(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    monkeypatch.setattr(
        "umo.clients.page.subscriptions.measured", lambda times, values: {"waited": go_on.wait(PATIENCE)}
    )
    with running() as step:
        client.get("description")
        client.send(type="measure", id=1, paths=["encoder"], start=0, stop=1)
        client.send(type="stop", id="none")
        assert client.get("error")["id"] == "none"
        stop = client.get("state")["stop"]
        step(3)
        eventually(lambda: client.get("state")["stop"] > stop)
        go_on.set()
        assert client.get("measured")["values"] == [{"waited": True}]


def test_a_page_gets_states_while_a_black_box_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    monkeypatch.setattr(
        "umo.clients.page.watched_run.newest_box", lambda *given: BoxInWords("x", f"read: {go_on.wait(PATIENCE)}")
    )
    monkeypatch.setattr("umo.clients.page.feed.DISK_PAUSE", 0.01)
    with running() as step, serving() as served, opened(served.socket) as client:
        client.get("description")
        stop = client.get("state")["stop"]
        step(3)
        eventually(lambda: client.get("state")["stop"] > stop)
        go_on.set()
        eventually(lambda: client.get("state")["box"] == "read: True")


def test_a_span_beyond_all_time_is_all_there_is(client: Client) -> None:
    with running(count=50):
        client.get("description")
        for span in (10**25, 1e308):
            client.send(type="live", id=1, paths=["encoder"], span=span, width=10)
            assert client.get("points")[0]["from"] == -1


def test_a_page_that_nothing_can_be_sent_to_any_longer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(live: Subscription) -> None:
        raise ZeroDivisionError

    with running(), serving() as served, opened(served.socket) as client:
        client.get("description")
        monkeypatch.setattr(Subscription, "next", broken)
        client.send(type="live", id=1, paths=["encoder"], span=1, width=10)
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                client.get("state")
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1011
        monkeypatch.undo()
        with opened(served.socket) as again:
            again.get("description")


def test_a_page_whose_client_cannot_be_closed_harms_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[bool] = []

    class Stuck(PageClient):
        async def close(self) -> None:
            await super().close()
            closed.append(True)
            raise ZeroDivisionError

    monkeypatch.setattr("umo.clients.page.session.PageClient", Stuck)
    with running(), serving() as served:
        with opened(served.socket) as client:
            client.get("description")
            client.send(type="command", id=1, do="lease")
            client.get("answer")
        eventually(lambda: closed)
        with opened(served.socket) as other:
            other.get("state")


def test_a_page_may_ask_for_a_bounded_number_of_answers(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    monkeypatch.setattr(
        "umo.clients.page.subscriptions.measured", lambda times, values: {"waited": go_on.wait(PATIENCE)}
    )
    with running():
        client.get("description")
        for number in range(MAX_REQUESTS + 2):
            client.send(type="measure", id=number, paths=["encoder"], start=0, stop=1)
        assert client.get("error")["text"] == f"a page may wait for at most {MAX_REQUESTS} answers"
        go_on.set()
        assert [client.get("measured")["id"] for _ in range(MAX_REQUESTS)] == list(range(MAX_REQUESTS))


MEANINGLESS: list[dict[str, object]] = [
    {"type": "live", "id": 1, "paths": ["nothing"], "span": 1, "width": 10},
    {"type": "live", "id": 1, "paths": "encoder", "span": 1, "width": 10},
    {"type": "live", "id": 1, "paths": ["encoder"], "span": "long", "width": 10},
    {"type": "live", "id": 1, "paths": ["encoder"], "span": 10**25 * 10**300, "width": 10},
    {"type": "live", "id": 1, "paths": ["encoder"], "span": float("inf"), "width": 10},
    {"type": "live", "id": "x", "paths": ["encoder"], "span": 1, "width": 10},
    {"type": "live", "id": 1, "paths": ["encoder"] * 100, "span": 1, "width": 10},
    {"type": "live", "id": 1, "paths": ["encoder"], "span": 1, "width": 10, "trigger": {"kind": "sideways"}},
    {"type": "window", "id": 1, "paths": ["encoder"], "start": 2, "stop": 1, "width": 10},
    {"type": "window", "id": 1, "paths": ["encoder"], "start": float("nan"), "stop": 1, "width": 10},
    {"type": "dance", "id": 1},
    {"type": "watch", "name": 3},
    {"type": "watch", "name": None},
    {"type": "watch", "name": "press", "place": 3},
]


def test_a_message_without_meaning_is_answered_and_the_page_goes_on(client: Client) -> None:
    with running():
        client.get("description")
        for message in MEANINGLESS:
            client.send(**message)
            assert client.get("error")["text"], message
            client.send_text("not JSON")
            assert client.get("error")["text"]
        client.get("state")


def test_a_value_of_bad_quality_is_no_value_in_the_history() -> None:
    frames = np.zeros(2, [("time", "f8"), ("values", "f8", 2), ("quality", "u1", 2), ("signals", "f8", 1)])
    frames["values"] = 7.0
    frames["quality"][1] = (Quality.STALE, Quality.BAD)
    history = History(3, 0.001)
    history.add_frames(frames)
    values = history.between(0.0, 1.0, range(3)).values
    assert values[0].tolist() == [7.0, 7.0]
    assert np.isnan(values[1]).tolist() == [False, True]
    assert np.isnan(values).sum() == 1
    some = History(2, 0.001)
    some.add_frames(frames, [2, 0])
    assert some.between(0.0, 1.0, range(2)).values.tolist() == [[0.0, 0.0], [7.0, 7.0]]


@contextmanager
def ring_about(**about: Any) -> Iterator[None]:
    """A ring of a living process whose description lacks what every run has."""
    layout = Layout((), (), about)
    head, places = arrange(layout, 16, 16)
    ends, readers = RunDescriptors.pair()
    fill(ends.frames, head, places.size, private=True).close()
    fill(ends.cells, b"", size_of(layout), private=False).close()
    server = FrameServer(folder() / "nameless-1-ff.sock", readers)
    server.listen()
    server.start()
    yield
    server.close()
    ends.close()
    readers.close()


@pytest.mark.parametrize("about", [{}, {"station": "press"}, {"station": "press", "wiring": "", "period": 0.001}])
def test_a_ring_that_makes_no_sense_is_left_out_and_said_once(
    capfd: pytest.CaptureFixture[str], about: dict[str, Any]
) -> None:
    with running() as step, ring_about(**about):
        looking = Feed()
        search(looking)
        search(looking)
        assert list(looking.watched) == ["press"]
        step(3)
        looking.look(states=True)
        assert looking.watched["press"].history.stop == pytest.approx(0.053)
        looking.close()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("umo: nameless-1-ff.sock is not shown")


def test_a_ring_that_cannot_be_read_is_dropped_and_the_others_go_on(
    client: Client, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    real = Watched.read

    def broken(watched: Watched) -> None:
        if watched.station == "oven":
            raise IndexError("no such row")
        real(watched)

    with running("press") as step, running("oven"):
        eventually(lambda: len(client.get("stations")["stations"]) == 2)
        client.send(type="watch", name="press")
        monkeypatch.setattr(Watched, "read", broken)
        while [line["name"] for line in client.get("stations")["stations"]] != ["press"]:
            pass
        now = client.get("state")["stop"]
        step(3)
        eventually(lambda: client.get("state")["stop"] > now)
    assert capfd.readouterr().err.count("is not shown: IndexError: no such row") == 1


def test_a_run_whose_end_cannot_be_looked_for_hides_no_other(
    client: Client, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def look(about: dict[str, Any], known: BoxInWords) -> BoxInWords:
        if about["station"] == "oven":
            raise TypeError("about what?")
        return BoxInWords("x", "read")

    monkeypatch.setattr("umo.clients.page.watched_run.newest_box", look)
    monkeypatch.setattr("umo.clients.page.feed.DISK_PAUSE", 0.01)
    with running("oven"), running("press"):
        eventually(lambda: [line["name"] for line in client.get("stations")["stations"]] == ["press"])
        client.send(type="watch", name="press")
        eventually(lambda: client.get("state")["box"] == "read")
    assert capfd.readouterr().err.count("is not shown: TypeError: about what?") == 1


def test_a_run_whose_state_cannot_be_told_is_dropped_and_the_page_goes_on(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(reader: Reader, start: int = 0) -> list[Any]:
        raise ValueError("7 is not a valid CommandState")

    monkeypatch.setattr(Reader, "events", broken)
    with running("press"):
        client.get("description")
        assert client.get("stations")["stations"] == []
        monkeypatch.undo()
        with running("oven"):
            client.send(type="watch", name="oven")
            assert client.get("description")["name"] == "oven"


def test_a_ring_that_could_not_be_opened_for_a_moment_is_shown_later(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Any) -> Reader:
        raise FramesError(f"no frames at {path}: Too many open files")

    monkeypatch.setattr(feed, "RETRY_PAUSE", 0.0)
    with running(), monkeypatch.context() as patch:
        looking = Feed()
        patch.setattr("umo.clients.page.feed.Reader", full)
        search(looking)
        assert looking.watched == {}
        patch.undo()
        search(looking)
        assert list(looking.watched) == ["press"]
        looking.close()


def test_the_server_ends_with_its_feed_and_tells_why(monkeypatch: pytest.MonkeyPatch) -> None:
    async def broken(looking: Feed) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Feed, "run", broken)
    with listen("127.0.0.1", 0) as listening:
        serving = server(Options("127.0.0.1", listening.getsockname()[1], TOKEN), lambda: None)
        thread = Thread(target=serving.run, kwargs={"sockets": [listening]})  # Playwright may be running in this one
        thread.start()
        thread.join(PATIENCE)
        assert not thread.is_alive()
    assert isinstance(serving.failure, ZeroDivisionError)


def test_an_end_while_a_twin_loads_is_no_error_of_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, go_on, told = threading.Event(), threading.Event(), list[str]()

    def slow(*given: Any) -> None:
        asked.set()
        go_on.wait(PATIENCE)

    class Told(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            told.append(record.getMessage())

    monkeypatch.setattr("umo.clients.page.server.described_twin", slow)
    monkeypatch.setattr("umo.clients.page.server.GRACE_TIME", 0)
    with running(), serving() as served:
        monkeypatch.setattr(logging.getLogger("uvicorn.error"), "handlers", [Told()])
        with opened(served.socket) as client:
            client.get("description")

        def load() -> None:
            with suppress(OSError, HTTPException):  # the server has ended
                urllib.request.urlopen(served.url.replace("/?", "/twin/press?")).close()
            go_on.set()

        loading = Thread(target=load)
        loading.start()
        assert asked.wait(PATIENCE)
    loading.join()
    assert told == []


def test_a_ring_that_cannot_be_told_takes_no_page_from_another_station(
    client: Client, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    line = Watched.line

    def garbled(self: Watched) -> dict[str, Any]:
        return {"raised": int(float("inf"))} if self.name == "tank" else line(self)

    monkeypatch.setattr(Watched, "line", garbled)
    with running(), alarming():
        eventually(lambda: "is not shown: " in capfd.readouterr().err)
        assert client.get("description")["name"] == "press"
        assert client.get("state")["stage"] == "running"
