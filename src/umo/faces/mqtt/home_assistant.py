"""Home Assistant: the station as a device that its MQTT integration discovers, with values on plain JSON topics."""

from __future__ import annotations

import asyncio
import json
import re
import zlib
from collections import deque
from collections.abc import Mapping
from datetime import UTC, datetime
from math import isfinite, isnan
from pathlib import Path
from typing import Any

from umo.errors import OptionError, UmoError
from umo.faces.face import Changes, Commands, Face, User
from umo.faces.face_declaration import Declaration, FaceItem, ItemKind
from umo.faces.mqtt.broker import Broker, BrokerAddress, Message
from umo.objects import Quality

USER = "homeassistant"
"""The name of the user of every command: the protocol tells none."""
ONLINE, OFFLINE = b"online", b"offline"
PRESS = b"PRESS"
STEP = 0.001
"""Smallest step of a number that Home Assistant can set."""
STATUS = -1
"""In place of an item: after the first value of each the device is online."""
DEFAULT_LIMITS = -1e9, 1e9
FRESH = "{{ 'online' if value_json.quality in ['good', 'out of range', 'unreferenced'] else 'offline' }}"


class HomeAssistant(Face):
    """Discovery as retained JSON below `prefix`, values and availability below `topic`.

    Options:
        host: of the broker; one on another computer needs `ca`, and gets no commands.
        port: of the broker.
        prefix: of discovery, as Home Assistant is set up.
        topic: below which the station's own topics are.
        ca: file of the certificates that the broker's is checked with (PEM): TLS.
        certificate: file of the own certificate and key (PEM).
        user: for the broker.
        password_file: its first line is the password of `user`.
    """

    def __init__(
        self, port: int = 1883, host: str = "127.0.0.1", prefix: str = "homeassistant", topic: str = "umo",
        ca: Path | None = None, certificate: Path | None = None, user: str = "", password_file: Path | None = None,
    ) -> None:  # fmt: skip
        for name, text in (("prefix", prefix), ("topic", topic)):
            if not text or set(text) & set("+#\0"):
                raise OptionError(f"{name} {text!r} is empty or has one of + #, which topics cannot have")
        self._broker = BrokerAddress(host, port, ca, certificate, user, password_file)
        self._prefix, self._topic = prefix, topic
        self._machine: Declaration | None = None
        self._commands: Commands | None = None
        self._changes: Changes | None = None
        self._link: Broker | None = None
        self._due: deque[tuple[str, bytes]] = deque()
        """Topics of discovery that the broker has not got, with what they say."""
        self._missed: dict[int, None] = {}
        """Items whose last value the broker has not got, the longest waiting first."""
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self) -> None:
        self._broker.context(), self._broker.password()
        self.address = f"{self._broker} {self._prefix}/#"

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self._machine, self._commands, self._changes = machine, commands, None
        self._base = f"{self._topic}/{plain(machine.station)}"
        self._missed = {}
        orders = [f"{self._base}/set/#", f"{self._base}/press/#"]
        name = f"umo-ha-{plain(machine.station)}"
        self._link = Broker(self._broker, name, self._last, orders, self._came_up, self._hear)
        self._link.start()

    async def frames(self, changes: Changes) -> None:
        self._changes = changes
        self._missed |= dict.fromkeys(changes.places.tolist())
        self._send_values()

    async def end(self, why: str) -> None:
        for task in self._tasks:
            task.cancel()
        link, self._link, self._commands = self._link, None, None
        if link is not None:
            await link.stop(self._last())

    def _last(self) -> Message:
        return Message(f"{self._base}/status", OFFLINE, 1, retain=True)

    def _came_up(self) -> None:
        """Everything is told again: the broker may have lost it."""
        assert self._machine is not None
        self._missed = dict.fromkeys([*range(len(self._machine.items)), STATUS])
        found = discovery(self._machine, self._base, self._prefix)
        self._due = deque((topic, json.dumps(config).encode()) for topic, config in found.items())
        self._due.append((f"{self._base}/declaration", mark_of(self._machine).encode()))
        self._send_values()

    def _send_values(self) -> None:
        """What the broker has not got: discovery, the last value of each item, then that they count. What it does not
        take now follows with the next look."""
        link, machine, changes = self._link, self._machine, self._changes
        if machine is None or changes is None or link is None or not link.is_up:
            return
        while self._due:
            if not link.send(*self._due[0], retain=True):
                return
            self._due.popleft()
        for place in list(self._missed):
            topic, payload = f"{self._base}/status", ONLINE
            if place != STATUS:
                item = machine.items[place]
                topic, payload = value_topic(self._base, item.name), told(item, changes)
            if not link.send(topic, payload, retain=True):
                return
            del self._missed[place]

    # Commands ------------------------------------------------------------------------------------------

    def _hear(self, topic: str, payload: bytes) -> None:
        if self._commands is None:  # the run has just ended
            return
        task = asyncio.get_running_loop().create_task(self._carry_out(topic.removeprefix(f"{self._base}/"), payload))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry_out(self, order: str, payload: bytes) -> None:
        assert self._commands is not None
        do, _, path = order.partition("/")
        path, user = path.replace("/", "."), User(USER, proved=False, is_remote=self._broker.is_remote)
        try:
            if do == "press":
                await self._commands.ask(user, "call", path, arguments={})
            else:
                await self._commands.ask(user, "tune", path, value=number_of(payload))
        except UmoError as error:
            self._tell(f"{path}: {error}")

    def _tell(self, text: str) -> None:
        if self._link is not None:
            refusal = {"text": text[:255], "time": text_of_time(datetime.now(UTC).timestamp())}
            self._link.send(f"{self._base}/refusal", json.dumps(refusal).encode())


