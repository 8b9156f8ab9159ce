"""A station that is published over Zenoh, and seen and commanded from another session."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Awaitable, Callable
from itertools import pairwise
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

from helpers.fleets import PLANT, Fleet, asked, fleet_of
from umo import Quality
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.fleet.fleet_keys import station_key
from umo.cycle.stage import Stage
from umo.errors import CommandRefused, FramesError, LeaseHeld, OptionError, RangeError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


def tried(work: Callable[[TriedMachine, Fleet], Awaitable[None]], **more: Any) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine, fleet_of(machine, **more) as fleet:
            await work(machine, fleet)

    asyncio.run(all_of_it())


def values(client: Any) -> dict[str, Any]:
    return dict(client.reader.values(client.reader.latest()))


def quality(client: Any, path: str) -> Quality:
    frame = client.reader.latest()
    return Quality(int(frame["quality"][client.reader.index(path)]))


def test_values_states_qualities_and_times_arrive_as_they_are() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        machine.set("cell.level", 40)
        machine.set("cell.limit", 1)
        await until(lambda: (values(client)["cell.level"], values(client)["cell.limit"]) == (20.0, "FAIL"))
        machine.set("cell.level", OSError("unplugged"))
        await until(lambda: quality(client, "cell.level") is Quality.STALE)
        assert quality(client, "cell.limit") is Quality.GOOD
        frame = client.reader.latest()
        assert abs((int(frame["began"]) + int(frame["utc"])) * 1e-9 - time.time()) < 5.0
        assert client.reader.title.startswith("cell7/plant")

    tried(work)


def test_every_delta_arrives_once_and_in_order() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: client.reader.head > 15)
        numbers = client.reader.read()["number"].tolist()
        steps = {after - before for before, after in pairwise(numbers)}
        assert steps == {20}  # 50 a second of a period of 1 ms

    tried(work)


def test_a_gateway_that_is_begun_again_goes_on_where_the_last_one_was() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: client.reader.head > 5)
        await fleet.end()
        await asyncio.sleep(0)
        before = machine.number
        await until(lambda: machine.number > before + 100)
        await fleet.begin()
        await until(lambda: client.reader.head and client.reader.latest()["number"] > before + 100)
        numbers = client.reader.read()["number"].tolist()
        assert {after - before for before, after in pairwise(numbers)} - {0} == {20}  # 0: it grew stale

    tried(work)


def test_values_grow_stale_when_nothing_comes_and_are_good_again_when_it_does() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: quality(client, "cell.limit") is Quality.GOOD)
        machine.goes_on = False
        await until(lambda: quality(client, "cell.limit") is Quality.STALE)
        machine.goes_on = True
        await until(lambda: quality(client, "cell.limit") is Quality.GOOD)

    tried(work)


def test_a_gateway_that_was_away_for_long_does_not_bring_old_values_back() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: client.reader.head > 20)
        await fleet.end()
        await until(lambda: quality(client, "cell.limit") is Quality.STALE)
        await fleet.begin()
        await until(lambda: quality(client, "cell.limit") is Quality.GOOD)
        numbers = client.reader.read()["number"].tolist()
        assert {after - before for before, after in pairwise(numbers)} == {0, 20}  # 0: as it grew stale

    tried(work)


def test_what_comes_late_is_not_shown_as_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    held_up = [0.0]
    monkeypatch.setattr("umo.clients.fleet.arrival_ages.ArrivalAges.age", lambda ages, made: held_up[0])

    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: quality(client, "cell.limit") is Quality.GOOD)
        held_up[0] = 1.6
        await until(lambda: quality(client, "cell.limit") is Quality.STALE)
        held_up[0] = 0.5
        await until(lambda: quality(client, "cell.limit") is Quality.GOOD)

    tried(work)


def test_the_end_of_the_run_is_the_end_of_its_mirror_with_its_last_events() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await until(lambda: client.reader.head > 3)
        await machine.end()
        await until(lambda: client.reader.state is Stage.ENDED)
        assert client.reader.end is not None
        machine.begin()
        again = await fleet.client()
        await until(lambda: again.reader.head > 3)

    tried(work)


def test_commands_under_a_lease_are_carried_out_or_refused_in_the_machines_words() -> None:
    def commands(client: Any, machine: TriedMachine) -> None:
        with client.lease("tester"):
            client.cell.gain = 2.5
            assert machine.m.cell.gain == 2.5
            with pytest.raises(RangeError, match="outside 0 to 10"):
                client.cell.gain = 11
            assert client.cell.add(2.0) == 4.0
            client.mode = "manual"
        with pytest.raises(CommandRefused):
            client.cell.gain = 3.0

    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        await asyncio.to_thread(commands, client, machine)
        assert machine.m.cell.gain == 2.5
        tuned = [each for each in machine.events if each.path == "cell.gain"]
        assert tuned[0].who == "ann, unverified (fleet)"
        assert [each for each in client.events if each.path == "cell.gain"]

    tried(work)


def test_one_client_has_the_lease_until_it_is_gone_and_what_it_held_ends_with_it() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        ann, bob = await fleet.client("ann"), await fleet.client("bob")
        lease = ann.lease("ann")
        await asyncio.to_thread(lease.__enter__)

        def drive() -> None:
            ann.mode = "manual"
            ann.cell.valve.write(5.0)

        await asyncio.to_thread(drive)
        assert values(ann)["cell.valve"] == 5.0 or await until(lambda: values(ann)["cell.valve"] == 5.0)
        with pytest.raises(LeaseHeld, match="ann"):
            await asyncio.to_thread(bob.lease("bob").__enter__)
        await asyncio.to_thread(ann.reader.close)  # as a client that dies: no heartbeat comes any more
        await until(lambda: values(bob)["cell.valve"] == 0.0)
        taken = bob.lease("bob")
        await asyncio.to_thread(taken.__enter__)
        await asyncio.to_thread(taken.give_back)

    tried(work)


def test_a_gateway_that_only_reads_refuses_every_command() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        client = await fleet.client()
        with pytest.raises(CommandRefused, match="can only read"):
            await asyncio.to_thread(client.lease("ann").__enter__)

    tried(work, read_only=True)


def test_a_command_that_comes_twice_is_carried_out_once_and_has_one_answer() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        session = await fleet.session()
        await fleet.client()
        command = {"do": "call", "path": "cell.add", "arguments": {"weight": 1.0}, "id": "f" * 32}
        first = await asked(session, "ann", **command)
        second = await asked(session, "ann", **command)
        assert first == second
        assert "result" in first[-1]
        calls = [each for each in machine.events if each.path == "cell.add" and each.state.name == "DONE"]
        assert len(calls) == 1
        session.close()  # type: ignore[no-untyped-call]

    tried(work)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"until": 1.0, "sent": 0.0}, "too late"),
        ({"sent": 4e9, "until": 4e9 + 1}, "future"),
        ({"until": 4e9}, "valid for too long"),
        ({"id": "short"}, "not a command"),
        ({"do": 7}, "not a command"),
        ({"do": "lease all"}, "lease all"),
    ],
)
def test_a_command_out_of_time_or_form_is_refused(change: dict[str, Any], words: str) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        session = await fleet.session()
        await fleet.client()
        answers = await asked(session, "ann", **({"do": "tune", "path": "cell.gain", "value": 3.0} | change))
        assert words in answers[-1]["error"]
        assert machine.m.cell.gain == 1.0
        session.close()  # type: ignore[no-untyped-call]

    tried(work)


def test_a_command_of_before_the_gateway_began_is_refused() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        session = await fleet.session()
        await fleet.client()
        sent = time.time() - 20.0
        command = {"do": "tune", "path": "cell.gain", "value": 3.0, "sent": sent, "until": sent + 30.0}
        assert "before the gateway started" in (await asked(session, "ann", **command))[-1]["error"]
        assert machine.m.cell.gain == 1.0
        session.close()  # type: ignore[no-untyped-call]

    tried(work)


def test_a_station_that_is_not_there_is_told_with_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        await fleet.client()
        from umo.clients.fleet.fleet_mirror import find
        from umo.clients.fleet.fleet_session import FleetNetwork
        from umo.clients.fleet.fleet_settings import FleetSettings

        monkeypatch.setattr("umo.clients.fleet.fleet_mirror.ANSWER_TIME", 0.5)
        settings = FleetSettings("desk", FleetNetwork(connect=[fleet.address]), "ann")
        with pytest.raises(FramesError, match=f"there are: {PLANT}"):
            await asyncio.to_thread(find, "cell7/plent", settings)

    tried(work)


def test_a_name_of_a_fleet_has_a_site_and_a_station() -> None:
    assert station_key("cell7/press") == ("cell7", "press")
    for wrong in ("press", "a/b/c", "/press", "cell 7/press", "cell7/"):
        with pytest.raises(Exception, match="SITE/STATION"):
            station_key(wrong)


def test_a_second_station_of_the_same_name_is_not_published_and_that_is_told() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        await fleet.client()
        other = Fleet(machine, int(fleet.address.rpartition(":")[2]))
        await other.begin(as_client=True)
        await until(lambda: other.said)
        assert f"{PLANT} is already in the fleet" in other.said[0]
        await other.end()

    tried(work)


def test_a_user_has_one_gateway(monkeypatch: pytest.MonkeyPatch) -> None:
    from umo_command.connect import fleet as serve_fleet

    first = serve_fleet._alone()
    with pytest.raises(OptionError, match="another gateway"):
        serve_fleet._alone()
    os.close(first)
    os.close(serve_fleet._alone())
