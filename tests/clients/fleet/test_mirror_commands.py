"""The commands of a mirror: what it keeps of each ends with its last answer, however long a mirror lives."""

from __future__ import annotations

import itertools
import json
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleets import PLANT
from umo.clients.fleet import mirror_commands
from umo.clients.fleet.fleet_keys import segment
from umo.clients.fleet.mirror_commands import EVENT_WAIT, MirrorCommands
from umo.clients.remote.who import UNVERIFIED, who_text
from umo.cycle.events import CommandState, Event
from umo.operation.commands.client_commands import ClientCommand


class Station:
    """In place of a session: answers each command with a number, then with its end. `is_lost`: with nothing."""

    def __init__(self) -> None:
        self.numbers = itertools.count(1000)
        self.number = 0
        self.is_lost = False
        self.cells = SimpleNamespace(stop=None, signed=lambda path, lease: 0.0)
        self.keys: list[str] = []
        self.asked: list[dict[str, Any]] = []

    def get(self, key: str, handler: Any, payload: str, **more: Any) -> None:
        self.asked.append(json.loads(payload))
        self.keys.append(key)
        self.number = next(self.numbers)
        for answer in () if self.is_lost else ({"number": self.number}, {"result": 1}):
            handler.callback(SimpleNamespace(ok=SimpleNamespace(payload=json.dumps(answer).encode())))
        handler.drop()

    def put(self, key: str, data: bytes) -> None: ...


def rig(
    monkeypatch: pytest.MonkeyPatch, user: str = "ann"
) -> tuple[MirrorCommands, Station, list[ClientCommand], list[Event], list[float]]:
    """Commands of a mirror whose time is given: also what comes in, what is told, and the time."""
    coming: list[ClientCommand] = []
    told: list[Event] = []
    now, station = [0.0], Station()
    inbox = SimpleNamespace(get=lambda: coming.pop(0) if coming else None, taken=0, dropped=0)
    monkeypatch.setattr(mirror_commands, "Receiver", lambda cells: inbox)
    monkeypatch.setattr(mirror_commands, "time", SimpleNamespace(monotonic=lambda: now[0], time=lambda: now[0]))
    station.cells.signed = lambda path, lease: now[0]
    ring: Any = SimpleNamespace(cells=station.cells, live=lambda given: None, lease=lambda *given: None)
    session: Any = station
    return MirrorCommands(session, PLANT, user, ring, told.append), station, coming, told, now


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_mirror_that_commands_for_a_year_keeps_nothing_of_it(monkeypatch: pytest.MonkeyPatch, is_lost: bool) -> None:
    commands, station, coming, told, now = rig(monkeypatch)
    coming.append(ClientCommand(1, "ann", "key", do="lease"))
    commands.look()
    now[0] += 2 * EVENT_WAIT
    commands.look()
    station.is_lost = is_lost
    for number in range(2, 400):
        coming.append(ClientCommand(number, "ann", "key", do="tune", path="a"))
        commands.look()
        if number % 2 and not is_lost:  # the machine's own event comes first
            assert commands.local(station.number) == number
            commands.has_ended(number)
        commands.taken(station.number)
        now[0] += 80_000.0
        commands.look()
    assert len(told) == 399 - (0 if is_lost else 199)
    assert {each.state for each in told[1:]} == {CommandState.REFUSED if is_lost else CommandState.DONE}
    kept = [each for each in vars(commands).values() if isinstance(each, dict | list | set)]
    assert len(kept) >= 4
    assert not any(kept)


def test_what_the_mirror_sends_itself_has_no_number_here(monkeypatch: pytest.MonkeyPatch) -> None:
    commands, station, *_ = rig(monkeypatch)
    station.cells.stop = (1, "ann")
    commands.look()
    assert [each["do"] for each in station.asked] == ["stop"]
    assert commands.local(station.number) == 0
    assert commands.taken(station.number) == 0


def test_what_the_station_has_taken_is_told_by_the_numbers_here(monkeypatch: pytest.MonkeyPatch) -> None:
    commands, _, coming, _, now = rig(monkeypatch)
    assert commands.taken(999) == 0
    coming.append(ClientCommand(1, "ann", "key", do="lease"))
    commands.look()
    now[0] += 2 * EVENT_WAIT
    commands.look()
    coming += [ClientCommand(number, "ann", "key", do="write", path="a", value=1.0) for number in (2, 3)]
    commands.look()
    assert [commands.taken(count) for count in (999, 1000, 1001, 1001, 1002, 5000)] == [0, 1, 2, 2, 3, 3]


def test_a_command_that_the_station_takes_later_is_not_told_as_taken_before(monkeypatch: pytest.MonkeyPatch) -> None:
    commands, station, coming, *_ = rig(monkeypatch)
    station.numbers = iter([1001, 1000])  # type: ignore[assignment]
    coming += [ClientCommand(number, "ann", "key", do="lease") for number in (1, 2)]
    commands.look()
    assert [commands.taken(count) for count in (1000, 1001)] == [0, 2]


def test_what_a_visitor_of_a_page_asks_for_is_passed_on_as_unverified_and_let_go_of_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    commands, station, coming, _, now = rig(monkeypatch)
    who = who_text("Mallory", f"{UNVERIFIED} (page, 10.0.0.7)")
    for number, do in enumerate(("lease", "write"), 1):
        coming.append(ClientCommand(number, who, "key", do=do, path="a"))
        commands.look()
        now[0] += 2 * EVENT_WAIT
        commands.look()
    now[0] += 10.0
    station.cells.signed = lambda path, lease: now[0] - (9.0 if path else 0.0)
    commands.look()
    assert [each["do"] for each in station.asked] == ["lease", "write", "let go"]
    assert all(each.get("unverified") for each in station.asked)
    station.cells.stop = (1, who_text("ann", " (page, 127.0.0.1)"))
    commands.look()
    assert station.asked[-1]["do"] == "stop"
    assert "unverified" not in station.asked[-1]


def test_a_second_client_of_a_mirror_is_refused_the_lease_until_the_first_is_gone_unless_it_takes_it_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    commands, station, coming, told, now = rig(monkeypatch)

    def answer_to(key: str, do: str, over: bool = False) -> str:
        coming.append(ClientCommand(len(told) + 1, key, key, do=do, path="a", over=over))
        commands.look()
        now[0] += 2 * EVENT_WAIT
        commands.look()
        return told[-1].text

    assert answer_to("bob", "tune") == "CommandRefused: nobody has the lease; take it first"
    assert answer_to("ann", "lease") == "1"
    assert answer_to("bob", "tune") == answer_to("bob", "lease") == "LeaseHeld: ann has the lease"
    assert answer_to("bob", "lease", over=True) == "1"
    assert answer_to("ann", "tune") == "LeaseHeld: bob has the lease"
    station.cells.signed = lambda path, lease: 0.0  # bob sends no heartbeat any more
    now[0] += 10.0
    commands.look()
    assert answer_to("ann", "tune") == "CommandRefused: nobody has the lease; take it first"
    assert [each["do"] for each in station.asked] == ["lease", "lease"]


def test_a_user_is_in_keys_as_in_the_settings_and_the_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    """`FleetSettings.user` is one word of a key already: escaped twice it is another user."""
    commands, station, *_ = rig(monkeypatch, user=segment("ann b"))
    station.cells.stop = (1, "ann b")
    commands.look()
    assert station.keys == [PLANT.key("command", segment("ann b"))]
