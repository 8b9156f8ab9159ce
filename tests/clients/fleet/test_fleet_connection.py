"""A gateway and a recorder wait for their router, and tell when it is away."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleets import free_port
from umo.clients.fleet.fleet_session import FleetAway, FleetNetwork, opened
from umo.errors import UmoError
from umo_command.connect import fleet_connection
from umo_command.connect.fleet_connection import opened_patiently


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    told: list[str] = []
    monkeypatch.setattr(fleet_connection, "say", told.append)
    monkeypatch.setattr(fleet_connection, "RETRY_DELAY", 0.0)
    monkeypatch.setattr(fleet_connection, "LOOK", 0.0)
    return told


def test_who_begins_before_the_router_waits_for_it_and_says_so_once(said: list[str]) -> None:
    answers: list[Any] = [FleetAway("nobody"), FleetAway("nobody"), "session"]

    def open() -> Any:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    assert opened_patiently(open, lambda: False) == "session"
    assert said == ["nobody; waiting for it"]


def test_who_is_stopped_meanwhile_has_no_session(said: list[str]) -> None:
    def open() -> Any:
        raise FleetAway("nobody")

    assert opened_patiently(open, lambda: bool(said)) is None


def test_what_waiting_does_not_change_is_an_error(said: list[str]) -> None:
    def open() -> Any:
        raise UmoError("a wrong certificate")

    with pytest.raises(UmoError, match="wrong certificate"):
        opened_patiently(open, lambda: False)


def test_a_router_that_is_not_there_may_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.fleet.fleet_session.CONNECT_TIME", 200)
    with pytest.raises(FleetAway, match="nothing answers at this address"):
        opened(FleetNetwork(connect=[f"tcp/127.0.0.1:{free_port()}"]), "client")
    with pytest.raises(UmoError, match="no computer") as told:
        opened(FleetNetwork(connect=["tcp/nowhere.invalid:7447"]), "client")
    assert not isinstance(told.value, FleetAway)


def test_it_is_told_when_the_fleet_is_away_and_when_it_is_reached_again(said: list[str]) -> None:
    routers = [["r"], [], [], ["r"], ["r"]]

    class Session:
        def is_closed(self) -> bool:
            return not routers

        @property
        def info(self) -> Any:
            now = routers.pop(0)
            return SimpleNamespace(routers_zid=lambda: now, peers_zid=list)

    fleet_connection._tell(Session())  # type: ignore[arg-type]
    assert said == ["the fleet cannot be reached; waiting for it", "the fleet can be reached again"]
