"""Publishes the data of a gateway to a JetStream in a separate thread. The data come from the deltas that the gateway
keeps.

There is no second queue. For each run the publisher knows the last confirmed number. It takes later data from the
deltas that the gateway keeps for clients that have missed some. A server that is away or slow delays nothing else. Data
that the gateway no longer keeps when the server is back are counted and reported."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Sequence
from math import inf

from nats.aio.client import Client
from nats.js import JetStreamContext

from umo.clients.fleet.jetstream_cursor import JetStreamCursor, OutgoingMessage
from umo.clients.fleet.jetstream_server import JetStreamServer
from umo.clients.fleet.station_publisher import StationPublisher

PAUSE = 0.1
"""Time in s between two looks for new data."""
ACK_TIME = 5.0
"""Time in s within which the server must confirm a message."""
AT_A_TIME = 1000
"""Number of unconfirmed messages at which no further station is served."""
CLOSE_TIME = 3.0
"""Time in s for sending the remaining data when the gateway ends."""
MOST_ENDED = 20
"""Largest number of ended runs with data that are still to be sent."""
HEADERS = 200
"""Largest number of bytes of a message in addition to its payload."""


class JetStreamPublisher:
    """The publisher of a gateway. `say` is called with notices for the user."""

    def __init__(self, server: JetStreamServer, say: Callable[[str], object]) -> None:
        self._server, self._say = server, say
        self._cursors: list[JetStreamCursor] = []
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._too_large: set[str] = set()
        self._first = 0
        self._thread = threading.Thread(target=self._serve, name="umo fleet jetstream", daemon=True)
        self._thread.start()

    # By the gateway: none of these waits --------------------------------------------------------------------

    def begin(self, publisher: StationPublisher) -> None:
        """Publish a run from now on."""
        with self._lock:
            self._cursors.append(JetStreamCursor(publisher))

    def end(self, publisher: StationPublisher) -> None:
        """Record the end of a run. Its remaining data are sent as soon as possible."""
        with self._lock:
            for each in self._cursors:
                if each.publisher is publisher:
                    each.end()

    def close(self) -> None:
        """Send as much as possible within `CLOSE_TIME`. Called when the gateway ends."""
        self._stop.set()
        self._thread.join(2 * CLOSE_TIME)

    # By the thread ------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        asyncio.run(self._server.keep_using(self._publish, self._stop, self._say))

    async def _publish(self, client: Client, js: JetStreamContext) -> None:
        """Send new data until the gateway ends. Raises the error that ends the connection."""
        until = inf
        while time.monotonic() < until:
            began = time.monotonic()
            is_over = self._stop.is_set()
            if is_over and until == inf:
                until = began + CLOSE_TIME
            count = await self._send(client, js, began)
            self._tell_lost()
            self._forget()
            if count == 0:
                if is_over:
                    return
                await asyncio.sleep(max(0.0, began + PAUSE - time.monotonic()))

    async def _send(self, client: Client, js: JetStreamContext, now: float) -> int:
        """Send new data of some stations, and wait until the server has them. Return the number of messages."""
        with self._lock:
            cursors = list(self._cursors)
        order = cursors[self._first :] + cursors[: self._first]
        sent: list[tuple[JetStreamCursor, OutgoingMessage, asyncio.Future[object] | None]] = []
        for cursor in order:
            if len(sent) >= AT_A_TIME:  # the others have their turn first the next time
                self._first = cursors.index(cursor)
                break
            for message in cursor.messages(now):
                if len(message.data) + HEADERS > client.max_payload:
                    self._tell_too_large(cursor, message)
                    sent.append((cursor, message, None))
                else:
                    future = await js.publish_async(message.subject, message.data, headers=message.headers)
                    sent.append((cursor, message, future))  # type: ignore[arg-type]
        else:
            self._first = 0
        waiting = [future for _, _, future in sent if future is not None]
        if waiting:
            _, late = await asyncio.wait(waiting, timeout=ACK_TIME)
            for each in late:
                each.cancel()
        self._confirm(sent)
        return len(sent)

    @staticmethod
    def _confirm(
        sent: Sequence[tuple[JetStreamCursor, OutgoingMessage, asyncio.Future[object] | None]],
    ) -> None:
        """Record which messages the server has confirmed. Raises the error of the first message that it has not
        confirmed."""
        failed: dict[int, BaseException] = {}
        for cursor, message, future in sent:
            if id(cursor) in failed:
                if future is not None and not future.cancelled():
                    future.exception()  # it is known
            elif future is None:
                cursor.skip(message)
            elif future.cancelled():
                failed[id(cursor)] = TimeoutError()
            elif (error := future.exception()) is not None:
                failed[id(cursor)] = error
            else:
                cursor.confirm(message)
        if failed:
            raise next(iter(failed.values()))

    def _tell_too_large(self, cursor: JetStreamCursor, message: OutgoingMessage) -> None:
        if message.subject not in self._too_large:
            self._too_large.add(message.subject)
            self._say(f"{cursor.key}: a message of {len(message.data):,} bytes is more than the JetStream accepts "
                      "(max_payload of the server)")  # fmt: skip

    def _tell_lost(self) -> None:
        with self._lock:
            lost = [(each.key, *each.take_lost()) for each in self._cursors]
        for key, deltas, events in lost:
            if deltas or events:
                self._say(f"{key}: {deltas} deltas and {events} events were not stored in the JetStream, "
                          "and are no longer kept")  # fmt: skip

    def _forget(self) -> None:
        """Forget the runs that are over and whose data were all sent. If more than `MOST_ENDED` other runs are over,
        give up the oldest of them."""
        with self._lock:
            self._cursors = [each for each in self._cursors if not each.is_done]
            ended = [each for each in self._cursors if each.has_ended]
            given_up = ended[:-MOST_ENDED]
            self._cursors = [each for each in self._cursors if each not in given_up]
        for each in given_up:
            self._say(f"{each.key}: the last data of an ended run were not stored in the JetStream")
