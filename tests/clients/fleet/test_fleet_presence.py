"""Which stations a fleet has, and what they tell of themselves."""

from __future__ import annotations

import asyncio
import json
import sys
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleets import PLANT, Fleet, fleet_of
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.fleet import fleet_settings
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_presence import DEBOUNCE, FleetPresence, status_in, statuses
from umo_command.show import fleet_stations as ps

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


class Silent:
    """A session in which nobody answers."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.hear: dict[str, Any] = {}
        """What is called with each message, by the last word of its key."""

    def declare_subscriber(self, key: str, hear: Any, **more: Any) -> Any:
        self.hear[key.rpartition("/")[2]] = hear
        return SimpleNamespace(undeclare=lambda: None)

    def token(self, comes: bool, key: StationKey = PLANT) -> None:
        """The token of a station comes, or is gone."""
        import zenoh

        kind = zenoh.SampleKind.PUT if comes else zenoh.SampleKind.DELETE
        self.hear["alive"](SimpleNamespace(key_expr=key.key("alive"), kind=kind))

    def tell(self, text: str) -> None:
        self.hear["status"](SimpleNamespace(key_expr=PLANT.key("status"), payload=text.encode()))

    def liveliness(self) -> Silent:
        return self

    def get(self, key: str, *given: Any, **more: Any) -> None:
        self.asked.append(key)


def test_a_station_is_away_when_its_token_is_lost_for_longer_than_a_router_takes_to_begin_again() -> None:
    now, session = [0.0], Silent()
    presence = FleetPresence(session, lambda: now[0])  # type: ignore[arg-type]
    session.token(True)
    assert presence.stations()[0].is_present(now[0])
    session.token(False)
    now[0] = 0.9 * DEBOUNCE
    assert presence.stations()[0].is_present(now[0])
    now[0] = 1.1 * DEBOUNCE
    assert not presence.stations()[0].is_present(now[0])
    session.token(True)
    assert presence.stations()[0].is_present(now[0])


def test_a_station_that_has_ended_leaves_the_list_and_one_that_was_lost_stays() -> None:
    now, session = [0.0], Silent()
    presence = FleetPresence(session, lambda: now[0])  # type: ignore[arg-type]
    session.token(True)
    session.tell(json.dumps({"station": "plant", "state": "running"}))
    session.token(False)
    now[0] = 60.0
    assert [each.key for each in presence.stations()] == [PLANT]
    session.tell(json.dumps({"station": "plant", "state": "ended"}))
    assert presence.stations() == []


def test_a_station_that_comes_is_asked_for_its_status_and_all_of_a_large_fleet_by_one_question() -> None:
    session = Silent()
    presence = FleetPresence(session, lambda: 0.0)  # type: ignore[arg-type]
    session.token(True)
    presence.stations()
    assert session.asked == [PLANT.key("status")]
    for number in range(100):
        session.token(True, StationKey("cell7", f"s{number}"))
    assert len(presence.stations()) == 101
    presence.stations()
    assert session.asked[1:] == ["umo/*/*/status"]


@pytest.mark.parametrize("data", [b"", b"no json", b"[1]", b'{"state": 1}', b"[" * 100_000, b"\xff"])
def test_a_status_that_is_none_is_passed_over(data: bytes) -> None:
    assert status_in(data) is None


@linux
def test_a_client_is_told_state_mode_lease_and_alarms_of_each_station() -> None:
    async def work() -> None:
        async with TriedMachine() as machine, fleet_of(machine) as fleet:
            await fleet.client()
            session = await fleet.session()
            found = await until(lambda: statuses(session))
            assert list(found) == [PLANT]
            status = found[PLANT]
            assert (status["station"], status["state"], status["mode"]) == ("plant", "running", "automatic")
            machine.set("cell.level", 180)
            presence = FleetPresence(session)
            await until(lambda: [each.status.get("alarms") for each in presence.stations()] == [1])
            presence.close()
            session.close()  # type: ignore[no-untyped-call]

    asyncio.run(work())


@linux
def test_ps_lists_the_stations_of_the_fleet_or_says_that_there_are_none(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def settings(fleet: Fleet) -> None:
        place = fleet_settings.place()
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(f'connect = ["{fleet.address}"]')

    async def work() -> None:
        async with TriedMachine() as machine, fleet_of(machine) as fleet:
            await fleet.client()
            settings(fleet)
            await asyncio.to_thread(ps.ps_fleet, False)
            text = capsys.readouterr().out
            assert str(PLANT) in text
            assert "automatic" in text
            await asyncio.to_thread(ps.ps_fleet, True)
            assert json.loads(capsys.readouterr().out)[str(PLANT)]["state"] == "running"
            await machine.end()
            monkeypatch.setattr(ps, "SEARCH_TIME", 0.0)
            await until(lambda: fleet.said and "has ended" in fleet.said[-1])
            await asyncio.to_thread(ps.ps_fleet, False)
            assert "no station is in the fleet; `umo connect fleet`" in capsys.readouterr().out

    asyncio.run(work())
