"""The face Sparkplug B with mosquitto, decoded by the npm package sparkplug-payload."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from helpers.faced import hosted
from helpers.mqtt import MOSQUITTO, Mosquitto, SparkplugHost
from umo.clients.faces.conformance import RULES, ForeignClient, RefusedByFace, TriedFace, TriedMachine, try_rule
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.face import Face
from umo.clients.faces.mqtt.broker import Broker
from umo.clients.faces.mqtt.sparkplug import Sparkplug
from umo.errors import OptionError, UmoError
from umo.operation.commands.roles import EVERYBODY
from umo.operation.commands.verbs import offered
from umo.process.frames.machine_items import Declaration

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(MOSQUITTO is None, reason="Debian's package mosquitto is not installed"),
]


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    found = Mosquitto(tmp_path)
    yield found
    found.kill()


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.smoke) if n == "tunes" else n for n in RULES])
def test_sparkplug_passes_the_kit(broker: Mosquitto, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "umo.clients.faces.conformance.face_rules.CHANGE_TIMEOUT", 5.0
    )  # node begins, and asks for a birth

    async def client(face: Face, user: str) -> ForeignClient:
        host = await SparkplugHost(user).connect(broker.port)
        await until(lambda: any(each["kind"] == "NBIRTH" for each in host.heard))
        return host

    tried = TriedFace("sparkplug", lambda: Sparkplug(port=broker.port), client, writes=False)
    assert asyncio.run(try_rule(tried, RULES[name])) in (None, "")


def kinds(host: SparkplugHost, kind: str) -> list[dict[str, Any]]:
    return [each for each in host.heard if each["kind"] == kind]


def metric_of(message: dict[str, Any], name: str) -> dict[str, Any]:
    return next(each for each in message["metrics"] if each["name"] == name)


def test_messages_are_numbered_and_the_birth_has_the_number_of_the_death(broker: Mosquitto) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            host = await SparkplugHost().connect(broker.port)
            try:
                async with hosted(machine, Sparkplug(port=broker.port)):
                    await until(lambda: len(kinds(host, "NDATA")) > 300)
                await until(lambda: kinds(host, "NDEATH"))
            finally:
                await host.close()
            birth = max(n for n, each in enumerate(host.heard) if each["kind"] == "NBIRTH")
            session = [each for each in host.heard[birth:] if each["kind"] in ("NBIRTH", "NDATA")]
            assert [each["seq"] for each in session] == [n % 256 for n in range(len(session))]
            death = kinds(host, "NDEATH")[-1]
            assert metric_of(death, "bdSeq")["value"] == metric_of(host.heard[birth], "bdSeq")["value"]

    asyncio.run(work())


def test_what_happens_while_the_broker_is_away_arrives_as_historical(broker: Mosquitto, links: list[Broker]) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            face, host = Sparkplug(port=broker.port), await SparkplugHost().connect(broker.port)
            try:
                async with hosted(machine, face):
                    await until(lambda: host.alive and kinds(host, "NDATA"))
                    broker.kill()
                    await until(lambda: not links[-1].is_up)
                    for raw in range(100, 110):
                        machine.set("cell.level", raw)
                        number = machine.number
                        await until(lambda n=number: machine.number > n + 10)  # type: ignore[misc]
                    births = len(kinds(host, "NBIRTH"))
                    broker.start()
                    await until(lambda: len(kinds(host, "NBIRTH")) > births)
                    await until(lambda: set(values_of(host)) >= {raw / 2 for raw in range(100, 109)})
                    assert values_of(host) == sorted(values_of(host))
                    assert face.dropped == 0
            finally:
                await host.close()

    def values_of(host: SparkplugHost) -> list[float]:
        metrics = [each for message in kinds(host, "NDATA") for each in message["metrics"]]
        return [each["value"] for each in metrics if each.get("isHistorical") and each["name"] == "cell/level"]

    asyncio.run(work())


async def until_later(machine: TriedMachine) -> None:
    """Some periods, whose values a face keeps or sends."""
    number = machine.number
    await until(lambda: machine.number > number + 50)


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> list[Broker]:
    """The connections to the broker that faces begin."""
    made: list[Broker] = []

    def begin(*given: Any, **more: Any) -> Broker:
        made.append(Broker(*given, **more))
        return made[-1]

    monkeypatch.setattr("umo.clients.faces.mqtt.sparkplug.Broker", begin)
    return made


def test_a_full_store_drops_the_oldest_and_counts(broker: Mosquitto) -> None:
    broker.kill()

    async def work() -> None:
        async with TriedMachine() as machine:
            face, host = Sparkplug(port=broker.port, store=20), SparkplugHost()
            async with hosted(machine, face):
                await until(lambda: face.dropped > 10)
                assert len(face._stored) == 20
                oldest, dropped = face._stored[0].timestamp, face.dropped
                await until(lambda: face.dropped > dropped + 40)
                assert face._stored[0].timestamp > oldest
                broker.start()
                await host.connect(broker.port)
                try:
                    await until(lambda: host.alive)
                    assert metric_of(kinds(host, "NBIRTH")[-1], "Node Info/Dropped")["value"] > 10
                finally:
                    await host.close()

    asyncio.run(work())


def test_nothing_is_sent_until_the_primary_host_is_online(broker: Mosquitto, links: list[Broker]) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            face, host = Sparkplug(port=broker.port, primary="scada"), await SparkplugHost().connect(broker.port)
            state = {"topic": "spBv1.0/STATE/scada", "retain": True}
            try:
                async with hosted(machine, face):
                    await until(lambda: links and links[-1].is_up)
                    await until_later(machine)
                    assert not kinds(host, "NBIRTH")
                    at = int(time.time() * 1000)
                    host.send({**state, "text": f'{{"online": true, "timestamp": {at}}}'})
                    await until(lambda: host.alive)
                    host.send({**state, "text": f'{{"online": false, "timestamp": {at - 1}}}'})  # of an older session
                    host.send({**state, "text": f'{{"online": false, "timestamp": {at + 1}}}'})
                    await until(lambda: kinds(host, "NDEATH"))
                    await until(lambda: len(links) == 2 and links[-1].is_up)
                    await until_later(machine)
                    assert not host.alive
                    host.send({**state, "text": f'{{"online": true, "timestamp": {at + 2}}}'})
                    await until(lambda: host.alive)
            finally:
                await host.close()

    asyncio.run(work())


def test_a_retained_command_is_not_carried_out_and_the_next_one_is(broker: Mosquitto) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            host = await SparkplugHost().connect(broker.port)
            try:
                await until(lambda: kinds(host, "connected"))
                old = {"name": "tunable:cell/gain", "type": "Double", "value": 7.0}
                host.send({"metrics": [old], "retain": True})
                await host.heard_by_broker()
                async with hosted(machine, Sparkplug(port=broker.port)):
                    await until(lambda: host.alive)
                    await host.tune("cell.gain", 2.0)  # behind the retained one, which the broker gives first
                    told = [each.text for each in machine.events if each.path == "cell.gain"]
                    assert machine.m.cell.gain == 2.0
                    assert not [each for each in told if "7" in each]
            finally:
                await host.close()

    asyncio.run(work())


def test_bytes_of_no_meaning_are_not_heard(broker: Mosquitto) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            host = await SparkplugHost().connect(broker.port)
            try:
                async with hosted(machine, Sparkplug(port=broker.port)):
                    await until(lambda: host.alive)
                    host.send({"topic": "spBv1.0/umo/NCMD/plant", "text": "\x01\x02nonsense"})
                    await host.tune("cell.gain", 2.0)
                    assert machine.m.cell.gain == 2.0
            finally:
                await host.close()

    asyncio.run(work())


def test_a_broker_on_another_computer_needs_tls() -> None:
    with pytest.raises(OptionError, match="give `ca`"):
        Sparkplug(host="broker.example")


def test_a_password_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="give both `user` and `password_file`"):
        Sparkplug(user="ann")
    with pytest.raises(UmoError, match="the password cannot be read"):
        asyncio.run(Sparkplug(user="ann", password_file=tmp_path / "none").open())


KILLED = """
import asyncio, os, signal, sys
import numpy as np
from umo.clients.faces.face import Changes
from umo.process.frames.machine_items import Declaration, MachineItem, ItemKind
from umo.process.frames.machine_items import Declaration
from umo.clients.faces.mqtt.broker import Broker
from umo.clients.faces.mqtt.sparkplug import Sparkplug

