"""What a page that runs for ever keeps of runs that have gone."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from umo.clients.page import feed as feeds
from umo.clients.page import fleet_feed
from umo.clients.page.feed import Feed
from umo.clients.page.fleet_feed import UNSEEN_TIME, FleetFeed
from umo.errors import FramesError


def test_rings_that_cannot_be_read_are_forgotten_when_they_have_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    there: list[Path] = []
    monkeypatch.setattr(feeds, "rings", lambda: list(there))
    monkeypatch.setattr(feeds, "_opened", lambda paths: [(path, FramesError("damaged")) for path in paths])
    feed = Feed()

    async def work() -> None:
        for number in range(300):
            there[:] = [Path(f"plant-{number}.ring")]
            await feed.search()
            assert list(feed._refused) == [there[0].name]

    with ThreadPoolExecutor(1) as thread:  # Playwright's loop may be running in this one
        thread.submit(asyncio.run, work()).result()


def test_a_mirror_that_nobody_saw_is_closed_and_begins_anew_when_it_is_opened_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr(fleet_feed, "time", SimpleNamespace(monotonic=lambda: now[0]))
    fleet = FleetFeed.__new__(FleetFeed)
    fleet._unseen = {}
    for number in range(100):
        watched: Any = SimpleNamespace(name=f"cell/plant-{number // 2}", viewers=0)
        assert not fleet.is_unseen(watched)
        now[0] += UNSEEN_TIME + 1.0
        assert fleet.is_unseen(watched)
        assert not fleet._unseen
