"""The faces of MQTT without a broker, or with one that answers nothing."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from math import inf
from typing import Any

import numpy as np
import pytest

pytest.importorskip("paho.mqtt", reason="the faces sparkplug and homeassistant need paho: pip install '.[sparkplug]'")
pytest.importorskip("google.protobuf", reason="the face sparkplug needs protobuf: pip install '.[sparkplug]'")

from umo.clients.faces.face import Changes
from umo.clients.faces.mqtt import home_assistant, sparkplug
from umo.clients.faces.mqtt.home_assistant import HomeAssistant
from umo.clients.faces.mqtt.home_assistant_discovery import discovery
from umo.clients.faces.mqtt.sparkplug import Sparkplug
from umo.clients.faces.mqtt.sparkplug_payload import Payload, put_value
from umo.errors import StateError
from umo.process.frames.machine_items import Declaration, ItemKind, MachineItem


def declared(*paths: str, kind: ItemKind = ItemKind.SENSOR, **more: Any) -> Declaration:
    items = tuple(MachineItem(number, kind, path, {}, **more) for number, path in enumerate(paths))
    return Declaration("plant", "", "1-1", 0.01, 0.0, items, (), (), (), True)


def everything(machine: Declaration) -> Changes:
    count = len(machine.items)
    values, times = np.ones(count), np.full(count, 1e9)
    return Changes(1, 1e9, None, np.arange(count), values, np.zeros(count, np.uint8), times)


class Link:
    """In place of a connection: it takes `room` messages at each look."""

    made: list[Link]

    def __init__(self, address: Any, name: str, will: Any, topics: Any, on_up: Any, on_message: Any, **more: Any):
        self.on_up, self.on_message = on_up, on_message
        self.taken: list[tuple[str, bytes]] = []
        self.room, self.is_up, self.ended = 10**6, False, False
        self.made.append(self)

    def start(self) -> None:
        self.is_up = True
        self.on_up()

    def send(self, topic: str, payload: bytes, retain: bool = False) -> bool:
        if not self.room:
            return False
        self.room -= 1
        self.taken.append((topic, payload))
        return True

    async def stop(self, last: Any) -> None:
        await asyncio.sleep(0)
        self.ended = True


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> list[Link]:
    Link.made = []
    for module in (home_assistant, sparkplug):
        monkeypatch.setattr(module, "Broker", Link)
    return Link.made


def test_what_the_broker_does_not_take_at_once_follows_and_then_the_device_is_online(links: list[Link]) -> None:
    async def work() -> None:
        face, machine = HomeAssistant(), declared(*(f"part.n{number}" for number in range(40)))
        await face.begin(machine, None)  # type: ignore[arg-type]
        for _ in range(20):
            links[0].room = 12
            await face.frames(everything(machine))
        topics = [topic for topic, _ in links[0].taken]
        assert {f"umo/plant/value/part/n{number}" for number in range(40)} < set(topics)
        assert sum(topic.startswith("homeassistant/") for topic, payload in links[0].taken if payload) == 41
        assert topics.index("umo/plant/status") > topics.index("umo/plant/value/part/n39")

    asyncio.run(work())


def test_what_the_broker_does_not_take_goes_before_what_changes_afterwards(links: list[Link]) -> None:
    async def work() -> None:
        face, machine = HomeAssistant(), declared(*"abcdef", states={0: "NO", 1: "YES"})
        await face.begin(machine, None)  # type: ignore[arg-type]
        await face.frames(everything(machine))
        links[0].taken.clear()
        for _ in range(3):  # at each look all of them change
            links[0].room = 2
            await face.frames(everything(machine))
        assert "".join(topic[-1] for topic, _ in links[0].taken) == "abcdef"
        await face.end("it has ended")

    asyncio.run(work())


def test_items_whose_names_make_one_topic_do_not_stop_the_others(links: list[Link]) -> None:
    async def work() -> None:
        face, machine = HomeAssistant(), declared("a+b", "a_b", states={0: "NO", 1: "YES"})
        await face.begin(machine, None)  # type: ignore[arg-type]
        for _ in range(2):
            links[0].taken.clear()
            await face.frames(everything(machine))
            assert "umo/plant/value/a_b" in dict(links[0].taken)
        await face.end("it has ended")

    asyncio.run(work())


def test_what_the_broker_keeps_of_another_declaration_counts_no_longer(links: list[Link]) -> None:
    """A part that is gone would stand in Home Assistant with its last value for ever, and be good."""

    async def work() -> None:
        face = HomeAssistant()
        for machine in (declared("old.level", "new.level"), declared("new.level")):
            await face.begin(machine, None)  # type: ignore[arg-type]
            await face.frames(everything(machine))
            await face.end("it has ended")
        told = dict(links[0].taken) | dict(links[1].taken)
        mark = told["umo/plant/declaration"].decode()
        for path, counts in (("old-level", False), ("new-level", True)):
            config = json.loads(told[f"homeassistant/sensor/umo-plant/{path}/config"])
            conditions = {each["topic"]: each.get("value_template", "") for each in config["availability"]}
            assert (f"'{mark}'" in conditions["umo/plant/declaration"]) == counts
            assert config["availability_mode"] == "all"

    asyncio.run(work())


def test_items_whose_names_look_alike_in_topics_are_all_discovered() -> None:
    found = discovery(declared("a.b_c", "a_b.c"), "umo/plant", "homeassistant")
    states = {each["state_topic"] for each in found.values()}
    assert {"umo/plant/value/a/b_c", "umo/plant/value/a_b/c"} < states
    assert len({each["unique_id"] for each in found.values()}) == len(found)


def test_a_number_without_limits_gets_such_as_json_has() -> None:
    machine = declared("gain", kind=ItemKind.TUNABLE, minimum=-inf, maximum=inf)
    (found,) = (each for topic, each in discovery(machine, "umo/plant", "ha").items() if "/number/" in topic)
    assert json.loads(json.dumps(found, allow_nan=False))["min"] == -1e9


async def others_end() -> None:
    """Every other task of this loop has ended."""
    while others := asyncio.all_tasks() - {asyncio.current_task()}:  # type: ignore[arg-type]
        await asyncio.gather(*others)


# Sparkplug -------------------------------------------------------------------------------------------------


def test_a_primary_host_that_comes_and_goes_at_once_leaves_one_connection(links: list[Link]) -> None:
    async def work() -> None:
        face, machine = Sparkplug(primary="scada"), declared("level")
        await face.begin(machine, object())  # type: ignore[arg-type]
        for number, online in enumerate((True, False, True, False)):
            links[0].on_message("spBv1.0/STATE/scada", json.dumps({"online": online, "timestamp": number}).encode())
        await others_end()
        assert [each.ended for each in links] == [True, False]
        await face.end("it has ended")

    asyncio.run(work())


def test_a_command_of_any_type_is_answered(links: list[Link]) -> None:
    class Refuses:
        async def ask(self, user: Any, do: str, path: str = "", **more: Any) -> Any:
            raise StateError("no")

    async def work() -> None:
        face, machine = Sparkplug(), declared("gain", kind=ItemKind.TUNABLE)
        await face.begin(machine, Refuses())
        await face.frames(everything(machine))
        payload = Payload()
        for value in (b"\xff", None, True, "much", 1 << 62):
            metric = payload.metrics.add(name="tunable:gain")
            if isinstance(value, bytes):
                metric.bytes_value = value
            else:
                put_value(metric, value)
        broken = payload.metrics.add(name="abcd")
        data = payload.SerializeToString().replace(broken.name.encode(), b"\xff\xfe\xfd\xfc")
        links[0].on_message("spBv1.0/umo/NCMD/plant", data)
        await others_end()
        answers = [each for topic, each in links[0].taken if "NDATA" in topic]
        assert len(answers) == 6

    asyncio.run(work())


# A broker that answers nothing -----------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.parametrize("face", [HomeAssistant, Sparkplug])
def test_a_broker_that_accepts_and_never_answers_does_not_delay_the_end(face: Any) -> None:
    async def work() -> float:
        with socket.create_server(("127.0.0.1", 0)) as silent:
            served, machine = face(port=silent.getsockname()[1]), declared("level")
            await served.begin(machine, None)
            with (await asyncio.to_thread(silent.accept))[0]:
                await served.frames(everything(machine))
                start = time.monotonic()
                await served.end("it has ended")
                return time.monotonic() - start

    assert asyncio.run(work()) < 8.0  # the limit is that of paho: it looks once a second
