"""The host of faces: what a face is told, when, and that none disturbs another."""

from __future__ import annotations

import asyncio
import socket
import sys
from typing import Any

import pytest

from helpers.faced import Recorder, hosted
from umo import Quality
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import Phase, until
from umo.clients.faces.endpoint import Endpoint
from umo.clients.faces.face import User
from umo.clients.faces.face_image import ChangeFilter, FaceImage
from umo.clients.faces.host import FaceHost
from umo.errors import CommandRefused, OptionError, RangeError, TaskFailed, UmoError
from umo.operation.commands.client_commands import Mode
from umo.process.frames.machine_items import ItemKind, declaration_of

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
ANN = User("ann", proved=True, is_owner=True, is_alive=lambda: True)


@pytest.fixture(autouse=True)
def folders(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def test_a_face_is_told_the_declaration_then_everything_then_changes_then_the_end() -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.told)
            assert face.machine is not None
            items = face.machine.by_name
            assert (items["cell.level"].kind, items["cell.level"].unit, items["cell.level"].maximum) == (
                ItemKind.SENSOR, "mm", 100.0,
            )  # fmt: skip
            assert items["cell.limit"].states == {0: "PASS", 1: "FAIL"}
            assert items["cell.phase"].states == {phase.value: phase.name.lower() for phase in Phase}
            assert items["tunable:cell.gain"].maximum == 10.0
            assert items["alarm:cell.full"].states[0] == "normal"
            assert items["equipment:cell"].states[1] == "fault"
            assert len(face.told[0].places) == len(face.machine.items)
            assert face.value("cell.level") == 10.0
            rig.set("cell.level", 50)
            rig.m.cell.phase = Phase.COOKING
            await until(lambda: face.value("cell.level") == 25.0 and face.value("cell.phase") == 2.0)
            assert len(face.told[-1].places) < len(face.machine.items)
            assert face.told[-1].times[items["cell.level"].number] == pytest.approx(face.told[-1].utc, abs=0.1)
        assert face.calls[0] == "begin"
        assert face.calls[-1] == "end"

    asyncio.run(work())


def test_a_value_that_the_device_does_not_give_is_stale_with_the_time_of_the_last_one() -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.told)
            assert face.machine is not None
            place = face.machine.by_name["cell.level"].number
            rig.set("cell.level", OSError("unplugged"))
            await until(lambda: face.quality("cell.level") == Quality.STALE)
            before = face.told[-1].times[place]
            rig.set("cell.limit", 1)
            await until(lambda: face.value("cell.limit") == 1.0)
            assert face.told[-1].times[place] == before
            assert face.value("cell.level") == 10.0

    asyncio.run(work())


def test_a_value_that_is_no_number_is_never_good() -> None:
    async def work() -> None:
        async with TriedMachine() as rig:
            await until(lambda: rig.number > 5)
            with rig.find() as reader:
                image, frames = FaceImage(reader, declaration_of(reader)), reader.read()
                frames["values"], frames["quality"] = float("nan"), Quality.GOOD
                frames["quality"][:, 0] = Quality.STALE
                reader.read = lambda: frames  # type: ignore[method-assign, assignment]
                image.look()
                count = len(reader.layout.objects)
                assert image.quality[:count].tolist() == [Quality.STALE] + [Quality.BAD] * (count - 1)

    asyncio.run(work())


def test_a_silent_machine_makes_every_value_stale_until_it_speaks_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.host.SILENCE", 0.05)

    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.told and face.quality("cell.level") == Quality.GOOD)
            rig.goes_on = False
            await until(lambda: min(face.told[-1].quality) >= Quality.STALE)
            rig.goes_on = True
            await until(lambda: face.quality("cell.level") == Quality.GOOD)

    asyncio.run(work())


def test_a_face_that_fails_is_told_begins_again_and_disturbs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.host.FIRST_PAUSE", 0.01)

    class Broken(Recorder):
        async def frames(self, changes: Any) -> None:
            await super().frames(changes)
            if self.calls.count("begin") < 3:
                raise RuntimeError("it is broken")

    async def work() -> None:
        face, broken = Recorder(), Broken()
        async with TriedMachine() as rig, hosted(rig, face, broken) as said:
            await until(lambda: broken.calls.count("begin") == 3)
            assert broken.calls[:3] == ["begin", "frames", "end"]
            assert any("broken has failed" in text and "it is broken" in text for text in said)
            rig.set("cell.level", 60)
            await until(lambda: face.value("cell.level") == 30.0 == broken.value("cell.level"))
            assert face.calls.count("begin") == 1

    asyncio.run(work())


def test_a_face_that_cannot_open_its_server_is_named_with_what_to_do() -> None:
    class Listening(Recorder):
        async def open(self) -> None:
            Endpoint("127.0.0.1", port).listening().close()

    async def work() -> None:
        async with TriedMachine() as rig:
            with pytest.raises(UmoError, match=rf"^lamp: .* port {port}: .*; give another `port`$"):
                await FaceHost(None, [("lamp", Listening())], find=rig.find).run()

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        asyncio.run(work())