def plain(name: str) -> str:
    """A name as Home Assistant takes it in topics and identifiers."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def value_topic(base: str, name: str) -> str:
    return f"{base}/value/{re.sub('[+#]', '_', name).replace('.', '/')}"


def number_of(payload: bytes) -> float:
    try:
        return float(payload[:100])
    except ValueError:
        raise OptionError(f"{payload[:40].decode(errors='replace')!r} is not a number") from None


def text_of_time(utc: float) -> str | None:
    return None if isnan(utc) else datetime.fromtimestamp(utc, UTC).isoformat(timespec="milliseconds")


def told(item: FaceItem, changes: Changes) -> bytes:
    """Value, quality and time of an item as JSON."""
    value, quality = float(changes.values[item.number]), changes.quality_of(item.number)
    shown: Any = None
    if not isnan(value) and quality is not Quality.BAD:
        shown = item.states.get(int(value), f"{value:g}") if item.states else value if abs(value) < 1e300 else None
    time = text_of_time(float(changes.times[item.number]))
    return json.dumps({"value": shown, "quality": str(quality).lower(), "time": time}).encode()


def discovery(machine: Declaration, base: str, prefix: str) -> Mapping[str, Mapping[str, Any]]:
    """The configuration of each entity by its topic."""
    station = plain(machine.station)
    found: dict[str, dict[str, Any]] = {}
    mark = mark_of(machine)

    def add(component: str, name: str, about: dict[str, Any]) -> None:
        while (topic := f"{prefix}/{component}/umo_{station}/{plain(name)}/config") in found:  # a.b_c and a_b.c
            name += "_"
        found[topic] = _common(station, base, name, mark) | about
        if "json_attributes_topic" in about:
            found[topic]["availability"].append({"topic": about["state_topic"], "value_template": FRESH})

    for item in machine.items:
        component, more = _component(item, base)
        add(component, item.name, _value(base, item) | more)
    for each in machine.actions:
        if not each.get("arguments") and not each.get("dead_man"):
            path = str(each["path"])
            press = {"command_topic": f"{base}/press/{path.replace('.', '/')}", "payload_press": PRESS.decode()}
            add("button", f"action:{path}", press)
    add("sensor", "refusal", {"state_topic": f"{base}/refusal", "value_template": "{{ value_json.text }}"})
    return found


def mark_of(machine: Declaration) -> str:
    """Tells declarations apart: what the broker keeps of another one counts no longer."""
    return f"{zlib.crc32(repr((machine.items, machine.actions)).encode()):08x}"


def _common(station: str, base: str, name: str, mark: str) -> dict[str, Any]:
    is_declared = f"{{{{ 'online' if value == '{mark}' else 'offline' }}}}"
    return {
        "name": name,
        "unique_id": f"umo_{station}_{plain(name)}",
        "device": {"identifiers": [f"umo_{station}"], "name": station, "manufacturer": "umo"},
        "availability": [
            {"topic": f"{base}/status"},
            {"topic": f"{base}/declaration", "value_template": is_declared},
        ],
        "availability_mode": "all",
    }


def _value(base: str, item: FaceItem) -> dict[str, Any]:
    topic = value_topic(base, item.name)
    return {"state_topic": topic, "value_template": "{{ value_json.value }}", "json_attributes_topic": topic}


def _component(item: FaceItem, base: str) -> tuple[str, dict[str, Any]]:
    """Which entity an item is, and what only that has."""
    unit = {"unit_of_measurement": item.look} if item.look else {}
    if item.kind is ItemKind.TUNABLE and not item.states:
        limits = zip((item.minimum, item.maximum), DEFAULT_LIMITS, strict=True)
        low, high = (other if limit is None or not isfinite(limit) else limit for limit, other in limits)
        order = f"{base}/set/{item.path.replace('.', '/')}"
        return "number", unit | {"command_topic": order, "min": low, "max": high, "step": STEP, "mode": "box"}
    if item.kind is ItemKind.SENSOR and set(item.states) == {0, 1}:
        return "binary_sensor", {"payload_off": item.states[0], "payload_on": item.states[1]}
    if item.states:
        return "sensor", {"device_class": "enum", "options": list(dict.fromkeys(item.states.values()))}
    return "sensor", unit | {"state_class": "measurement"}
