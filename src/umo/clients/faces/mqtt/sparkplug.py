"""Sparkplug B: the station as an edge node of an MQTT broker, with birth, data by alias, death, and stored values."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from umo.clients.faces.command_users import arguments_of, asked_of
from umo.clients.faces.face import Changes, Commands, Face, User
from umo.clients.faces.kept_tasks import KeptTasks
from umo.clients.faces.mqtt.broker import Broker, Message
from umo.clients.faces.mqtt.broker_address import BrokerAddress
from umo.clients.faces.mqtt.sparkplug_node import DONE, REBIRTH, REFUSAL, SparkplugNode
from umo.clients.faces.mqtt.sparkplug_payload import Payload, properties_of, value_of
from umo.errors import OptionError, UmoError
from umo.objects.presentation.identity import escaped, is_topic
from umo.operation.commands.verb import Names
from umo.operation.commands.verbs import CALL
from umo.process.frames.machine_items import Declaration
from umo.process.frames.run_reader import NumberedEvent

log = logging.getLogger("umo.faces")
STORE = 50_000
"""Default number of values that are kept while the broker or the primary host is away."""
CHUNK, CHUNKS = 500, 10
"""Number of stored values in one message, and of such messages per look."""
MAX_METRICS = 100
"""Largest number of metrics in one command message; further ones are refused."""
REBIRTH_PAUSE = 0.5
"""Shortest time in s between two requested births."""
NOBODY = "sparkplug"
"""The name for a user who gives no name."""


class Sparkplug(Face):
    """The edge node of the station. It opens one connection for each run.

    Options:
        host: the address of the broker. A broker on another computer needs `ca`.
        port: the TCP port of the broker.
        group: the group of the node.
        node: the name of the node; default: the name of the station.
        primary: the primary host. Nothing is sent until its STATE is online.
        store: number of values that are kept while the broker or the primary host is away.
        ca: file of the certificates (PEM) against which the broker's certificate is checked. With it TLS is used.
        certificate: file of the face's certificate and key (PEM).
        user: the name of the user at the broker.
        password_file: file whose first line is the password of `user`.
    """

    def __init__(
        self, port: int = 1883, host: str = "127.0.0.1", group: str = "umo", node: str = "", primary: str = "",
        store: int = STORE, ca: Path | None = None, certificate: Path | None = None, user: str = "",
        password_file: Path | None = None,
    ) -> None:  # fmt: skip
        for name, text in (("group", group), ("node", node), ("primary", primary)):
            if set(text) & set("+/#\0"):
                raise OptionError(f"{name} {text!r} contains +, / or #, which a topic cannot contain")
        if not 0 <= store <= 10_000_000:
            raise OptionError(f"store {store} is not from 0 to 10,000,000")
        self._broker = BrokerAddress(host, port, ca, certificate, user, password_file)
        self._group, self._name, self._primary = group or "umo", node, primary
        self._stored: deque[Any] = deque(maxlen=store)
        self.dropped = 0
        """Number of values dropped since the start because the store was full."""
        self._bd_seq = int(time.time()) % 256  # another than that of a process that was killed just before
        self._commands: Commands | None = None
        self._changes: Changes | None = None
        self._link: Broker | None = None
        self._tasks = KeptTasks()
        self._is_born = self._is_asked = False
        self._host_online, self._host_time = False, -1

    async def open(self) -> None:
        self._broker.context(), self._broker.password()
        self.address = f"{self._broker} {self._topic('NDATA', '+')}"

    async def begin(self, machine: Declaration, commands: Commands) -> None:
        self._commands, self._changes = commands, None
        self._stored.clear()  # of another run
        self._node = SparkplugNode(machine, self._bd_seq)
        self._edge = self._name or escaped(machine.station, is_topic)
        self._connect()

    async def frames(self, changes: Changes) -> None:
        self._changes = changes
        if self._link is not None and not self._link.is_up:
            self._is_born = False
        if self._is_born or not self._give_birth():
            self._send(self._node.data(changes))
        if self._is_born:
            self._send_stored()

    async def events(self, events: Sequence[NumberedEvent]) -> None:
        self._send(self._node.events(events))

    async def end(self, why: str) -> None:
        self._tasks.cancel()
        await self._disconnect()
        self._changes = self._commands = None

    # The connection ------------------------------------------------------------------------------------

    def _topic(self, kind: str, node: str = "") -> str:
        return f"spBv1.0/{self._group}/{kind}/{node or self._edge}"

    def _connect(self) -> None:
        state = [f"spBv1.0/STATE/{self._primary}"] if self._primary else []
        name, topics = f"umo-sparkplug-{self._group}/{self._edge}", [self._topic("NCMD"), *state]
        self._is_born = self._host_online = False
        self._link = Broker(self._broker, name, self._will, topics, self._came_up, self._hear, kept=state)
        self._link.start()

    async def _disconnect(self) -> None:
        link, self._link, self._is_born = self._link, None, False
        if link is not None:
            await link.stop(Message(self._topic("NDEATH"), self._node.death(), 1))

    def _will(self) -> Message:
        """Return the will for the next CONNECT. Each CONNECT has its own number
        (`tck-id-topics-nbirth-bdseq-increment`)."""
        self._bd_seq = self._node.bd_seq = (self._bd_seq + 1) % 256
        return Message(self._topic("NDEATH"), self._node.death(), 1)

    def _came_up(self) -> None:
        self._is_born = False
        self._give_birth()

    def _give_birth(self) -> bool:
        """Publish the birth, and return True if the broker accepts it. There is no birth without values, or while a
        configured primary host is offline."""
        if self._link is None or self._changes is None or (self._primary and not self._host_online):
            return False
        birth = self._node.birth(self._changes, self.dropped)
        self._is_born = self._link.send(self._topic("NBIRTH"), birth)
        return self._is_born

    def _send(self, payload: Any) -> None:
        """Send data. If that is not possible now, store the data."""
        if self._is_born and self._link is not None:
            if self._link.send(self._topic("NDATA"), self._node.numbered(payload)):
                return
            self._is_born = False  # a number is missing
        for metric in payload.metrics:
            metric.is_historical = True
            self.dropped += len(self._stored) == self._stored.maxlen
            self._stored.append(metric)

    def _send_stored(self) -> None:
        assert self._link is not None
        for _ in range(CHUNKS):
            if not self._stored:
                return
            chunk = [self._stored.popleft() for _ in range(min(CHUNK, len(self._stored)))]
            if not self._link.send(self._topic("NDATA"), self._node.numbered(self._node.historical(chunk))):
                self._stored.extendleft(reversed(chunk))
                self._is_born = False
                return

    # What is heard -------------------------------------------------------------------------------------

    def _hear(self, topic: str, payload: bytes) -> None:
        if topic.startswith("spBv1.0/STATE/"):
            self._hear_host(payload)
            return
        message = Payload()
        try:
            message.ParseFromString(payload)
        except DecodeError:
            log.warning("a message on %s is not a message of Sparkplug B", topic)
            return
        for metric in message.metrics[:MAX_METRICS]:
            self._hear_metric(metric)
        if (more := len(message.metrics) - MAX_METRICS) > 0:
            self._answer(REFUSAL, f"a message with {more} metrics is too long: it may have at most {MAX_METRICS}", {})

    def _hear_host(self, payload: bytes) -> None:
        """Take a STATE message of the primary host. If the host is online again, publish the birth. If it has gone
        offline, end the session; the next session waits for the host."""
        try:
            state = json.loads(payload)
            online, at = state["online"] is True, int(state["timestamp"])
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            log.warning("the STATE of %s is not a message of Sparkplug 3.0", self._primary)
            return
        if at < self._host_time:
            return
        self._host_time, was, self._host_online = at, self._host_online, online
        if online and not was:
            self._give_birth()
        elif was and not online:
            self._tasks.begin(self._restart())

    async def _restart(self) -> None:
        if self._link is None:  # it is on its way
            return
        await self._disconnect()
        if self._commands is not None:
            self._connect()

    def _hear_metric(self, metric: Any) -> None:
        name = self._node.name_of(metric)
        if name == REBIRTH:
            if not self._is_asked and value_of(metric) is True:
                self._is_asked = True
                asyncio.get_running_loop().call_later(REBIRTH_PAUSE, self._bear_again)
            return
        given = properties_of(metric)
        about = {key: str(given[key])[:100] for key in ("user", "request") if key in given} | {"metric": name[:200]}
        self._tasks.begin(self._carry_out(name, value_of(metric), about))

    def _bear_again(self) -> None:
        self._is_asked = False
        if self._is_born:
            self._give_birth()

    async def _carry_out(self, name: str, value: Any, about: dict[str, str]) -> None:
        try:
            result = await self._ask(name, value, User(about.get("user") or NOBODY, proved=False))
            self._answer(DONE, json.dumps(result), about)
        except UmoError as error:
            self._answer(REFUSAL, str(error), about)

    async def _ask(self, name: str, value: Any, user: User) -> Any:
        assert self._commands is not None
        if (action := self._node.actions.get(name)) is not None:
            return await self._commands.ask(user, CALL.name, str(action["path"]), arguments=arguments_of(value))
        if (verb := self._node.verbs.get(name)) is not None:
            path, more = asked_of(verb, value)
            return await self._commands.ask(user, verb.name, path, **more)
        item = self._node.by_metric.get(name)
        if item is None:
            raise OptionError(f"there is no metric {name[:200]!r}")
        if (setting := item.verb) is None:
            raise OptionError(f"{name} is read-only")
        path = "" if setting.names is Names.NOTHING else item.path
        return await self._commands.ask(user, setting.name, path, value=value)

    def _answer(self, name: str, text: str, about: dict[str, str]) -> None:
        self._send(self._node.one(name, text, about))