def test_events_while_a_face_begins_are_told() -> None:
    class Beginning(Recorder):
        gate: asyncio.Event

        async def begin(self, machine: Any, commands: Any) -> None:
            await super().begin(machine, commands)
            await self.gate.wait()

    async def work() -> None:
        face = Beginning()
        face.gate = asyncio.Event()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.calls)
            rig.set("cell.level", 190)
            await until(lambda: any(each.path == "cell.full" for each in rig.events))
            face.gate.set()
            await until(lambda: any(each.event.path == "cell.full" for each in face.heard))

    asyncio.run(work())


def test_a_slow_face_gets_fewer_calls_with_the_last_values() -> None:
    class Slow(Recorder):
        gate: asyncio.Event

        async def frames(self, changes: Any) -> None:
            await super().frames(changes)
            await self.gate.wait()

    async def work() -> None:
        face, slow = Recorder(), Slow()
        slow.gate = asyncio.Event()
        async with TriedMachine() as rig, hosted(rig, face, slow):
            await until(lambda: slow.told)
            for raw in range(2, 40, 2):
                rig.set("cell.level", raw)
                await until(lambda raw=raw: face.told and face.value("cell.level") == raw / 2)
            assert len(slow.told) == 1
            slow.gate.set()
            await until(lambda: slow.value("cell.level") == 19.0)
            assert len(slow.told) <= 3

    asyncio.run(work())


def test_a_number_within_its_dead_band_is_not_told() -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face, dead_bands={"cell.level": 2.0}):
            await until(lambda: face.told and face.value("cell.level") == 10.0)
            assert face.machine is not None
            place = face.machine.by_name["cell.level"].number
            rig.set("cell.level", 24)  # 12 mm
            rig.set("cell.limit", 1)
            await until(lambda: face.value("cell.limit") == 1.0)
            assert all(place not in each.places for each in face.told[1:])
            rig.set("cell.level", 25)
            await until(lambda: place in face.told[-1].places)

    asyncio.run(work())


def test_a_dead_band_of_no_number_is_refused() -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.machine)
            with pytest.raises(OptionError, match=r"dead band: 'cell.limit' is not the path of a number"):
                ChangeFilter(None, face.machine, {"cell.limit": 1.0})  # type: ignore[arg-type]

    asyncio.run(work())


# Commands ----------------------------------------------------------------------------------------------


def commanded(*steps: Any, mode: Mode = Mode.AUTOMATIC, **more: Any) -> None:
    """Carry out steps with a face that has begun."""

    async def work() -> None:
        face = Recorder()
        async with TriedMachine(mode) as rig, hosted(rig, face, **more):
            await until(lambda: face.told)
            for step in steps:
                await step(rig, face)

    asyncio.run(work())


def test_a_number_is_tuned_and_the_user_is_in_the_event() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        assert await face.commands.ask(ANN, "tune", "cell.gain", value=2.0) == "1 -> 2"
        assert rig.m.cell.gain == 2.0
        await until(lambda: face.value("tunable:cell.gain") == 2.0)
        events = [each.event for each in face.heard]
        assert any((each.path, each.who) == ("cell.gain", "ann (recorder)") for each in events)

    commanded(step)


def test_a_command_ends_after_the_face_was_told_what_it_has_done() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        for value in range(2, 10):
            await face.commands.ask(ANN, "tune", "cell.gain", value=float(value))
            assert face.value("tunable:cell.gain") == value

    commanded(step)


def test_refusals_are_the_machines_own_errors() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        with pytest.raises(RangeError, match="11"):
            await face.commands.ask(ANN, "tune", "cell.gain", value=11.0)
        with pytest.raises(CommandRefused, match="manual mode only"):
            await face.commands.ask(ANN, "write", "cell.valve", value=1.0)

    commanded(step)


@pytest.mark.parametrize("more", [{"arguments": 5}, {"seconds": float("nan")}, {"colour": "red"}])
def test_what_the_machine_would_not_take_for_a_command_is_refused_at_once(more: dict[str, Any]) -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine() as rig, hosted(rig, face):
            await until(lambda: face.told)
            with pytest.raises(CommandRefused, match=r"call cell\.add: it is not a valid command"):
                await face.commands.ask(ANN, "call", "cell.add", **more)

    asyncio.run(work())


def test_an_action_returns_its_result() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        assert await face.commands.ask(ANN, "call", "cell.add", arguments={"weight": 2.0}) == 4.0

    commanded(step)


def test_a_write_is_held_while_its_client_lives_and_let_go_of_when_it_has_gone() -> None:
    alive = [True]
    user = User("bob", proved=True, is_owner=True, is_alive=lambda: alive[0])

    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(user, "write", "cell.valve", value=5.0)
        start = rig.number
        await until(lambda: rig.number > start + 150)  # 0.75 s at least: beyond the dead-man time
        assert rig.m.cell.valve.read() == 5.0
        alive[0] = False
        await until(lambda: rig.m.cell.valve.read() == 0.0)

    commanded(step, mode=Mode.MANUAL)