async def work():
    face = Sparkplug(port=int(sys.argv[1]))
    item = MachineItem(0, ItemKind.SENSOR, "cell.level", {})
    await face.begin(Declaration("plant", "", "1-1", 0.01, 0.0, (item,), (), (), (), False), None)
    await face.frames(Changes(1, 1e9, None, np.arange(1), np.ones(1), np.zeros(1, np.uint8), np.array([1e9])))
    await asyncio.to_thread(sys.stdin.readline)
    os.kill(os.getpid(), signal.SIGKILL)

asyncio.run(work())
"""


def test_the_broker_tells_the_death_of_a_face_that_was_killed(broker: Mosquitto) -> None:
    async def work() -> None:
        host = await SparkplugHost().connect(broker.port)
        try:
            await until(lambda: kinds(host, "connected"))
            pipe = asyncio.subprocess.PIPE
            face = await asyncio.create_subprocess_exec(sys.executable, "-c", KILLED, str(broker.port), stdin=pipe)
            await until(lambda: host.alive)
            await face.communicate(b"\n")
            await until(lambda: kinds(host, "NDEATH"))
            birth, death = kinds(host, "NBIRTH")[-1], kinds(host, "NDEATH")[-1]
            assert metric_of(death, "bdSeq")["value"] == metric_of(birth, "bdSeq")["value"]
        finally:
            await host.close()

    asyncio.run(work())


def test_a_broker_that_is_not_there_is_told_once(
    broker: Mosquitto, links: list[Broker], caplog: pytest.LogCaptureFixture
) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            broker.kill()
            face = Sparkplug(port=broker.port)
            async with hosted(machine, face):
                await until(lambda: caplog.messages)
                broker.start()
                await until(lambda: links and links[-1].is_up)
        address = f"mqtt://127.0.0.1:{broker.port}"
        assert caplog.messages == [f"{address} cannot be reached: Connection refused; umo tries again"]

    asyncio.run(work())


def test_what_no_client_may_set_is_born_as_read_only(broker: Mosquitto) -> None:
    """An actuator, too: Sparkplug does not tell whether a client lives."""

    async def work() -> None:
        async with TriedMachine() as machine, hosted(machine, Sparkplug(port=broker.port)):
            host = await SparkplugHost().connect(broker.port)
            try:
                await until(lambda: kinds(host, "NBIRTH"))
            finally:
                await host.close()
            birth = kinds(host, "NBIRTH")[-1]
            named = [each for each in birth["metrics"] if "Quality" in each.get("properties", {})]
            free = {each["name"] for each in named if "readOnly" not in each["properties"]}
            assert free == {"tunable:cell/gain", "run:mode"}

    asyncio.run(work())


class Refused(Broker):
    """Counts the attempts that no broker heard."""

    attempts = 0

    def _failed(self, client: Any, data: Any) -> None:
        super()._failed(client, data)
        Refused.attempts += 1


def test_bd_seq_counts_connect_packets_not_attempts_that_nobody_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.mqtt.broker.FIRST_PAUSE", 0)
    monkeypatch.setattr("umo.clients.faces.mqtt.broker.MAX_PAUSE", 0)
    monkeypatch.setattr("umo.clients.faces.mqtt.sparkplug.Broker", Refused)
    heard: list[bytes] = []

    async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        heard.append(await reader.read(1000))  # and closes, without an answer
        writer.close()

    async def work() -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        face = Sparkplug(port=port)
        before = face._bd_seq
        await face.begin(Declaration("plant", "", "1-1", 0.01, 0.0, (), (), (), (), False), None)  # type: ignore[arg-type]
        await until(lambda: Refused.attempts >= 3)
        assert face._bd_seq == before
        server = await asyncio.start_server(take, "127.0.0.1", port)
        await until(lambda: len(heard) >= 3)
        await face.end("")
        server.close()
        assert (face._bd_seq - before) % 256 in (len(heard), len(heard) + 1)  # one may be under way

    asyncio.run(work())


def test_every_verb_is_a_metric(broker: Mosquitto) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            host = await SparkplugHost().connect(broker.port)
            try:
                async with hosted(machine, Sparkplug(port=broker.port), roles=lambda: EVERYBODY):
                    await until(lambda: kinds(host, "NBIRTH"))
                    names = {each["name"] for each in kinds(host, "NBIRTH")[-1]["metrics"]}
                    assert {f"verb:{verb.word}" for verb in offered()} <= names
                    for verb, more, done in (
                        ("remove_from_service", {}, "out of service: cell.full"),
                        ("return_to_service", {}, "returned to service: cell.full"),
                        ("shelve", {"time": "10 min"}, "shelved for 600 s, or until the run ends: cell.full"),
                        ("unshelve", {}, "unshelved: cell.full"),
                    ):
                        given = json.dumps({"path": "cell.full", **more})
                        assert await host.ask(f"verb:{verb}", given, "String") == done
                    with pytest.raises(RefusedByFace, match="shelve needs time"):
                        await host.ask("verb:shelve", '{"path": "cell.full"}', "String")
            finally:
                await host.close()

    asyncio.run(work())
