"""The face OPC UA with node-opcua as its client."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="the face OPC UA needs asyncua: pip install '.[opcua]'")

from helpers.faced import hosted
from helpers.opcua import OpcUaClient, QuickOpcUa, let_in, named
from umo import Compound
from umo.clients.faces.conformance import RULES, RefusedByFace, TriedFace, TriedMachine, try_rule
from umo.clients.faces.conformance.tried_machine import Plant, plant, until
from umo.clients.faces.opcua.unece_codes import CODES, number_of
from umo.cycle.events import CommandState
from umo.operation import PackML
from umo.operation.commands.client_commands import Mode

pytestmark = [pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"), pytest.mark.slow]
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
Work = Callable[["Served"], Coroutine[Any, Any, None]]


async def client(face: Any, user: str) -> OpcUaClient:
    return await OpcUaClient.connect(face.address, named(user))


OPCUA = TriedFace("opcua", lambda: QuickOpcUa(port=0), client)


@pytest.fixture(autouse=True)
def users(folders: None) -> None:
    let_in()


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.smoke) if each == "kinds" else each for each in RULES]
)
def test_the_face_keeps_the_contract(name: str) -> None:
    assert asyncio.run(try_rule(OPCUA, RULES[name])) in (None, "")


class Served:
    """A machine that is served, and its clients."""

    def __init__(self, machine: TriedMachine, face: QuickOpcUa) -> None:
        self.machine, self.face = machine, face
        self.clients: list[OpcUaClient] = []

    async def client(self, user: str | None = "ann", **more: Any) -> OpcUaClient:
        found = await OpcUaClient.connect(self.face.address, None if user is None else named(user), **more)
        self.clients.append(found)
        return found


@asynccontextmanager
async def served(
    machine: TriedMachine | None = None, face: QuickOpcUa | None = None, mode: Mode = Mode.AUTOMATIC
) -> AsyncIterator[Served]:
    face = QuickOpcUa(port=0) if face is None else face
    async with machine or TriedMachine(mode) as machine, hosted(machine, face):
        await until(lambda: face._nodes is not None and face._utc)
        found = Served(machine, face)
        try:
            yield found
        finally:
            for each in found.clients:
                await each.close()


def run(work: Work, **more: Any) -> None:
    async def whole() -> None:
        async with served(**more) as found:
            await work(found)

    asyncio.run(whole())


async def sooner_or_later(look: Callable[[], Awaitable[Any]], within: float = 20.0) -> Any:
    """What it returns, once it is true."""
    async with asyncio.timeout(within):
        while not (found := await look()):
            await asyncio.sleep(0.01)
    return found


# Reading -------------------------------------------------------------------------------------------------


def test_a_client_finds_the_machine_by_browsing_with_names_of_the_standards() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client(None)
        machinery, devices, own = (
            ann.namespaces.index(each) for each in (MACHINERY, "http://opcfoundation.org/UA/DI/", "urn:umo:plant")
        )
        machine = f"/Objects/{machinery}:Machines/{own}:plant"
        for path, node in (
            (machine, "machine"),
            (f"{machine}/{own}:cell/{own}:level", "cell.level"),
            (f"{machine}/{own}:cell/{own}:level.EURange", "cell.level/EURange"),
            (f"{machine}/{own}:cell/{own}:add.InputArguments", "action:cell.add/InputArguments"),
            (f"{machine}/{devices}:Identification.{devices}:SerialNumber", "identification/SerialNumber"),
        ):
            found = await ann.node.ask("path", path=path)
            assert found["targets"] == [f"ns={own};s={node}"], path
        told = await ann.node.ask("read", name="cell.level")
        assert (told["status"], told["code"], told["unit"]) == ("Good", number_of("MMT"), "mm")
        kinds = {each["node"]: each["type"] for each in (await ann.node.ask("browse", name="part:cell"))["references"]}
        types = {name.rpartition("s=")[2]: kind for name, kind in kinds.items()}
        assert types["cell.level"] == "ns=0;i=17570"  # AnalogUnitRangeType
        assert types["cell.limit"] == "ns=0;i=2373"  # TwoStateDiscreteType
        assert types["cell.phase"] == "ns=0;i=11238"  # MultiStateValueDiscreteType

    run(work)


def test_each_quality_has_its_status() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client(None)

        async def becomes(name: str, status: str) -> None:
            assert await sooner_or_later(lambda: same(name, status)), name

        async def same(name: str, status: str) -> bool:
            return await ann.status(name) == status

        await becomes("cell.level", "Good")
        await becomes("cell.position", "UncertainInitialValue")
        rig.machine.set("cell.level", 400)
        await becomes("cell.level", "UncertainEngineeringUnitsExceeded")
        rig.machine.set("cell.level", 40)
        await becomes("cell.level", "Good")
        rig.machine.set("cell.level", OSError("unplugged"))
        await becomes("cell.level", "UncertainLastUsableValue")
        rig.machine.set("cell.position", OSError("unplugged"))
        await becomes("cell.position", "BadDeviceFailure")
        await rig.machine.end()
        await becomes("cell.limit", "UncertainNoCommunicationLastUsableValue")

    run(work)


def test_monitored_items_tell_each_change_with_its_time() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client(None)
        told = await ann.node.ask("subscribe", names=["cell.level", "cell.phase"], interval=1)
        assert told == {"id": told["id"], "interval": 50, "items": 2}, "the shortest interval is 50 ms"
        heard: list[Any] = []

        async def comes(value: float) -> bool:
            heard.extend((await ann.node.ask("heard"))["heard"])
            return any(each[:3] == ["cell.level", value, "Good"] for each in heard)

        for raw in (40, 60, 20):
            rig.machine.set("cell.level", raw)
            await sooner_or_later(lambda value=raw / 2: comes(value))
        times = [each[3] for each in heard if each[0] == "cell.level"]
        assert times == sorted(times)

    run(work)


# Commands ------------------------------------------------------------------------------------------------


def test_nodes_of_one_write_are_refused_one_by_one_in_words() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client()
        results = await ann.write_all(
            [
                ("tunable:cell.gain", 11.0), ("tunable:cell.gain", 2.0), ("cell.level", 1.0), ("cell.valve", 1.0),
                ("tunable:cell.gain", "two"), ("tunable:cell.gain", float("nan")), ("cell.nothing", 1.0),
            ]
        )  # fmt: skip
        assert [each["status"] for each in results] == [
            "BadOutOfRange", "Good", "BadNotWritable", "BadRequestNotAllowed", "BadTypeMismatch", "BadOutOfRange",
            "BadNodeIdUnknown",
        ]  # fmt: skip
        assert "11 mm" in results[0]["words"]
        assert "in manual mode only" in results[3]["words"]
        assert "is a number" in results[4]["words"]
        assert rig.machine.m.cell.gain == 2.0
        assert "cell.gain" in (await ann.read("refusal")).value  # for clients that ask for no diagnostics

    run(work)


def test_an_anonymous_session_only_reads() -> None:
    async def work(rig: Served) -> None:
        nobody = await rig.client(None)
        for asked in (
            nobody.tune("cell.gain", 2.0), nobody.call("cell.add", {"weight": 1.0}), nobody.mode("manual"),
            nobody.method("machine", "command:stop"),
        ):  # fmt: skip
            with pytest.raises(RefusedByFace, match=r"BadUserAccessDenied.*only reads"):
                await asked
        assert rig.machine.m.cell.gain == 1.0
        assert not rig.machine.connection.stop.requested
        assert not rig.machine.holder

    run(work)


@pytest.mark.parametrize("user", [{"name": "ann", "password": "hunter3"}, {"name": "eve", "password": ""}])
def test_a_wrong_password_opens_no_session(user: dict[str, str]) -> None:
    async def work(rig: Served) -> None:
        with pytest.raises(RefusedByFace, match=r"BadUserAccessDenied|BadIdentityToken"):
            await OpcUaClient.connect(rig.face.address, user)

    run(work)


def test_an_action_has_its_arguments_with_their_ranges_in_words() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client()
        told = await ann.node.ask("arguments", name="action:cell.add")
        assert told["arguments"] == [["weight", "ns=0;i=11", "from 0 to 5 kg"]]
        for given, status in (
            ({}, "BadArgumentsMissing: it takes weight"),
            ({"weight": "much"}, r"BadInvalidArgument: it takes weight \(number\)"),
            ({"weight": 1.0, "more": 1.0}, "BadTooManyArguments"),
            ({"weight": 5.5}, "BadInvalidArgument.*5 kg"),
        ):
            with pytest.raises(RefusedByFace, match=status):
                await ann.call("cell.add", given)

    run(work)


def test_a_long_action_is_answered_before_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.opcua.ua_commands.PATIENCE", 0.2)

    async def work(rig: Served) -> None:
        ann = await rig.client()
        told = await ann.node.ask("call", object="part:cell", method="action:cell.cook", given=[])
        assert told["status"] == "GoodCompletesAsynchronously"
        await ann.method("machine", "command:cancel", "cell.cook")
        await until(lambda: any(each.state is CommandState.CANCELLED for each in rig.machine.events))

    run(work)


def test_a_jog_lasts_while_its_client_lives() -> None:
    async def work(rig: Served) -> None:
        ann, valve = await rig.client(), rig.machine.m.cell.valve
        told = await ann.node.ask("call", object="part:cell", method="action:cell.jog", given=[3.0])
        assert told["status"].startswith("Good")
        number = rig.machine.number
        await until(lambda: rig.machine.number > number + 200)  # 1 s: twice the dead-man time
        assert valve.read() == 3.0
        await ann.kill()
        await until(lambda: valve.read() == 0.0, 10.0)

    run(work, mode=Mode.MANUAL)


def test_what_a_client_holds_is_let_go_of_when_it_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.opcua.ua_session.SILENCE", 0.5)

    async def work(rig: Served) -> None:
        ann, valve = await rig.client(), rig.machine.m.cell.valve
        await ann.write("cell.valve", 5.0)
        ann.node.stop()
        try:
            await until(lambda: valve.read() == 0.0, 10.0)
        finally:
            ann.node.go_on()

    run(work, mode=Mode.MANUAL)


def test_an_action_goes_on_while_its_client_waits_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.opcua.ua_session.SILENCE", 0.1)

    async def work(rig: Served) -> None:
        ann = await rig.client()
        cooking = asyncio.create_task(ann.call("cell.cook", {}))
        await until(lambda: any(each.path == "cell.cook" for each in rig.machine.events))
        number = rig.machine.number
        await until(lambda: rig.machine.number > number + 200)
        assert not cooking.done()
        await ann.kill()
        await until(lambda: any(each.state is CommandState.CANCELLED for each in rig.machine.events))
        with pytest.raises(RefusedByFace):
            await cooking

    run(work)


def test_a_client_lets_go_of_what_it_holds() -> None:
    async def work(rig: Served) -> None:
        ann, valve = await rig.client(), rig.machine.m.cell.valve
        await ann.write("cell.valve", 5.0)
        await ann.method("machine", "command:let go", "cell.valve")
        await until(lambda: valve.read() == 0.0)

    run(work, mode=Mode.MANUAL)


def test_commands_that_wait_are_answered_when_the_run_ends() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client()
        cooking = asyncio.create_task(ann.call("cell.cook", {}))
        await until(lambda: any(each.path == "cell.cook" for each in rig.machine.events))
        await rig.machine.end()
        with pytest.raises(RefusedByFace):
            await asyncio.wait_for(cooking, 10.0)

    run(work)


# Alarms, PackML ------------------------------------------------------------------------------------------

FIELDS = ["EventId", "Message", "Severity", "SourceName", "ConditionName", "Retain", "ActiveState.Id", "AckedState.Id"]


def test_an_alarm_is_a_condition_that_a_client_acknowledges() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client()
        told = await ann.node.ask("listen", fields=FIELDS, type="i=2915")
        assert told["status"] == "Good"
        heard: list[dict[str, Any]] = []

        async def comes(active: bool, acked: bool) -> dict[str, Any] | None:
            heard.extend((await ann.node.ask("heard"))["heard"])
            return next(
                (
                    each for each in heard
                    if (each["ConditionName"], each["ActiveState.Id"], each["AckedState.Id"])
                    == ("cell.full", active, acked)
                ),
                None,
            )  # fmt: skip

        rig.machine.set("cell.level", 190)
        event = await sooner_or_later(lambda: comes(True, False))
        assert (event["Severity"], event["Retain"], event["Message"]) == (400, True, "too full: unacknowledged")
        old = {"type": "ByteString", "value": "00" * 16}
        seen = {"type": "LocalizedText", "value": "seen"}
        with pytest.raises(RefusedByFace, match="BadEventIdUnknown"):
            await ann.method("condition:cell.full", "i=9111", old, seen)
        await ann.method("condition:cell.full", "i=9111", {"type": "ByteString", "value": event["EventId"]}, seen)
        event = await sooner_or_later(lambda: comes(True, True))
        assert event["Retain"]
        heard.clear()
        await ann.node.ask("refresh")
        await sooner_or_later(lambda: comes(True, True))
        heard.clear()
        await rig.machine.end()
        event = await sooner_or_later(lambda: comes(True, True))
        assert not event["Retain"], "no alarm of a machine that has ended stands"

    run(work)


def test_events_of_the_machine_and_refusals_are_told() -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client()
        await ann.node.ask("listen", fields=["Message", "SourceName", "Severity"])
        heard: list[dict[str, Any]] = []

        async def comes(*words: str) -> bool:
            heard.extend((await ann.node.ask("heard"))["heard"])
            return any(all(word in (each["Message"] or "") for word in words) for each in heard)

        await ann.tune("cell.gain", 2.0)
        await sooner_or_later(lambda: comes("ann", "tune cell.gain", "done"))
        with pytest.raises(RefusedByFace):
            await ann.tune("cell.gain", 11.0)
        await sooner_or_later(lambda: comes("ann: ", "11 mm"))

    run(work)


class Filler(Compound, equipment=True):
    """A part with PackML's states."""

    def setup(self) -> None:
        self.unit = PackML(self)


