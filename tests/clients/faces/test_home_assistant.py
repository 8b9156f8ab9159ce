"""The face Home Assistant with mosquitto, read by the npm package mqtt."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.faced import hosted
from helpers.foreign_python import foreign_python
from helpers.home_assistant import HomeAssistantClient, rendered
from helpers.mqtt import MOSQUITTO, Mosquitto
from umo import connect, published
from umo.clients.faces.conformance import RULES, ForeignClient, RefusedByFace, TriedFace, TriedMachine, try_rule
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.faces.face import Changes, Face
from umo.clients.faces.mqtt.home_assistant import HomeAssistant
from umo.clients.faces.mqtt.home_assistant_discovery import discovery, told
from umo.errors import OptionError
from umo.objects import Quality
from umo.operation.alarms.alarm_states import AlarmState
from umo.process.frames import Reader
from umo.process.frames.machine_items import Declaration, ItemKind, MachineItem, declaration_of
from umo.process.station import Station, shipped

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux"),
    pytest.mark.skipif(MOSQUITTO is None, reason="Debian's package mosquitto is not installed"),
]
JUDGE = Path(__file__).parent / "home_assistant"
NEEDED = {"sensor": "state_topic", "binary_sensor": "state_topic", "number": "command_topic", "button": "command_topic"}
"""What the documentation of each entity requires."""


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    found = Mosquitto(tmp_path)
    yield found
    found.kill()


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.smoke) if n == "tunes" else n for n in RULES])
def test_home_assistant_passes_the_kit(broker: Mosquitto, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.conformance.face_rules.CHANGE_TIMEOUT", 5.0)  # node begins

    async def client(face: Face, user: str) -> ForeignClient:
        found = await HomeAssistantClient(user).connect(broker.port)
        await until(lambda: len(found.entities) > 10 and found.topics.get("umo/plant/status") == "online")
        return found

    def face() -> Face:
        return HomeAssistant(port=broker.port)

    tried = TriedFace("homeassistant", face, client, writes=False, is_named=False)
    assert asyncio.run(try_rule(tried, RULES[name])) in (None, "")


def tried(broker: Mosquitto, work: Callable[..., Any], read_only: bool = False) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine:
            host = await HomeAssistantClient().connect(broker.port)
            try:
                async with hosted(machine, HomeAssistant(port=broker.port), read_only=read_only):
                    await until(lambda: host.topics.get("umo/plant/status") == "online")
                    await host.heard_by_broker()  # what is retained comes in any order
                    await work(machine, host)
            finally:
                await host.close()

    asyncio.run(all_of_it())


def level(host: HomeAssistantClient) -> Any:
    return json.loads(host.topics["umo/plant/value/cell/level"])


def test_every_item_is_discovered_with_what_its_entity_requires(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        found = {t: json.loads(x) for t, x in host.topics.items() if t.startswith("homeassistant/") and x}
        kinds = {topic.split("/")[1] for topic in found}
        assert kinds == set(NEEDED)
        for topic, about in found.items():
            assert NEEDED[topic.split("/")[1]] in about, topic
        names = [about["unique_id"] for about in found.values()]
        assert len(names) == len(set(names))
        about = found["homeassistant/sensor/umo-plant/cell-level/config"]
        assert about["unit_of_measurement"] == "mm"
        number = found["homeassistant/number/umo-plant/tunable--cell-gain/config"]
        assert (number["min"], number["max"]) == (0.0, 10.0)
        binary = found["homeassistant/binary_sensor/umo-plant/cell-limit/config"]
        assert (binary["payload_off"], binary["payload_on"]) == ("PASS", "FAIL")

    tried(broker, work)


def test_a_stale_value_is_told_as_such(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        await until(lambda: level(host)["value"] == 10.0 and level(host)["quality"] == "good")
        machine.set("cell.level", OSError("unplugged"))
        await until(lambda: level(host)["quality"] == "stale")

    tried(broker, work)


def test_a_number_is_set_a_button_pressed_and_a_refusal_told(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        host.send({"topic": "umo/plant/set/cell/gain", "text": "2.5"})
        await until(lambda: machine.m.cell.gain == 2.5)
        host.send({"topic": "umo/plant/set/cell/gain", "text": "11"})
        await until(lambda: "11" in host.topics.get("umo/plant/refusal", ""))
        host.send({"topic": "umo/plant/set/cell/gain", "text": "much"})
        await until(lambda: "not a number" in host.topics["umo/plant/refusal"])
        assert machine.m.cell.gain == 2.5
        host.send({"topic": "umo/plant/press/cell/cook", "text": "PRESS"})
        await until(lambda: any(each.path == "cell.cook" for each in machine.events))
        who = [each.who for each in machine.events if each.path == "cell.gain"]
        assert who[0].startswith("homeassistant, unverified")

    tried(broker, work)


def test_a_retained_order_is_not_carried_out_and_the_next_one_is(broker: Mosquitto) -> None:
    async def work() -> None:
        async with TriedMachine() as machine:
            host = await HomeAssistantClient().connect(broker.port)
            try:
                host.send({"topic": "umo/plant/set/cell/gain", "text": "7", "retain": True})
                await until(lambda: "umo/plant/set/cell/gain" in host.topics)
                async with hosted(machine, HomeAssistant(port=broker.port)):
                    await until(lambda: host.topics.get("umo/plant/status") == "online")
                    await host.tune("cell.gain", 2.0)
                    assert machine.m.cell.gain == 2.0
                    assert not [each for each in machine.events if each.path == "cell.gain" and "7" in each.text]
            finally:
                await host.close()

    asyncio.run(work())


def test_without_commands_everything_is_refused(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        host.send({"topic": "umo/plant/set/cell/gain", "text": "2.5"})
        await until(lambda: "only reads" in host.topics.get("umo/plant/refusal", ""))
        assert machine.m.cell.gain == 1.0

    tried(broker, work, read_only=True)


def test_at_the_end_the_device_is_offline(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        await machine.end()
        await until(lambda: host.topics["umo/plant/status"] == "offline")
        machine.begin()
        await until(lambda: host.topics["umo/plant/status"] == "online")

    tried(broker, work)


def test_a_prefix_that_no_topic_can_have_is_refused() -> None:
    with pytest.raises(OptionError, match="prefix"):
        HomeAssistant(prefix="a/#")


# How often ------------------------------------------------------------------------------------------------


class Network:
    """In place of a broker: notes what it is given; `room`: how many messages it still takes."""

    is_up = True

    def __init__(self, address: Any, name: Any, will: Any, topics: Any, came_up: Callable[[], None], *_: Any) -> None:
        self.came_up = came_up
        self.told: list[str] = []
        self.room = 1000

    def start(self) -> None:
        pass

    def send(self, topic: str, payload: bytes, retain: bool = False) -> bool:
        self.room -= 1
        if self.room >= 0:
            self.told.append(topic.removeprefix("umo/plant/value/"))
        return self.room >= 0

    async def stop(self, last: Any) -> None:
        pass


MACHINE = Declaration(
    "plant", "", "1-1", 0.01, 0.0,
    (
        MachineItem(0, ItemKind.SENSOR, "level", {}),
        MachineItem(1, ItemKind.SENSOR, "limit", {}, states={0: "NO", 1: "YES"}),
    ),
    (), (), (), False,
)  # fmt: skip


def changed(*places: int, stale: int = -1) -> Changes:
    quality = np.array([Quality.STALE if place == stale else Quality.GOOD for place in range(2)], np.uint8)
    return Changes(1, 1e9, None, np.array(places), np.ones(2), quality, np.full(2, 1e9))


async def begun(monkeypatch: pytest.MonkeyPatch) -> tuple[HomeAssistant, Network]:
    made: list[Network] = []
    monkeypatch.setattr(
        "umo.clients.faces.mqtt.home_assistant.Broker", lambda *given: made.append(Network(*given)) or made[-1]
    )
    face = HomeAssistant(interval=0.1)
    await face.begin(MACHINE, None)  # type: ignore[arg-type]
    (network,) = made
    return face, network


def test_states_and_qualities_are_told_at_once_and_numbers_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        face, network = await begun(monkeypatch)
        for places, stale, at_once in (((0, 1), -1, ["level", "limit"]), ((0, 1), -1, ["limit"]), ((0,), 0, ["level"])):
            network.told.clear()
            await face.frames(changed(*places, stale=stale))
            assert network.told == at_once
        await face.frames(changed(0, stale=0))
        await face.frames(changed(0, stale=0))
        network.told.clear()
        await until(lambda: network.told)
        assert network.told == ["level"]
        await face.end("")

    asyncio.run(work())


def test_what_the_network_does_not_take_is_told_later(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        face, network = await begun(monkeypatch)
        network.room = 2
        network.came_up()
        await face.frames(changed(0, 1))
        assert len(network.told) == 2
        network.room = 1000
        await until(lambda: "umo/plant/status" in network.told)
        assert all(each.startswith("homeassistant/") for each in network.told[:6])
        assert network.told[6:] == ["umo/plant/declaration", "level", "limit", "umo/plant/status"]
        await face.end("")

    asyncio.run(work())


@pytest.mark.parametrize("interval", [0.01, 1e9, float("nan")])
def test_an_interval_out_of_its_range_is_refused(interval: float) -> None:
    with pytest.raises(OptionError, match="interval"):
        HomeAssistant(interval=interval)


# Judged by Home Assistant --------------------------------------------------------------------------------


def judged(lines: list[Any]) -> str:
    """What Home Assistant's own schemas and templates say of [component, configuration, text of the value]."""
    python = os.environ.get("UMO_HOMEASSISTANT_PYTHON") or foreign_python(JUDGE / "requirements.txt", "Home Assistant")
    text = "\n".join(map(json.dumps, lines))
    done = subprocess.run([python, JUDGE / "judge_discovery.py"], input=text, text=True, capture_output=True)
    return done.stdout or done.stderr


