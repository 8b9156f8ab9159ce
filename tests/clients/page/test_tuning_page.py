"""The tuning of a law on the page: an experiment, the plot, accepting and rejecting; by websocket and in a browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers import cascaded, lagging
from umo.process.start import LINUX

from .conftest import Client, Served, control, eventually, opened, serving, take_lease

pytest.importorskip("scipy")
pytestmark = [pytest.mark.full, pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")]


EXPERIMENT = 90.0
"""s: it takes 12 s, and longer on a busy computer."""


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Iterator[umo.RemoteStation]:
    """One run for all tests, in manual mode."""
    folder = tmp_path_factory.mktemp("tank")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("UMO_FRAMES", str(folder / "frames"))
        patch.setenv("UMO_STATE", str(folder / "state"))
        with umo.start(str(lagging.station(folder)), manual=True, realtime=True) as process:
            eventually(lambda: process.stage.name == "RUNNING")
            with umo.attach(process.pid) as station:
                eventually(lambda: station.reader.head > 5)
                yield station


@pytest.fixture
def served(tank: umo.RemoteStation, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setenv("UMO_FRAMES", str(tank.reader.path.parent))
    with serving() as served:
        yield served
    eventually(lambda: not tank.reader.now().holder)


FACTS = {
    "law": "servo",
    "sensor": "level",
    "actuator": "valve",
    "gain": 0.05,
    "integral_time": 2.0,
    "derivative_time": 0.0,
    "filter_time": 0.0,
    "dt": 0.01,
    "axis": False,
}


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({"facts": {}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": [], "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"gain": "a lot"}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"gain": float("nan")}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"dt": 0.0}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"integral_time": -1e-300}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"filter_time": -1.0}, "start": 0.0, "stop": 1.0}, "facts must be the facts of a law"),
        ({"facts": FACTS | {"sensor": "nothing"}, "start": 0.0, "stop": 1.0}, "there is no object or signal 'nothing'"),
        ({"facts": FACTS, "start": 5.0, "stop": 1.0}, "stop must not be before start"),
        ({"facts": FACTS, "start": 0.0, "stop": 1e9}, "s long"),
        ({"facts": FACTS, "start": 1e7, "stop": 1e7}, "samples have a time"),
    ],
)
def test_questions_without_an_answer_are_told_in_words(served: Served, message: dict[str, Any], error: str) -> None:
    with opened(served.socket) as client:
        watching(client)
        client.send(type="tune law", id=7, **message)
        found = client.get("error")
        assert found["id"] == 7
        assert error in found["text"]


def watching(client: Client) -> None:
    client.get("description")
    client.get("state")


@pytest.mark.slow
@pytest.mark.full
def test_an_experiment_of_a_page_ends_with_its_gains(served: Served, tank: umo.RemoteStation) -> None:
    with opened(served.socket) as client:
        watching(client)
        client.send(type="command", id=1, do="lease")
        eventually(lambda: client.get("answer")["state"] == "done")
        client.send(
            type="command", id=2, do="call", path="servo.experiment", arguments={"kind": "step", "amplitude": 10.0}
        )
        ended: dict[str, Any] = {}
        while ended.get("state") not in ("done", "failed", "cancelled", "refused"):
            state = client.get("state")
            client.send(type="touch", number=state["number"], held=["servo.experiment"])
            if state.get("events") and (last := state["events"][-1])["path"] == "servo.experiment":
                ended = last
        assert ended["state"] == "done"
        span = json.loads(ended["text"])
        client.send(type="tune law", id=3, facts=FACTS, start=span["from"] - 0.2, stop=span["to"])
        found = client.get("tuned")
        assert [each["name"] for each in found["sets"]] == ["present", "cautious", "balanced", "quick"]
        assert found["sets"][2]["gain_margin"] >= 2.0
        assert len(found["times"]) == len(found["measured"]) == len(found["predicted"]) <= 300


@pytest.mark.slow
def test_the_gains_are_found_and_accepted_or_rejected_in_a_browser(
    served: Served, tank: umo.RemoteStation, page: Any, tmp_path: Path
) -> None:
    take_lease(page, served.url)
    panel = control(page, "servo").filter(has=page.get_by_role("button", name="Begin"))
    panel.get_by_role("button", name="Begin").click()
    panel.get_by_role("table").wait_for(timeout=1000 * EXPERIMENT)
    assert panel.locator("svg polyline").count() == 4
    panel.screenshot(path=str(tmp_path / "tuned.png"))
    before = float(tank["servo.gain"])
    panel.get_by_role("button", name="Reject").click()
    assert not panel.get_by_role("table").is_visible()
    assert tank["servo.gain"] == before
    panel.get_by_role("button", name="Begin").click()
    panel.get_by_label("quick").click(timeout=1000 * EXPERIMENT)
    panel.get_by_role("button", name="Accept").click()
    eventually(lambda: tank["servo.gain"] != before)
    panel.get_by_text("the quick gains are in effect until the run ends").wait_for()
    control(page, "servo.gain").get_by_role("button", name="Undo").click()
    eventually(lambda: tank["servo.gain"] == before)


@pytest.mark.slow
def test_an_experiment_is_cancelled_in_a_browser(served: Served, tank: umo.RemoteStation, page: Any) -> None:
    take_lease(page, served.url)
    panel = control(page, "servo").filter(has=page.get_by_role("button", name="Begin"))
    panel.get_by_label("servo experiment").select_option("step")
    panel.get_by_role("button", name="Begin").click()
    eventually(lambda: tank.valve.read() > 36.0)
    panel.get_by_role("button", name="Cancel").click()
    panel.get_by_text("cancelled").wait_for()
    eventually(lambda: tank.valve.read() < 34.0)


@pytest.fixture
def reactor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[umo.RemoteStation]:
    """A cascade, in manual mode."""
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    with umo.start(str(cascaded.station(tmp_path)), manual=True, realtime=True) as process:
        eventually(lambda: process.stage.name == "RUNNING")
        with umo.attach(process.pid) as station:
            eventually(lambda: station.reader.head > 5)
            yield station


@pytest.mark.slow
@pytest.mark.full
def test_the_outer_law_of_a_cascade_is_tuned_in_a_browser(
    reactor: umo.RemoteStation, page: Any, tmp_path: Path
) -> None:
    with serving() as served:
        take_lease(page, served.url)
        panel = control(page, "vessel_law").filter(has=page.get_by_role("button", name="Begin"))
        panel.get_by_role("button", name="Begin").click()
        panel.get_by_role("table").wait_for(timeout=1000 * EXPERIMENT)
        panel.screenshot(path=str(tmp_path / "tuned.png"))
        assert "; inner loop: " in panel.inner_text()  # a process that looks as if it integrates has no ratio to it
        before = float(reactor["vessel_law.gain"])
        panel.get_by_role("button", name="Accept").click()
        eventually(lambda: reactor["vessel_law.gain"] != before)
