"""What a gateway keeps of runs that have ended."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from umo.clients.fleet.fleet_commands import FleetUsers
from umo.clients.fleet.fleet_gateway import AFTER_END, MOST_ENDED, FleetGateway
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.run_feed import LONGEST_SILENCE, RunFeed


def closed_of(*stations: str, now: float = 0.0) -> list[int]:
    """Places of the runs that are closed at a time, of runs that ended one after the other."""
    closed: list[int] = []
    gateway = FleetGateway(None, "c1", FleetUsers(), find=list)  # type: ignore[arg-type]
    for place, name in enumerate(stations):
        run: Any = SimpleNamespace(key=StationKey("c1", name), close=lambda place=place: closed.append(place))
        gateway._ended.append((AFTER_END, run))
    gateway._forget(now)
    gateway._forget(now)
    return sorted(closed)


def test_all_stations_of_a_gateway_that_end_at_once_are_kept() -> None:
    assert closed_of(*(f"s{number}" for number in range(200))) == []
    assert closed_of("a", "b", now=AFTER_END) == [0, 1]


def test_of_a_station_that_ends_again_and_again_the_last_runs_are_kept() -> None:
    assert closed_of("a", *["b"] * (MOST_ENDED + 2)) == [1, 2]


@pytest.mark.parametrize("away", [3.0, 14.5, 31.0, 50.0])
def test_a_run_that_has_ended_is_asked_for_in_time_however_long_the_network_was_away(away: float) -> None:
    feed = RunFeed(b"12345678", 0, 0, 0.0)
    asked = [now for now in np.arange(0.0, 300.0, 0.1) if feed.request(now) is not None]
    assert next(now for now in asked if now >= away) <= min(away + LONGEST_SILENCE + 0.2, AFTER_END)