@pytest.mark.timeout(600)  # it is installed once
def test_home_assistants_own_schemas_and_templates_accept_the_kits_machine(broker: Mosquitto) -> None:
    lines: list[Any] = []

    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        values = {each["state_topic"] for each in host.entities.values() if "state_topic" in each} - {
            "umo/plant/refusal"
        }
        await until(lambda: values <= set(host.topics) and len(values) > 10)
        for topic, text in list(host.topics.items()):
            if topic.startswith("homeassistant/") and text:
                about = json.loads(text)
                lines.append([topic.split("/")[1], about, host.topics.get(about.get("state_topic", ""))])

    tried(broker, work)
    assert len([each for each in lines if each[2]]) > 10
    assert judged(lines) == "judged\n"


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", shipped())
def test_home_assistants_own_schemas_accept_the_stations_that_ship(name: str) -> None:
    connection = connect(Station(name, shipped()[name]).machine())
    with connection, published(connection, name, "simulated") as ring, Reader(ring.path) as reader:
        found = discovery(declaration_of(reader), f"umo/{name}", "homeassistant")
    assert len(found) > 5
    assert judged([[topic.split("/")[1], about, None] for topic, about in found.items()]) == "judged\n"


@pytest.mark.timeout(600)
def test_home_assistants_own_schemas_can_say_no() -> None:
    config = {"state_topic": "a", "device_class": "enum", "options": ["a"], "value_template": "{{ value_json.value }}"}
    wrong = ["sensor", {**config, "availability": []}, '{"value": "b"}']
    said = judged([["number", config, None], wrong]).splitlines()
    assert len(said) == 3
    assert "none of its options" in said[1]