def test_what_is_kept_up_is_refused_where_the_protocol_does_not_tell_whether_a_client_lives() -> None:
    user = User("bob", proved=True, is_owner=True)

    async def step(rig: Any, face: Recorder) -> None:
        for do, path, more in (
            ("write", "cell.valve", {"value": 1.0}),
            ("call", "cell.jog", {"arguments": {"velocity": 1.0}}),
        ):
            with pytest.raises(CommandRefused, match="only while its client sends heartbeats"):
                await face.commands.ask(user, do, path, **more)

    commanded(step, mode=Mode.MANUAL)


def test_an_action_whose_client_has_gone_is_cancelled() -> None:
    alive = [True]
    user = User("bob", proved=True, is_owner=True, is_alive=lambda: alive[0])

    async def step(rig: Any, face: Recorder) -> None:
        cooking = asyncio.create_task(face.commands.ask(user, "call", "cell.cook"))
        await until(lambda: any(each.event.path == "cell.cook" for each in face.heard))
        alive[0] = False
        with pytest.raises(TaskFailed, match="was cancelled"):
            await cooking

    commanded(step)


def test_two_users_share_the_lease_of_the_face_and_each_is_named() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        for name, value in (("ann", 2.0), ("bob", 3.0)):
            user = User(name, proved=True, is_owner=True, is_alive=lambda: True)
            await face.commands.ask(user, "tune", "cell.gain", value=value)
        await until(lambda: len({each.event.who for each in face.heard if each.event.path == "cell.gain"}) == 2)

    commanded(step)


@pytest.mark.parametrize(
    ("user", "words"),
    [
        (User("ann", proved=False), "ann, unverified, has the role see; .* recorder in .unverified. of roles.toml"),
        (User(" ", proved=True, is_owner=True), "needs the name of its user"),
        (User("ann", proved=True), "ann has the role see; .* in .users. of roles.toml"),
    ],
)
def test_who_may_not_command_is_told_why(user: User, words: str) -> None:
    async def step(rig: Any, face: Recorder) -> None:
        for do in ("tune", "stop"):
            with pytest.raises(CommandRefused, match=words):
                await face.commands.ask(user, do, "cell.gain", value=2.0)
        assert rig.m.cell.gain == 1.0

    commanded(step)


def test_roles_bind_users_whose_names_are_proved(tmp_path: Any) -> None:
    file = tmp_path / "config" / "umo" / "roles.toml"
    file.parent.mkdir(parents=True)
    file.write_text('[users]\nann = "tune"\n')
    ann = User("ann", proved=True, is_alive=lambda: True)

    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(ann, "tune", "cell.gain", value=2.0)
        with pytest.raises(CommandRefused, match="ann has the role tune; mode needs the role operate"):
            await face.commands.ask(ann, "mode", value="manual")
        with pytest.raises(CommandRefused, match="needs the role"):
            await face.commands.ask(ann, "stop")

    commanded(step)


def test_a_user_whose_name_is_not_proved_has_the_role_of_the_face_and_is_marked(tmp_path: Any) -> None:
    file = tmp_path / "config" / "umo" / "roles.toml"
    file.parent.mkdir(parents=True)
    file.write_text('[unverified]\nrecorder = "tune"\n')

    async def step(rig: Any, face: Recorder) -> None:
        user = User("carl", proved=False)
        await face.commands.ask(user, "tune", "cell.gain", value=2.0)
        await until(lambda: any(each.event.who == "carl, unverified (recorder)" for each in face.heard))

    commanded(step)


def test_a_host_that_only_reads_refuses_every_command() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        for do in ("tune", "stop", "call"):
            with pytest.raises(CommandRefused, match="can only read"):
                await face.commands.ask(ANN, do, "cell.gain", value=2.0)

    commanded(step, read_only=True)


def test_what_is_asked_after_the_run_is_refused_in_words() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        await rig.end()
        await until(lambda: face.why)
        await asyncio.sleep(0)  # the gateway is closed after the face's end
        for do in ("tune", "stop"):
            with pytest.raises(CommandRefused, match="the run has ended"):
                await face.commands.ask(ANN, do, "cell.gain", value=2.0)

    commanded(step)


def test_stop_needs_no_lease() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(ANN, "stop")
        await until(lambda: rig.connection.stop.requested)
        assert rig.clients.stopped_by == "ann (recorder)"

    commanded(step)


def test_the_lease_is_given_back_when_nothing_has_been_asked_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.gateway.LINGER", 0.05)

    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(ANN, "tune", "cell.gain", value=2.0)
        clients = rig.clients
        assert clients.lease.holder
        await until(lambda: not clients.lease.holder)
        await face.commands.ask(ANN, "tune", "cell.gain", value=3.0)

    commanded(step)
