"""The gateway of a face: names that cannot be forged, the order of commands, what is held, refusals as events."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from typing import Any

import pytest

from helpers.faced import Recorder, hosted
from umo.clients.faces import gateway
from umo.clients.faces.command_users import MAX_REFUSED, REFUSAL_PAUSE, RefusalLimit, named
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.face import User
from umo.clients.remote.client_session import PendingCommand
from umo.cycle.events import CommandState
from umo.errors import CommandRefused, RangeError, StateError, TaskFailed, UmoError
from umo.operation.commands.client_commands import Mode
from umo.process.frames.layout import NAME

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


@pytest.fixture(autouse=True)
def folders(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def user(name: str = "ann", is_alive: Callable[[], bool] = lambda: True, proved: bool = True) -> User:
    return User(name, proved, is_owner=True, is_alive=is_alive)


def commanded(step: Any, mode: Mode = Mode.AUTOMATIC, **more: Any) -> None:
    async def work() -> None:
        face = Recorder()
        async with TriedMachine(mode) as rig, hosted(rig, face, **more):
            await until(lambda: face.told)
            await step(rig, face)

    asyncio.run(work())


@pytest.mark.parametrize("name", ["ann (opcua)" + "\u3164" * 40, "é" * 100, "a" * 100, "ann\u202e\n (opcua)", ""])
@pytest.mark.parametrize("face", ["opcua", "some_package.module:Face"])
def test_no_name_cuts_off_that_it_is_not_proved(name: str, face: str) -> None:
    who = named(user(name, proved=False), face)
    assert f", unverified ({face[:20]})" in who
    assert len(who.encode()) <= NAME
    assert who.isprintable()


def test_commands_of_a_user_are_carried_out_in_their_order() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        for _ in range(5):
            asked = (face.commands.ask(user(), "tune", "cell.gain", value=float(n)) for n in range(1, 10))
            await asyncio.gather(*asked)
            assert rig.m.cell.gain == 9.0

    commanded(step)


@pytest.mark.full
def test_a_wrong_value_leaves_what_another_client_holds() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(user(), "write", "cell.valve", value=5.0)
        with pytest.raises(RangeError, match="500"):
            await face.commands.ask(user("bob"), "write", "cell.valve", value=500.0)
        start = rig.number
        await until(lambda: rig.number > start + 150)  # 0.75 s at least: beyond the dead-man time
        assert rig.m.cell.valve.read() == 5.0

    commanded(step, mode=Mode.MANUAL)


def test_the_lease_is_given_back_when_the_machine_has_ended_what_was_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gateway, "LINGER", 0.05)

    async def step(rig: Any, face: Recorder) -> None:
        await face.commands.ask(user(), "write", "cell.valve", value=5.0)
        await face.commands.ask(user("bob"), "mode", value="automatic")
        await until(lambda: not rig.holder, 5.0)

    commanded(step, mode=Mode.MANUAL)


@pytest.mark.full
def test_a_command_that_comes_while_the_lease_is_given_back_is_carried_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gateway, "LINGER", 0.0)

    async def step(rig: Any, face: Recorder) -> None:
        for n in range(30):
            await face.commands.ask(user(), "tune", "cell.gain", value=float(n % 9))
            await asyncio.sleep(0.02 + n * 0.004)  # the lease is looked after each 0.1 s

    commanded(step)


@pytest.mark.full
def test_what_is_held_is_kept_up_while_the_queue_takes_nothing_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    alive = [True]

    async def step(rig: Any, face: Recorder) -> None:
        sent, go_on = PendingCommand.send, asyncio.Event()
        await face.commands.ask(user(), "write", "cell.valve", value=5.0)
        await face.commands.ask(user("bob", lambda: alive[0]), "write", "cell.lamp", value="ON")
        loop = asyncio.get_running_loop()

        def stuck(asked: PendingCommand) -> None:
            asyncio.run_coroutine_threadsafe(go_on.wait(), loop).result(10.0)
            sent(asked)

        monkeypatch.setattr(PendingCommand, "send", stuck)
        alive[0] = False
        start = rig.number
        await until(lambda: rig.number > start + 200)
        assert rig.m.cell.valve.read() == 5.0
        go_on.set()

    commanded(step, mode=Mode.MANUAL)


def test_a_client_that_has_gone_before_its_command_was_sent_commands_nothing() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        with pytest.raises(CommandRefused, match="its client has disconnected"):
            await face.commands.ask(user(is_alive=lambda: False), "call", "cell.add", arguments={"weight": 1.0})
        assert not [each for each in rig.events if each.path == "cell.add"]

    commanded(step)


def test_a_command_that_is_under_way_when_the_face_ends_is_answered_in_words() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        cooking = asyncio.create_task(face.commands.ask(user(), "call", "cell.cook"))
        await until(lambda: any(each.path == "cell.cook" for each in rig.events))
        await face.commands.close()
        with pytest.raises(UmoError, match="ended"):
            await cooking

    commanded(step)


def test_no_flood_of_commands_keeps_a_user_from_cancelling_and_stopping(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gateway, "MAX_COMMANDS", 2)

    async def step(rig: Any, face: Recorder) -> None:
        cooking = [asyncio.create_task(face.commands.ask(user(), "call", "cell.cook")) for _ in range(2)]
        await until(lambda: face.commands._pending.total() == 2)
        with pytest.raises(CommandRefused, match="too many commands"):
            await face.commands.ask(user("bob"), "tune", "cell.gain", value=2.0)
        with pytest.raises(TaskFailed, match="was cancelled"):
            await asyncio.gather(face.commands.ask(user("bob"), "cancel", "cell.cook"), *cooking)
        cooking = [asyncio.create_task(face.commands.ask(user(), "call", "cell.cook")) for _ in range(2)]
        await until(lambda: face.commands._pending.total() == 2)
        await face.commands.ask(user("bob"), "stop")
        await until(lambda: rig.connection.stop.requested)
        for each in cooking:
            each.cancel()

    commanded(step)


def test_a_value_that_no_command_can_have_is_refused_in_words() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        with pytest.raises(StateError, match=r"cell\.gain: no command accepts a value of this type"):
            await face.commands.ask(user(), "tune", "cell.gain", value=b"\xff")

    commanded(step)


# Refusals as events ----------------------------------------------------------------------------------------


def test_a_refusal_of_the_face_is_an_event_of_the_machine_with_its_user() -> None:
    eve = User("eve", proved=True)

    async def step(rig: Any, face: Recorder) -> None:
        for _ in range(20):
            with pytest.raises(CommandRefused, match="needs the role tune"):
                await face.commands.ask(eve, "tune", "cell.gain", value=2.0)
        await until(lambda: any(each.event.who for each in face.heard))
        told = [each.event for each in face.heard if each.event.who == "eve (recorder)"]
        assert [(each.path, each.state, each.asked) for each in told] == [
            ("cell.gain", CommandState.REFUSED, "tune cell.gain")
        ]
        assert "needs the role tune" in told[0].text
        assert rig.m.cell.gain == 1.0
        assert not rig.holder

    commanded(step)


def test_a_face_that_only_reads_tells_the_machine_nothing() -> None:
    async def step(rig: Any, face: Recorder) -> None:
        with pytest.raises(CommandRefused, match="only reads"):
            await face.commands.ask(user(), "tune", "cell.gain", value=2.0)
        start = rig.number
        await until(lambda: rig.number > start + 20)
        assert not rig.events

    commanded(step, read_only=True)


def test_refusals_are_told_once_in_a_while_of_each_user_and_of_few_users() -> None:
    limit = RefusalLimit()
    assert limit.is_told("ann", 0.0)
    assert not limit.is_told("ann", REFUSAL_PAUSE / 2)
    assert sum(limit.is_told(str(n), 1.0) for n in range(1000)) == MAX_REFUSED - 1
    assert limit.is_told("ann", 1.0 + REFUSAL_PAUSE)