# Templates, rendered by Jinja ----------------------------------------------------------------------------

STATES = {0: "is 'off'", 1: 'über "2" {{ x }} \\'}
ITEMS = (
    MachineItem(0, ItemKind.SENSOR, "hot", {"resolution": 0.25}, "degC", 0.0, 100.0),
    MachineItem(1, ItemKind.ACTUATOR, "valve", {}, states=STATES),
    MachineItem(2, ItemKind.SENSOR, "limit", {}, states=STATES),
    MachineItem(3, ItemKind.ALARM, "full", {}, states={n: str(each) for n, each in enumerate(AlarmState)}),
    MachineItem(4, ItemKind.EQUIPMENT, "mixer", {}, states={0: "normal", 1: "fault"}),
    MachineItem(5, ItemKind.TUNABLE, "gain", {}, "l", 0.0, 1.0),
    MachineItem(6, ItemKind.SIGNAL, "phase", {}, states={0: "idle", 7: "filling"}),
    MachineItem(7, ItemKind.RUN, "wake", {}, "s"),
)


def entity_of(item: MachineItem) -> tuple[str, dict[str, Any]]:
    """Component and configuration."""
    machine = Declaration("plant", "", "1-1", 0.01, 0.0, (replace(item, number=0),), (), (), (), False)
    (found,) = ((topic, each) for topic, each in discovery(machine, "b", "p").items() if each["name"] == item.name)
    return found[0].split("/")[1], dict(found[1])


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.name)
def test_every_quality_of_every_type_is_rendered(item: MachineItem) -> None:
    component, about = entity_of(item)
    for quality in Quality:
        for value in (0.0, 1.0, 7.0, 99.0, 1e-7, float("inf"), float("nan")):
            judge(item, component, about, quality, value)


