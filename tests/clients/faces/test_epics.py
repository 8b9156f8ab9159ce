"""The face EPICS with pvapy as its client, and with ophyd-async and bluesky."""

from __future__ import annotations

import asyncio
import getpass
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("p4p", reason="the face EPICS needs p4p: pip install '.[epics]'")

from helpers.epics import FOREIGN, Pvapy, ServedZtheta, clients_python, environment, epics
from helpers.faced import Recorder, hosted
from umo.clients.faces.conformance import RefusedByFace, TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.epics import Epics
from umo.clients.faces.epics.pva_server import MAX_ASKED, PvaServer
from umo.clients.faces.face_image import FaceImage
from umo.cycle.events import CommandState
from umo.errors import OptionError, UmoError
from umo.operation.alarms import AlarmState
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.verb import Names
from umo.operation.commands.verbs import naming
from umo.process.frames.machine_items import declaration_of
from umo.process.frames.search import find_running
from umo.system.peer_account import account_of

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]


@pytest.fixture(autouse=True, scope="module")
def clients() -> None:
    clients_python()


# Values and commands of the kit's machine -----------------------------------------------------------------


@asynccontextmanager
async def served(mode: Mode = Mode.AUTOMATIC) -> AsyncIterator[tuple[TriedMachine, Pvapy]]:
    """A machine, and a client of its face."""
    face, other = epics(), Recorder()
    async with TriedMachine(mode) as machine, hosted(machine, face, other):
        await until(lambda: other.told)
        client = await Pvapy.of(face)
        try:
            yield machine, client
        finally:
            await client.close()


async def seen(client: Pvapy, name: str, what: str, value: Any) -> dict[str, Any]:
    """The variable, once a field is so."""
    async with asyncio.timeout(20):
        while True:
            try:
                found = await client.get(name)
            except RefusedByFace:  # it still searches
                continue
            each: Any = found
            for part in what.split("."):
                each = each[part]
            if each == value:
                return found


def test_a_number_has_the_fields_of_an_ntscalar() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            found = await seen(client, "plant:cell:level", "alarm.severity", 0)
            assert found["display"] | {"form": None} == {
                "limitLow": 0.0, "limitHigh": 100.0, "units": "mm", "precision": 1, "form": None,
                "description": "sensor cell.level",
            }  # fmt: skip
            assert found["timeStamp"]["userTag"] > 0
            machine.set("cell.level", OSError("unplugged"))
            found = await seen(client, "plant:cell:level", "alarm.message", "STALE")
            assert (found["value"], found["alarm"]["severity"], found["alarm"]["status"]) == (10.0, 1, 1)

    asyncio.run(work())


def test_the_tree_has_every_variable_once() -> None:
    async def work() -> None:
        async with served() as (_, client):
            await seen(client, "plant:PVI", "alarm.severity", 0)
            tree = await below(client, "plant:PVI")
        assert tree["cell"]["level"] == {"r": "plant:cell:level"}
        assert tree["cell"]["gain"] == {"rw": "plant:cell:gain"}
        assert tree["cell"]["add"] == {"x": "plant:cell:add"}
        assert tree["cell"]["full"] == {
            "alarm": {"r": "plant:cell:full:alarm"},
            **{verb.word: {"x": f"plant:cell:full:{verb.word}"} for verb in naming(Names.ALARM)},
        }  # fmt: skip
        assert tree["cell"]["position_x002E_bad"]["alarm"] == {"r": "plant:cell:position:bad:alarm"}
        assert tree["run"]["stop_"] == {"x": "plant:run:stop"}

    asyncio.run(work())


async def below(client: Pvapy, name: str) -> dict[str, Any]:
    """The entries of a device, and of all below it."""
    entries: dict[str, Any] = (await client.get(name))["value"]
    return {each: await below(client, what["d"]) if "d" in what else what for each, what in entries.items()}


