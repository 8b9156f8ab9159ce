"""A connection to an MQTT broker, which is opened again after each loss. It has a will, a bounded queue, and callbacks
in the loop."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from umo.clients.faces.mqtt.broker_address import BrokerAddress, reason_of

log = logging.getLogger("umo.faces")
KEEPALIVE = 5
"""Longest time in s between two heartbeats of a client. After 1.5 times this time the broker declares the client
dead."""
CONNECT_TIMEOUT = 2.0
FIRST_PAUSE, MAX_PAUSE = 1, 8
"""First and longest time in s until the next attempt to connect. The time doubles after each failure."""
MAX_UNSENT = 4_000_000
"""Largest number of bytes that wait for the network; further messages are not accepted."""
MAX_MESSAGE = 65_536
"""Largest number of bytes of a message to the face; longer ones are dropped."""
MAX_HEARD = 256
"""Largest number of messages to the face that wait; further messages are dropped."""
LAST_MESSAGE_TIMEOUT = 1.0
"""Time in s within which the broker must have confirmed the last message."""


@dataclass(frozen=True)
class Message:
    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


class Broker:
    """One connection. It is opened again after each loss until `stop` is called.

    `will` is called before each CONNECT, unless the attempt fails earlier. `on_up` and `on_message` (topic, payload)
    are called in the loop. Retained messages are ignored unless their topic is in `kept`, because an old command must
    not be carried out."""

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
        """Number of messages to the face that were dropped, because they were too long or too many at once."""
        self._address, self._topics, self._kept, self._will = address, topics, kept, will
        self._on_up, self._on_message = on_up, on_message
        self._unsent: deque[tuple[paho.MQTTMessageInfo, int]] = deque()
        self._bytes = self._heard = 0
        self._is_stopped = self._is_refused = False
        self._told = ""
        self._loop = asyncio.get_running_loop()
        self._client = self._made(name)

    def _made(self, name: str) -> paho.Client:
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name, protocol=paho.MQTTv311)
        client.connect_timeout = CONNECT_TIMEOUT
        client.reconnect_delay_set(FIRST_PAUSE, MAX_PAUSE)
        client.on_socket_open, client.on_connect_fail = self._before, self._failed
        client.on_connect, client.on_disconnect, client.on_message = self._connected, self._lost, self._came
        if self._address.user:
            client.username_pw_set(self._address.user, self._address.password())
        if (context := self._address.context()) is not None:
            client.tls_set_context(context)
        return client

    def start(self) -> None:
        """Start connecting."""
        self._client.connect_async(self._address.host, self._address.port, KEEPALIVE)
        self._client.loop_start()

    def send(self, topic: str, payload: bytes, retain: bool = False) -> bool:
        """Send a message. Return False if there is no connection, or if too many bytes already wait."""
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
        """Send a last message and disconnect. If the broker does not confirm the message, the connection is aborted, so
        that the broker publishes the will."""
        self._is_stopped = True
        await asyncio.to_thread(self._stop, last)

    def _stop(self, last: Message) -> None:
        told = False
        if self.is_up:
            with suppress(ValueError, RuntimeError):
                info = self._client.publish(last.topic, last.payload, 1, last.retain)
                info.wait_for_publish(LAST_MESSAGE_TIMEOUT)
                told = info.is_published()
        if told:
            self._client.disconnect()
        elif (connection := self._client.socket()) is not None:
            connection.close()
        self._client.loop_stop()
        self.is_up = False
        client = self._client  # no cycle: its sockets are closed with it
        client.on_socket_open = client.on_connect_fail = client.on_connect = None
        client.on_disconnect = client.on_message = None

    # In the thread of the connection -------------------------------------------------------------------

    def _before(self, client: paho.Client, data: Any, connection: Any) -> None:
        """Set the will. Called when the broker has accepted the connection, immediately before CONNECT is sent."""
        will, self._is_refused = self._will(), False
        client.will_set(will.topic, will.payload, will.qos, will.retain)

    def _failed(self, client: paho.Client, data: Any) -> None:
        self._tell(f"cannot be reached: {reason_of(sys.exception())}")

    def _connected(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        self._is_refused = reason.is_failure
        if reason.is_failure:
            user = self._address.user
            self._tell(f"refuses the user {user}: {reason}" if user else f"refuses clients without a user: {reason}")
            return
        self._told = ""
        if self._topics:
            client.subscribe([(topic, 1) for topic in self._topics])
        self._loop.call_soon_threadsafe(self._up)

    def _lost(self, client: paho.Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure and not self._is_refused:
            self._tell(
                "has gone" if self.is_up else "ends the connection immediately: `ca` or `certificate` may be missing"
            )
        self.is_up = False

    def _tell(self, what: str) -> None:
        """Log a failure once, however often connecting is tried again."""
        if what != self._told:
            self._told = what
            log.warning("%s %s; umo tries again", self._address, what)

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
        if self._is_stopped:
            return
        self._unsent.clear()
        self._bytes, self.is_up = 0, True
        self._on_up()

    def _hear(self, topic: str, payload: bytes) -> None:
        self._heard -= 1
        if not self._is_stopped:
            self._on_message(topic, payload)