def judge(item: MachineItem, component: str, about: dict[str, Any], quality: Quality, value: float) -> None:
    text = told(replace(item, number=0), changes_of(value, quality)).decode()
    online = all(rendered(each["value_template"], text) == "online" for each in about["availability"][2:])
    assert online == (quality in (Quality.GOOD, Quality.OUT_OF_RANGE, Quality.UNREFERENCED))
    state, name = rendered(about["value_template"], text), item.states.get(int(value)) if value % 1.0 == 0.0 else None
    if quality is Quality.BAD or not isfinite(value) or (item.states and name is None):
        assert state == "None"
    elif about.get("device_class") == "problem":
        assert state == ("OFF" if name in ("normal", "shelved", "shelved active", "out of service") else "ON")
    elif item.states:
        assert state == name
        assert state in (about.get("options") or (about["payload_off"], about["payload_on"]))
    else:
        assert float(state) == value
        assert component in ("sensor", "number")


def changes_of(value: float, quality: Quality) -> Changes:
    return Changes(1, 1e9, None, np.arange(1), np.array([value]), np.array([quality], np.uint8), np.array([1e9]))


def test_a_unit_tells_the_class_and_the_resolution_the_digits() -> None:
    about = entity_of(ITEMS[0])[1]
    assert (about["device_class"], about["unit_of_measurement"]) == ("temperature", "°C")
    assert (about["suggested_display_precision"], about["state_class"]) == (2, "measurement")
    assert entity_of(ITEMS[3])[0] == entity_of(ITEMS[4])[0] == "binary_sensor"
    kelvin = entity_of(replace(ITEMS[0], unit="K"))[1]
    assert "device_class" not in kelvin
    liters = entity_of(replace(ITEMS[0], unit="l/min"))[1]
    assert (liters["device_class"], liters["unit_of_measurement"]) == ("volume_flow_rate", "L/min")
    error = entity_of(replace(ITEMS[0], kind=ItemKind.SIGNAL))[1]
    assert "device_class" not in error, "a difference of 0 °C would be shown as 32 °F"


@pytest.mark.timeout(600)
def test_home_assistants_own_rules_accept_every_class_and_unit() -> None:
    units = ("degC", "degF", "kPa", "V", "mA", "W", "Hz", "mm", "m/s", "kg", "l", "m**3", "l/min", "s", "lux", "um", "")
    items = [replace(ITEMS[0], unit=unit) for unit in units]
    lines = [
        [*entity_of(each), told(replace(each, number=0), changes_of(1.0, Quality.GOOD)).decode()]
        for each in (*items, *ITEMS)
    ]
    assert judged(lines) == "judged\n"


def test_every_verb_is_given_by_its_topic(broker: Mosquitto) -> None:
    async def work(machine: TriedMachine, host: HomeAssistantClient) -> None:
        states = machine.connection.machine.image.columns.alarms
        for verb, more, state in (
            ("remove_from_service", {}, AlarmState.OUT_OF_SERVICE),
            ("return_to_service", {}, AlarmState.NORMAL),
            ("shelve", {"time": "10 min"}, AlarmState.SHELVED),
            ("unshelve", {}, AlarmState.NORMAL),
        ):
            await host.order(f"umo/plant/do/{verb}", "cell.full", json.dumps({"path": "cell.full", **more}))
            await until(lambda state=state: states[0] == state)
        with pytest.raises(RefusedByFace, match="shelve needs time"):
            await host.order("umo/plant/do/shelve", "cell.full", '{"path": "cell.full"}')
        with pytest.raises(RefusedByFace, match="did you mean 'shelve'"):
            await host.order("umo/plant/do/shelv", "shelv", "{}")

    tried(broker, work)
