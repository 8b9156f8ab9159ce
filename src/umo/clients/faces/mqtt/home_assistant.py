"""Home Assistant: the station as a device that its MQTT integration discovers, with values on plain JSON topics."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from umo.clients.faces.command_users import arguments_of, asked_of
from umo.clients.faces.face import Changes, Commands, Face, User
from umo.clients.faces.face_image import NO_QUALITY
from umo.clients.faces.kept_tasks import KeptTasks
from umo.clients.faces.mqtt.broker import Broker, Message
from umo.clients.faces.mqtt.broker_address import BrokerAddress
from umo.clients.faces.mqtt.home_assistant_discovery import (
    PRESS,
    TOPICS,
    device_of,
    discovery,
    former_topics,
    mark_of,
    text_of_time,
    told,
    value_topic,
)
from umo.errors import OptionError, UmoError
from umo.operation.commands.verbs import CALL, TUNE, VERBS, verb_of
from umo.process.frames.machine_items import Declaration, MachineItem
from umo.text import did_you_mean

USER = "homeassistant"
"""The user's name for every command, because the protocol transmits none."""
ONLINE, OFFLINE = b"online", b"offline"
INTERVAL = 1.0
FASTEST, SLOWEST = 0.1, 3600.0
"""Shortest and longest time in s from one message of a number to the next."""