def test_an_alarm_and_a_fault_have_the_severity_of_their_meaning() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            machine.set("cell.level", 190)
            found = await seen(client, "plant:cell:full:alarm", "alarm.severity", 1)
            assert found["alarm"]["message"] == "too full"
            machine.set("cell.limit", OSError("unplugged"))
            await seen(client, "plant:cell:equipment", "alarm.severity", 2)
            machine.set("cell.limit", 0)
            await client.put("plant:cell:clear", 1)
            await seen(client, "plant:cell:equipment", "alarm.severity", 0)
            await client.put("plant:cell:full:acknowledge_alarm", 1)
            await seen(client, "plant:cell:full:alarm", "value.index", 2)

    asyncio.run(work())


def test_at_the_end_every_variable_is_invalid() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            names = ("plant:cell:level", "plant:cell:valve", "plant:cell:add", "plant:run:mode", "plant:PVI")
            for name in names:
                await seen(client, name, "alarm.severity", 0)
            await machine.end()
            for name in names:
                await seen(client, name, "alarm.severity", 3)
            with pytest.raises(RefusedByFace, match="ended"):
                await client.put("plant:cell:gain", 2.0)

    asyncio.run(work())


def test_what_is_no_command_is_refused_in_words() -> None:
    async def work() -> None:
        async with served() as (_, client):
            for name, value, words in (
                ("plant:cell:level", 1.0, "read-only"),
                ("plant:cell:add", 1, "argument weight is missing"),
                ("plant:run:mode", 0, "no mode"),
            ):
                with pytest.raises(RefusedByFace, match=words):
                    await client.put(name, value)
            for given, words in (({"mass": 1.0}, "no argument 'mass'"), ({"weight": "heavy"}, "heavy")):
                with pytest.raises(RefusedByFace, match=words):
                    await client.order("call", name="plant:cell:add", arguments=given)
            assert (
                await client.order("call", name="plant:cell:add", arguments={"weight": "1.5"}) == 3.0
            )  # as of a shell

    asyncio.run(work())


def test_the_account_is_that_which_the_kernel_tells() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            await client.put("plant:cell:gain", 2.0)
            who = [each.who for each in machine.events if each.path == "cell.gain"]
            assert who == [f"{getpass.getuser()} (epics)"]

    asyncio.run(work())


