"""A connection to an MQTT broker, which comes and goes: with a will, a bounded queue, and callbacks in the loop."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from umo.errors import OptionError, UmoError
from umo.faces.endpoint import is_local

log = logging.getLogger("umo.faces")
KEEPALIVE = 5
"""Time in s without a sign of life; the broker declares a client dead after one and a half of it."""
CONNECT_TIMEOUT = 2.0
FIRST_PAUSE, MAX_PAUSE = 1, 8
"""Time in s to the next try to connect: it doubles."""
MAX_UNSENT = 4_000_000
"""Bytes that wait for the network at most; what comes beyond is not taken."""
MAX_MESSAGE = 65_536
"""Bytes of a message to the face at most; longer ones are dropped."""
MAX_HEARD = 256
"""Messages to the face that wait at most; what comes beyond is dropped."""
LAST_WORD = 1.0
"""Time in s within which the broker must have confirmed the last message."""


@dataclass(frozen=True)
class BrokerAddress:
    """`ca`: file of the certificates that the broker's is checked with (PEM): TLS. `certificate`: file of the own
    certificate and key (PEM). `password_file`: its first line is the password of `user`. OptionError for a broker on
    another computer without `ca`."""

    host: str
    port: int
    ca: Path | None = None
    certificate: Path | None = None
    user: str = ""
    password_file: Path | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.port <= 65535:
            raise OptionError(f"port {self.port} is not from 1 to 65535")
        if not is_local(self.host) and self.ca is None:
            raise OptionError(
                f"{self.host} is another computer: give `ca` (certificates that the broker's is checked with), "
                "or leave `host` out: 127.0.0.1"
            )
        if self.certificate is not None and self.ca is None:
            raise OptionError("`certificate` needs `ca` (certificates that the broker's is checked with)")
        if bool(self.user) != (self.password_file is not None):
            raise OptionError("`user` and `password_file` belong together")

    @property
    def is_remote(self) -> bool:
        return not is_local(self.host)

    def context(self) -> ssl.SSLContext | None:
        """For TLS; None without `ca`. UmoError if the files are none."""
        if self.ca is None:
            return None
        try:
            context = ssl.create_default_context(cafile=self.ca)
            if self.certificate is not None:
                context.load_cert_chain(self.certificate)
        except (OSError, ssl.SSLError) as error:
            raise UmoError(f"{self.ca}, {self.certificate}: no certificates ({error})") from None
        return context

    def password(self) -> str | None:
        """The first line of the file; UmoError if it cannot be read."""
        if self.password_file is None:
            return None
        try:
            lines = self.password_file.read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError) as error:
            raise UmoError(f"{self.password_file}: no password ({error})") from None
        if not lines or not lines[0]:
            raise UmoError(f"{self.password_file}: its first line is no password")
        return lines[0]

    def __str__(self) -> str:
        return f"mqtt{'s' if self.ca else ''}://{self.host}:{self.port}"


@dataclass(frozen=True)
class Message:
    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


class Broker:
    """One connection, which is tried again until `stop`.

    `will` is asked before each connecting. `on_up` and `on_message` (topic, payload) are called in the loop;
    retained messages are not heard, unless their topic is in `kept`: a command of yesterday is none.
    """

    def __init__(
        self,
        address: BrokerAddress,
        name: str,
        will: Callable[[], Message],
        topics: Sequence[str],
        on_up: Callable[[], object],
        on_message: Callable[[str, bytes], object],
        kept: Sequence[str] = (),
    ) -> None:
        self.is_up = False
        self.dropped = 0
        """Messages to the face that were dropped: too long, or too many at once."""
        self._address, self._topics, self._kept, self._will = address, topics, kept, will
        self._on_up, self._on_message = on_up, on_message
        self._unsent: deque[tuple[paho.MQTTMessageInfo, int]] = deque()
        self._bytes = self._heard = 0
        self._is_missed = False
        """Whether it has been told that no broker is there."""
        self._loop = asyncio.get_running_loop()
        self._client = self._made(name)

    def _made(self, name: str) -> paho.Client:
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name, protocol=paho.MQTTv311)
        client.connect_timeout = CONNECT_TIMEOUT
        client.reconnect_delay_set(FIRST_PAUSE, MAX_PAUSE)
        client.on_pre_connect, client.on_connect_fail = self._before, self._not_there
        client.on_connect, client.on_disconnect, client.on_message = self._connected, self._lost, self._came
        if self._address.user:
            client.username_pw_set(self._address.user, self._address.password())
        if (context := self._address.context()) is not None:
            client.tls_set_context(context)
        return client

    def start(self) -> None:
        """Begin to connect."""
        self._client.connect_async(self._address.host, self._address.port, KEEPALIVE)
        self._client.loop_start()

    def send(self, topic: str, payload: bytes, retain: bool = False) -> bool:
        """Whether the message was taken: not without a connection, or while too much waits."""
        while self._unsent and self._unsent[0][0].is_published():
            self._bytes -= self._unsent.popleft()[1]
        if not self.is_up or self._bytes + len(payload) > MAX_UNSENT:
            return False
        info = self._client.publish(topic, payload, 0, retain)
        if info.rc != paho.MQTT_ERR_SUCCESS:
            return False
        self._unsent.append((info, len(payload)))
        self._bytes += len(payload)
        return True

    async def stop(self, last: Message) -> None:
        """End with a last message. If the broker does not confirm it, the connection breaks, and the will tells."""
        await asyncio.to_thread(self._stop, last)

    def _stop(self, last: Message) -> None:
        told = False
        if self.is_up:
            with suppress(ValueError, RuntimeError):
                info = self._client.publish(last.topic, last.payload, 1, last.retain)
                info.wait_for_publish(LAST_WORD)
                told = info.is_published()
        if told:
            self._client.disconnect()
        elif (connection := self._client.socket()) is not None:
            connection.close()
        self._client.loop_stop()
        self.is_up = False

    # In the thread of the connection -------------------------------------------------------------------

    def _before(self, client: paho.Client, data: Any) -> None:
        will = self._will()
        client.will_set(will.topic, will.payload, will.qos, will.retain)

    def _not_there(self, client: paho.Client, data: Any) -> None:
        if not self._is_missed:
            log.warning("no broker at %s; it is tried again", self._address)
        self._is_missed = True

    def _connected(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            log.warning("%s refuses the connection: %s", self._address, reason)
            return
        self._is_missed = False
        if self._topics:
            client.subscribe([(topic, 1) for topic in self._topics])
        self._loop.call_soon_threadsafe(self._up)

    def _lost(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if self.is_up and reason.is_failure:
            log.warning("%s has gone: %s; it is tried again", self._address, reason)
        self.is_up = False

    def _came(self, client: paho.Client, data: Any, message: paho.MQTTMessage) -> None:
        if message.retain and message.topic not in self._kept:
            return
        if len(message.payload) > MAX_MESSAGE or self._heard >= MAX_HEARD:
            self.dropped += 1
            return
        self._heard += 1
        self._loop.call_soon_threadsafe(self._hear, message.topic, bytes(message.payload))

    # In the loop ---------------------------------------------------------------------------------------

    def _up(self) -> None:
        self._unsent.clear()
        self._bytes, self.is_up = 0, True
        self._on_up()

    def _hear(self, topic: str, payload: bytes) -> None:
        self._heard -= 1
        self._on_message(topic, payload)