class Line(Plant):
    filler: Filler


def test_a_part_with_packml_states_is_an_object_of_opc_30050(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.conformance.tried_machine.Plant", partial(Line, filler=Filler()))

    async def work(rig: Served) -> None:
        ann = await rig.client()
        packml, own = ann.namespaces.index("http://opcfoundation.org/UA/PackML/"), ann.namespaces.index("urn:umo:plant")
        unit = f"/Objects/{packml}:PackMLObjects/{own}:PackML/{packml}:BaseStateMachine"
        execute = f"{unit}/{packml}:MachineState/{packml}:ExecuteState"

        async def is_in(path: str, name: str | None) -> bool:
            [target] = (await ann.node.ask("path", path=f"{path}/CurrentState"))["targets"]
            return (await ann.node.ask("text", name=target))["text"] == name

        await sooner_or_later(lambda: is_in(f"{unit}/{packml}:MachineState", "Stopped"))
        assert await is_in(unit, "Cleared")
        [states] = (await ann.node.ask("path", path=execute))["targets"]
        for command, state in (("Reset", "Idle"), ("Start", "Execute"), ("ToComplete", "Complete")):
            [target] = (await ann.node.ask("path", path=f"{execute}/{packml}:{command}"))["targets"]
            with pytest.raises(RefusedByFace, match="BadMethodInvalid"):
                await ann.method("machine", target)
            await ann.method(states, target)
            await sooner_or_later(lambda state=state: is_in(execute, state))
        [target] = (await ann.node.ask("path", path=f"{execute}/{packml}:Hold"))["targets"]
        with pytest.raises(RefusedByFace, match="hold"):
            await ann.method(states, target)

    run(work)


# Another machine -----------------------------------------------------------------------------------------


def test_a_station_that_comes_back_changed_has_new_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(rig: Served) -> None:
        ann = await rig.client(None)
        await ann.node.ask("subscribe", names=["cell.level"], interval=50)
        before = rig.face._shown
        assert (await ann.read("filler.unit.state")).value is None
        await rig.machine.end()
        monkeypatch.setattr("umo.clients.faces.conformance.tried_machine.Plant", partial(Line, filler=Filler()))
        rig.machine.m = plant()
        rig.machine.begin()
        await until(lambda: rig.face._shown is not before)
        heard: list[Any] = []

        async def gone() -> bool:
            heard.extend((await ann.node.ask("heard"))["heard"])
            return any(each[2] == "BadNodeIdUnknown" for each in heard)

        await sooner_or_later(gone)

        async def there() -> bool:
            return (await ann.read("filler.unit.state")).value == "stopped"

        await sooner_or_later(there)
        assert (await ann.read("cell.level")).value == 10.0
        own = ann.namespaces.index("urn:umo:plant")
        machines = await ann.node.ask("browse", name=f"ns={ann.namespaces.index(MACHINERY)};i=1001")
        assert [each["node"] for each in machines["references"]].count(f"ns={own};s=machine") == 1

    run(work)


# Units ---------------------------------------------------------------------------------------------------


def test_codes_of_units_are_numbers_of_their_characters() -> None:
    assert number_of("MMT") == 5066068  # OPC 10000-8, 5.6.4.3
    assert all(1 < len(code) < 4 and code.isalnum() for code in CODES.values())


def test_every_verb_of_alarms_is_a_method_of_each_and_of_the_machine() -> None:
    async def work(rig: Served) -> None:
        ann, alarm = await rig.client(), "condition:cell.full"
        rig.machine.set("cell.level", 170)
        await until(lambda: rig.machine.connection.machine.image.columns.alarms.any())
        assert await ann.method(alarm, f"{alarm}/RemoveFromService") == "out of service: cell.full"
        assert await ann.method("machine", "command:return to service", "cell.full") == "returned to service: cell.full"
        assert await ann.method("machine", "command:acknowledge alarm", "cell.full") == "acknowledged: cell.full"
        assert await ann.method(alarm, f"{alarm}/Shelve", 60.0) == "shelved for 60 s, or until the run ends: cell.full"
        assert await ann.method("machine", "command:unshelve", "cell.full") == "unshelved: cell.full"
        with pytest.raises(RefusedByFace, match="it cannot be reset"):
            await ann.method(alarm, f"{alarm}/Reset")
        with pytest.raises(RefusedByFace, match=r"BadInvalidArgument.*from 0\.001 to 604800 s"):
            await ann.method("machine", "command:shelve", "cell.full", -1.0)

    run(work)


def test_a_verb_that_has_another_place_is_a_method_too() -> None:
    async def work(rig: Served) -> None:
        ann, cell = await rig.client(), rig.machine.m.cell
        assert await ann.method("machine", "command:tune", "cell.gain", 2.0) == "1 -> 2"
        assert await ann.method("machine", "command:call", "cell.add", '{"weight": 1.5}') == 3.0
        await ann.method("machine", "command:write", "cell.valve", 3.0)
        number = rig.machine.number
        await until(lambda: rig.machine.number > number + 200)  # 1 s: twice the dead-man time
        assert cell.valve.read() == 3.0
        await ann.method("machine", "command:let go", "cell.valve")
        assert cell.valve.read() == 0.0

    run(work, mode=Mode.MANUAL)