def test_another_account_of_this_computer_needs_a_role(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.epics.pva_server.peer_uid", lambda peer, port: os.getuid() + 1)
    roles = tmp_path / "config" / "umo" / "roles.toml"
    account = account_of(os.getuid() + 1)

    async def work() -> None:
        async with served() as (machine, client):
            with pytest.raises(RefusedByFace, match=f"{account} has the role see; tune needs the role tune"):
                await client.put("plant:cell:gain", 2.0)
            roles.write_text(f'[users]\n"{account}" = "tune"\n')
            await client.put("plant:cell:gain", 2.0)
            assert [each.who for each in machine.events if each.path == "cell.gain"][-1] == f"{account} (epics)"
            monkeypatch.setattr("umo.clients.faces.epics.pva_server.peer_uid", lambda peer, port: None)
            with pytest.raises(RefusedByFace, match="unverified, has the role see"):
                await client.put("plant:cell:gain", 3.0)

    asyncio.run(work())


def test_a_jog_is_let_go_of_when_its_client_closes_the_channel_or_is_killed() -> None:
    async def work() -> None:
        async with served(Mode.MANUAL) as (machine, client):
            await client.call("cell.jog", {"velocity": 3.0})
            assert machine.m.cell.valve.read() == 3.0
            await client.kill()
            await until(lambda: machine.m.cell.valve.read() == 0.0)

    asyncio.run(work())


@pytest.mark.parametrize("block", [True, False], ids=["awaited", "not awaited"])
def test_an_action_is_cancelled_when_a_client_that_awaits_it_is_killed(block: bool) -> None:
    async def work() -> None:
        async with served() as (machine, client):

            def states() -> list[CommandState]:
                return [each.state for each in machine.events if each.path == "cell.cook"]

            putting = asyncio.create_task(client.put("plant:cell:cook", 1, block=block))
            await until(lambda: states() == [CommandState.BEGUN])
            if not block:
                await putting  # answered though it goes on
            await client.kill()
            await asyncio.gather(putting, return_exceptions=True)
            number = machine.number
            await until(lambda: machine.number > number + 100)
            assert (CommandState.CANCELLED in states()) == block

    asyncio.run(work())


def test_a_client_that_is_there_before_the_machine_finds_what_is_kept_up() -> None:
    async def work() -> None:
        face, machine = epics(), TriedMachine(Mode.MANUAL)
        async with hosted(machine, face):
            await until(lambda: face.address)
            client = await Pvapy.of(face)
            with pytest.raises(RefusedByFace):  # it has searched for a second
                await client.get("plant:cell:valve")
            async with machine:
                await seen(client, "plant:cell:valve", "value", 0.0)
                await client.put("plant:cell:valve", 2.0)
                assert machine.m.cell.valve.read() == 2.0
            await client.close()

    asyncio.run(work())


def test_stop_ends_the_run() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            await client.put("plant:run:stop", 1)
            await until(lambda: machine.connection.stop.requested)

    asyncio.run(work())


def test_more_channels_than_are_kept_up_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.epics.pva_server.MAX_CHANNELS", 1)

    async def work() -> None:
        async with served(Mode.MANUAL) as (_, client):
            await client.put("plant:cell:valve", 1.0)
            with pytest.raises(RefusedByFace):
                await client.get("plant:cell:lamp")
            await seen(client, "plant:cell:level", "value", 10.0)

    asyncio.run(work())


# Options --------------------------------------------------------------------------------------------------


def test_a_flood_of_puts_of_one_connection_keeps_no_other_waiting_for_the_look_at_its_account() -> None:
    class Put:
        """A put that tells when its user is looked up, which takes until `look` is set."""

        is_call = False

        def __init__(self, peer: str) -> None:
            self.peer = peer

        def user(self, port: int) -> Any:
            look.wait(30)
            looked.append(self.peer)

    look, looked = threading.Event(), list[str]()

    async def work() -> list[Any]:
        server = PvaServer(Endpoint("127.0.0.1", 0), 0)
        puts: list[Any] = [Put("10.0.0.7:4711") for _ in range(1000)] + [Put("127.0.0.1:5000")]
        coming = asyncio.gather(*map(server._user, puts), return_exceptions=True)
        await asyncio.sleep(0)
        look.set()
        answers = await coming
        assert not server._asked
        await server.close()
        return answers

    answers = asyncio.run(work())
    assert looked == ["10.0.0.7:4711"] * MAX_ASKED + ["127.0.0.1:5000"]
    refused = [str(each) for each in answers if isinstance(each, UmoError)]
    assert refused == [f"a connection may have at most {MAX_ASKED} puts and calls in progress"] * (1000 - MAX_ASKED)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"host": "0.0.0.0"}, "pvAccess does not prove who a user is"),
        ({"prefix": "my plant:"}, "contains a space"),
        ({"search_port": 0}, "not from 1 to 65535"),
        ({"port": 70000}, "not from 0 to 65535"),
    ],
)
def test_options_that_it_cannot_have(given: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        Epics(**given)


def test_a_port_that_is_taken_is_said() -> None:
    async def work(port: int) -> None:
        await Epics(port=port).open()

    with socket.create_server(("127.0.0.1", 0)) as server, pytest.raises(UmoError, match="Address already in use"):
        asyncio.run(work(server.getsockname()[1]))


# The z-theta station --------------------------------------------------------------------------------------


@pytest.fixture
def ztheta(folders: None) -> Iterator[ServedZtheta]:
    found = ServedZtheta()
    try:
        yield found
    finally:
        found.end()


def test_ophyd_async_builds_the_machine_from_its_prefix_and_bluesky_scans_an_axis(ztheta: ServedZtheta) -> None:
    done = subprocess.run(
        [clients_python(), str(FOREIGN / "scan.py"), "ztheta:"],
        env=environment(ztheta), capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    tree = told["tree"]
    assert tree["z"]["encoder"] == "SignalR"
    assert tree["z"]["servo"]["gain"] == tree["z"]["motor"] == tree["z"]["target"] == "SignalRW"
    assert tree["home"] == tree["z"]["stop_"] == tree["run"]["stop_"] == "TriggerableCommand"
    key = told["keys"]["z"]
    assert (key["units"], key["limits"]["display"]) == ("um", {"low": 55000.0, "high": 129000.0})
    positions = [data["z"] for data, _ in told["events"]]
    assert positions == pytest.approx([60000.0, 62000.0, 64000.0, 66000.0], abs=60.0)
    assert [data["m-z-encoder"] for data, _ in told["events"]] == pytest.approx(positions, abs=60.0)
    times = [stamps["z"] for _, stamps in told["events"]]
    assert times == sorted(set(times))
    assert "z.move_to: position" in told["beyond"]
    assert "was cancelled" in told["stopped"]["answer"]
    assert told["stopped"]["done"] == 1
    assert 66000.0 < told["stopped"]["position"] < 99000.0
    assert told["gain"] == 0.003


class AxisWatch:
    """The state of an axis from the frames, without a face."""

    def __init__(self, path: str) -> None:
        self._reader = find_running(None)
        machine = declaration_of(self._reader)
        self._image, self._item = FaceImage(self._reader, machine), machine.by_name[f"axis:{path}"]

    def state(self) -> str:
        self._image.look()
        return self._item.states.get(int(self._image.values[self._item.number]), "")

    def close(self) -> None:
        self._reader.close()


async def jogging(ztheta: ServedZtheta) -> tuple[Pvapy, AxisWatch]:
    """A client that jogs the axis z."""
    client, watch = await Pvapy.of(ztheta), AxisWatch("z")
    await seen(client, "ztheta:z.DMOV", "alarm.severity", 0)  # the face has begun
    await client.put("ztheta:z.JOGF", 1)
    await until(lambda: watch.state() == "continuous_motion")
    return client, watch


@pytest.mark.parametrize("end", ["let go", "kill the client", "kill the face"])
def test_a_jog_ends_with(ztheta: ServedZtheta, end: str) -> None:
    async def work() -> None:
        client, watch = await jogging(ztheta)
        if end == "let go":
            await client.put("ztheta:z.JOGF", 0)
        elif end == "kill the client":
            await client.kill()
        else:
            ztheta.face.kill()
        await until(lambda: watch.state() != "continuous_motion")
        await client.close()
        watch.close()

    asyncio.run(work())


def test_after_a_kill_of_the_station_every_variable_is_invalid(ztheta: ServedZtheta) -> None:
    async def work() -> None:
        client = await Pvapy.of(ztheta)
        names = ("ztheta:z.RBV", "ztheta:z.EGU", "ztheta:pick_height", "ztheta:run:mode", "ztheta:z.JOGF")
        await seen(client, "ztheta:pick_height", "alarm.severity", 0)
        ztheta.station.kill()
        for name in names:
            await seen(client, name, "alarm.severity", 3)
        await client.close()

    asyncio.run(work())


def test_every_verb_of_alarms_is_a_variable_of_each_and_of_the_run() -> None:
    async def work() -> None:
        async with served() as (machine, client):
            machine.set("cell.level", 170)
            await seen(client, "plant:cell:full:alarm", "value.index", 1)
            for name, value, state in (
                ("cell:full:remove_from_service", 1, AlarmState.OUT_OF_SERVICE),
                ("run:return_to_service", "cell.full", AlarmState.UNACKNOWLEDGED),
                ("cell:full:acknowledge_alarm", 1, AlarmState.ACKNOWLEDGED),
                ("cell:full:shelve", 60.0, AlarmState.SHELVED),
                ("cell:full:unshelve", 1, AlarmState.UNACKNOWLEDGED),
            ):
                await client.put(f"plant:{name}", value)
                await until(lambda state=state: machine.connection.machine.image.columns.alarms[0] == state)
            await client.call("run.shelve", {"path": "cell.full", "time": "10 min"})
            await until(lambda: machine.connection.machine.image.columns.alarms[0] == AlarmState.SHELVED)
            with pytest.raises(RefusedByFace, match=r"from 0\.001 to 604800 s"):
                await client.put("plant:cell:full:shelve", -1.0)

    asyncio.run(work())
