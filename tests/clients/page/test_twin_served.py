"""The twin of a station that runs, in a headless browser, served by `umo show page`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlparse

import pytest

from umo import connect, drive
from umo.process.frames import published
from umo.process.station import find
from umo.stations.ztheta.control import Manipulator
from umo.stations.ztheta.objects import machine

from .conftest import complaints_of, viewing

pytest.importorskip("mujoco")
pytest.importorskip("uvicorn", reason="the page needs the extra `page`")


@pytest.fixture
def running() -> Iterator[Callable[[Any], float]]:
    """z-theta in virtual time, published: a call lets it carry out a sequence, and gives z in um at its end."""
    station = find("ztheta")
    m = machine()
    connection = connect(m, station.wirings["simulated"], seed=3)

    def carry_out(sequence: Any) -> float:
        drive(m, sequence)
        return m.z.encoder.read()

    with connection, published(connection, "ztheta", "simulated", place=station.path):
        yield carry_out


@pytest.fixture
def address() -> Iterator[str]:
    """Of a server of the page."""
    with viewing() as (_, address):
        yield address


async def home(m: Manipulator) -> None:
    await m.home()


async def up(m: Manipulator) -> None:
    await m.z.move_to(100_000.0)


@pytest.mark.slow
def test_a_body_stands_where_the_station_is_live_and_in_its_past(chromium: Any, running: Any, address: str) -> None:
    homed = running(home)
    page = chromium.new_page()
    complaints = complaints_of(page)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    page.get_by_role("tab", name="Twin").click()
    page.evaluate("async () => { window.twin = await import('/static/twin.js'); }")
    reached = "([um, by]) => Math.abs(twin.View.shown?.scene.pose('z').position[2] * 1e6 - um) < by"
    page.wait_for_function(reached, arg=[homed, 0.1])
    before = page.evaluate("twin.View.shown.feed.range().stop")
    page.wait_for_function(reached, arg=[running(up), 0.1])
    page.wait_for_function("(t) => twin.View.shown.feed.range().stop > t", arg=before)
    page.evaluate("(t) => twin.View.shown.player.seek(t)", before)
    page.wait_for_function(reached, arg=[homed, 20.0])  # a sample of the past is the mean over 10 ms
    page.close()
    assert complaints == []
    hosts = {urlparse(url).netloc for url in asked if not url.startswith(("data:", "blob:"))}
    assert hosts == {urlparse(address).netloc}
