"""Home Assistant as the conformance kit for faces needs it: its MQTT discovery, over the npm package mqtt.

Home Assistant knows neither the user of an order nor its end: an answer is that of the oldest order for its path.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict, deque
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from jinja2.sandbox import ImmutableSandboxedEnvironment

from helpers.mqtt import SparkplugHost
from umo.clients.faces.conformance import RefusedByFace, Seen
from umo.clients.faces.conformance.client import Grade
from umo.process.frames.machine_items import QUIET

NOTHING = Seen(None, Grade.NONE)
TEMPLATES = ImmutableSandboxedEnvironment()
"""As Home Assistant has it. Its own filters are not used; `judge_discovery.py` has all of it."""


def rendered(template: str, text: str) -> str:
    """What a template makes of a message."""
    value_json = json.loads(text) if text.startswith("{") else None
    return str(TEMPLATES.from_string(template).render(value=text, value_json=value_json))


class HomeAssistantClient(SparkplugHost):
    """`entities`: the configuration of each by its unique_id; `topics`: the last text of each topic."""

    def __init__(self, user: str = "", station: str = "plant") -> None:
        super().__init__(user)
        self.station = station
        self.topics: dict[str, str] = {}
        self.entities: dict[str, dict[str, Any]] = {}
        self._orders: dict[str, deque[asyncio.Future[None]]] = defaultdict(deque)

    def _take(self, message: dict[str, Any]) -> None:
        if message["kind"] != "plain":
            return
        topic, text = message["topic"], message["text"]
        self.heard.append(message)
        self.topics[topic] = text
        if topic.startswith("homeassistant/") and text:
            about = json.loads(text)
            self.entities[about["unique_id"]] = about
        elif topic.endswith(("/done", "/refusal")):
            self._answered(json.loads(text), topic.endswith("/done"))

    def _answered(self, answer: Mapping[str, Any], is_done: bool) -> None:
        orders = self._orders[answer["path"]]
        if orders and not (waiting := orders.popleft()).done():
            waiting.set_result(None) if is_done else waiting.set_exception(RefusedByFace(answer["text"]))

    def entity(self, name: str) -> dict[str, Any] | None:
        return next((each for each in self.entities.values() if each["name"] == name), None)

    def is_available(self, about: Mapping[str, Any]) -> bool:
        """Whether each of its topics says so."""
        return all(self._payload(each) == "online" for each in about["availability"])

    def _payload(self, each: Mapping[str, str]) -> str:
        text = self.topics.get(each["topic"], "offline")
        if "value_template" not in each:
            return text
        return rendered(each["value_template"], text)

    async def read(self, name: str) -> Seen:
        about = self.entity(name)
        if about is None or about["state_topic"] not in self.topics:
            return NOTHING
        told = json.loads(self.topics[about["state_topic"]])
        state, value = rendered(about["value_template"], self.topics[about["state_topic"]]), told["value"]
        assert state == (
            {True: "OFF", False: "ON"}[value in QUIET] if about.get("device_class") == "problem" else str(value)
        )
        good = self.is_available(about) and told["quality"] == "good"
        grade = Grade.NONE if value is None else Grade.GOOD if good else Grade.DOUBTFUL
        time = datetime.fromisoformat(told["time"]).timestamp() if told["time"] else None
        unit, states = about.get("unit_of_measurement"), dict(enumerate(about.get("options", ())))
        return Seen(value, grade, time, unit, about.get("min"), about.get("max"), states)

    async def order(self, topic: str, path: str, text: str) -> None:
        """Publish, and wait for the answer; RefusedByFace."""
        waiting: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._orders[path].append(waiting)
        self.send({"topic": topic, "text": text})
        await asyncio.wait_for(waiting, 10.0)

    async def tune(self, path: str, value: Any) -> None:
        about = self.entity(f"tunable:{path}")
        topic = f"umo/{self.station}/set/{path.replace('.', '/')}" if about is None else about["command_topic"]
        await self.order(topic, path, str(value))

    async def write(self, path: str, value: Any) -> None:
        """An actuator is no number: a message is sent all the same."""
        assert "command_topic" not in (self.entity(path) or {})
        await self.order(f"umo/{self.station}/set/{path.replace('.', '/')}", path, str(value))

    async def call(self, path: str, arguments: Mapping[str, Any]) -> None:
        """As a script does by mqtt.publish."""
        await self.order(f"umo/{self.station}/press/{path.replace('.', '/')}", path, json.dumps(arguments))