class HomeAssistant(Face):
    """The face: it publishes discovery as retained JSON below `prefix`, and values and availability below `topic`.

    Options:
        host: the address of the broker. A broker on another computer needs `ca`.
        port: the TCP port of the broker.
        prefix: the discovery prefix in Home Assistant's configuration.
        topic: the topic below which the station's topics are.
        interval: time in s from one message of a number to the next, 0.1 to 3600. States and qualities are
            sent immediately.
        ca: file of the certificates (PEM) against which the broker's certificate is checked. With it TLS is used.
        certificate: file of the face's certificate and key (PEM).
        user: the name of the user at the broker.
        password_file: file whose first line is the password of `user`.
    """

    def __init__(
        self, port: int = 1883, host: str = "127.0.0.1", prefix: str = "homeassistant", topic: str = "umo",
        interval: float = INTERVAL, ca: Path | None = None, certificate: Path | None = None, user: str = "",
        password_file: Path | None = None,
    ) -> None:  # fmt: skip
        for name, text in (("prefix", prefix), ("topic", topic)):
            if not text or set(text) & set("+#\0"):
                raise OptionError(f"{name} {text!r} is empty or contains + or #, which a topic cannot contain")
        if not FASTEST <= interval <= SLOWEST:
            raise OptionError(f"interval {interval} is not from {FASTEST:g} to {SLOWEST:g} s")
        self._broker = BrokerAddress(host, port, ca, certificate, user, password_file)
        self._prefix, self._topic, self._interval = prefix, topic, interval
        self._machine: Declaration | None = None
        self._commands: Commands | None = None
        self._changes: Changes | None = None
        self._link: Broker | None = None
        self._missed: dict[str, bytes | MachineItem] = {}
        """The messages that the broker has not received, by topic, the longest waiting first. An item stands for the
        message with its last value."""
        self._is_behind = False
        """True if all missed messages must be sent in their order, as after connecting."""
        self._tasks = KeptTasks()

    async def open(self) -> None:
        self._broker.context(), self._broker.password()
        self.address = f"{self._broker} {self._prefix}/#"

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self._machine, self._commands, self._changes = machine, commands, None
        self._base = f"{self._topic}/{TOPICS.part(machine.station)}"
        self._topics = [value_topic(self._base, item) for item in machine.items]
        self._missed, self._is_behind = {}, False
        self._has_states = np.array([bool(item.states) for item in machine.items])
        self._qualities = np.full(len(machine.items), NO_QUALITY, np.uint8)
        orders = [f"{self._base}/{kind}/#" for kind in ("set", "press", "do")]
        self._link = Broker(
            self._broker, f"{device_of(machine.station)}-ha", self._last, orders, self._came_up, self._hear
        )
        self._link.start()
        self._tasks.begin(self._tell_numbers())

    async def frames(self, changes: Changes) -> None:
        self._changes, places = changes, changes.places
        self._miss(places.tolist())
        at_once = self._has_states[places] | (changes.quality[places] != self._qualities[places])
        self._qualities = changes.quality
        self._send(self._topics[place] for place in places[at_once].tolist())

    async def end(self, why: str) -> None:
        self._tasks.cancel()
        link, self._link, self._commands = self._link, None, None
        if link is not None:
            await link.stop(self._last())

    async def _tell_numbers(self) -> None:
        while True:
            await asyncio.sleep(self._interval)
            self._send(self._missed)

    def _last(self) -> Message:
        return Message(f"{self._base}/status", OFFLINE, 1, retain=True)

    def _came_up(self) -> None:
        """Publish everything again, as the broker may have lost it: discovery, values, then availability."""
        assert self._machine is not None
        found = discovery(self._machine, self._base, self._prefix)
        self._missed = dict.fromkeys(former_topics(self._machine, self._prefix), b"")
        self._missed |= {topic: json.dumps(config).encode() for topic, config in found.items()}
        self._missed[f"{self._base}/declaration"] = mark_of(self._machine).encode()
        self._miss(range(len(self._topics)))
        self._missed[f"{self._base}/status"] = ONLINE
        self._is_behind = True
        self._send(())

    def _miss(self, places: Iterable[int]) -> None:
        assert self._machine is not None
        self._missed |= {self._topics[place]: self._machine.items[place] for place in places}

    def _send(self, topics: Iterable[str]) -> None:
        """Send the missing messages of these topics. Those that the broker does not accept now follow with the next
        look."""
        if self._link is None or self._changes is None:
            return
        for topic in list(self._missed if self._is_behind else dict.fromkeys(topics)):
            what = self._missed[topic]
            payload = what if isinstance(what, bytes) else told(what, self._changes)
            if not self._link.send(topic, payload, retain=True):
                self._is_behind = True
                return
            del self._missed[topic]
        self._is_behind = False

    # Commands ------------------------------------------------------------------------------------------

    def _hear(self, topic: str, payload: bytes) -> None:
        self._tasks.begin(self._carry_out(topic.removeprefix(f"{self._base}/"), payload))

    async def _carry_out(self, order: str, payload: bytes) -> None:
        assert self._commands is not None
        kind, _, path = order.partition("/")
        path, user = TOPICS.path(path), User(USER, proved=False)
        try:
            if kind == "press":
                arguments = {} if payload == PRESS else arguments_of(payload)
                result = await self._commands.ask(user, CALL.name, path, arguments=arguments)
            elif kind == "set":
                result = await self._commands.ask(user, TUNE.name, path, value=number_of(payload))
            else:
                verb = verb_of(path)
                if verb is None:
                    raise OptionError(f"there is no command {path[:100]!r}{did_you_mean(path, VERBS)}")
                path, more = asked_of(verb, payload)
                result = await self._commands.ask(user, verb.name, path, **more)
            self._answer("done", path, f"{path}: {json.dumps(result)}")
        except UmoError as error:
            self._answer("refusal", path, f"{path}: {error}")

    def _answer(self, topic: str, path: str, text: str) -> None:
        """Publish the answer to a command, after the values that the command has changed."""
        if self._link is not None:
            self._send(self._missed)
            answer = {"path": path[:255], "text": text[:255], "time": text_of_time(datetime.now(UTC).timestamp())}
            self._link.send(f"{self._base}/{topic}", json.dumps(answer).encode())


def number_of(payload: bytes) -> float:
    try:
        return float(payload[:100])
    except ValueError:
        raise OptionError(f"{payload[:40].decode(errors='replace')!r} is not a number") from None
