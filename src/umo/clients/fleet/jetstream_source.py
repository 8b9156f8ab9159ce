"""The source of a recorder that reads from a JetStream: a durable consumer, to which the recorder confirms the data
that are in files.

After a restart or a new connection the recorder creates its consumer anew, beginning after the written data. Data that
were being sent then arrive again, in their order. The server alone would also send them again, but after later data.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path

import nats
from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.js import JetStreamContext
from nats.js.api import AckPolicy, ConsumerConfig, DeliverPolicy
from nats.js.errors import NotFoundError

from umo.clients.fleet import fleet_keys as keys
from umo.clients.fleet.fleet_keys import StationKey
from umo.clients.fleet.fleet_record_files import RecordFolder
from umo.clients.fleet.fleet_record_source import Put, StreamPlace
from umo.clients.fleet.jetstream_server import (
    DECLARATIONS,
    FIRST,
    STREAM,
    JetStreamServer,
    key_and_kind,
    matcher,
    subject,
)
from umo.clients.fleet.run_feed import RunFeed

BATCH = 500
"""Number of messages requested at a time."""
WAIT = 0.5
"""Time in s to wait for messages."""
ROOM_WAIT = 0.1
"""Time in s between two checks whether there is room."""
CONSUMER_FILE = ".jetstream"
"""The file in the folder of the history with the name of its consumer."""
UNUSED = 90 * 86400.0
"""Time in s after which the server forgets a consumer that nobody uses."""
SILENT = 20
"""Number of requests without a message after which the recorder checks that its consumer still exists."""
HOUR = 3600.0


class JetStreamSource:
    """A JetStream as a source. `patterns`: names SITE/STATION, in which `*` stands for any characters. `say` is called
    with notices for the user."""

    idle = 600.0

    def __init__(
        self, server: JetStreamServer, folder: RecordFolder, patterns: Sequence[str], say: Callable[[str], object]
    ) -> None:
        self._server, self._folder, self._say = server, folder, say
        self._is_wanted = matcher(patterns)
        self._filter = _filter(patterns)
        self.consumer = f"{_name(folder.root)}-{blake2b(self._filter.encode(), digest_size=4).hexdigest()}"
        self._stop, self._is_closing = threading.Event(), threading.Event()
        self._time = 0.0
        self._wanted: deque[tuple[StationKey, bytes]] = deque()
        self._written = 0
        self._taken = 0
        """`_written`: place of the last message up to which all messages are in files. `_taken`: place of the last
        message that was delivered."""
        self._replies: deque[tuple[int, str]] = deque()
        """The place of each unconfirmed message, and the subject to which its confirmation is sent."""

    # By the recorder ------------------------------------------------------------------------------------------

    def begin(self, put: Put, has_room: Callable[[], bool]) -> None:
        self._put, self._has_room = put, has_room
        self._thread = threading.Thread(target=self._serve, name="umo fleet jetstream", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop reading. The caller calls `close` afterwards."""
        self._stop.set()

    def close(self) -> None:
        """End the connection, after the last confirmation."""
        self._stop.set()
        self._is_closing.set()
        self._thread.join()

    def now(self) -> float:
        """Return the time of the last message, so that no time passes while the server is unreachable."""
        return self._time

    def ask_past(self, key: StationKey, feed: RunFeed, now: float) -> bool:
        return False  # the stream has what there is

    def ask_declaration(self, key: StationKey, run: bytes) -> None:
        self._wanted.append((key, run))

    def written(self, sequence: int) -> None:
        self._written = max(self._written, sequence)

    # By the thread --------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        asyncio.run(self._server.keep_using(self._read, self._is_closing, self._say, self._make_consumer))

    async def _make_consumer(self, js: JetStreamContext) -> None:
        """Create the consumer anew, so that it begins after the written data."""
        stream = await js.stream_info(STREAM)
        with suppress(NotFoundError):
            known = await js.consumer_info(STREAM, self.consumer)
            if known.ack_floor is not None:
                self._written = max(self._written, known.ack_floor.stream_seq)
            await js.delete_consumer(STREAM, self.consumer)
        if stream.state.last_seq < self._written:  # another stream
            self._written = self._taken = 0
        if self._written == 0:  # the files alone know what is written
            self._folder.looked_at = int((stream.config.max_age or UNUSED) / HOUR) + 2
        self._replies.clear()
        config = ConsumerConfig(
            durable_name=self.consumer, filter_subject=self._filter, ack_policy=AckPolicy.ALL, max_ack_pending=-1,
            ack_wait=UNUSED, inactive_threshold=UNUSED, deliver_policy=DeliverPolicy.BY_START_SEQUENCE,
            opt_start_seq=self._written + 1,
        )  # fmt: skip
        await js.add_consumer(STREAM, config)

    async def _read(self, client: Client, js: JetStreamContext) -> None:
        """Deliver messages until the source is closed. Raises the error that ends the connection."""
        pulled = await js.pull_subscribe_bind(self.consumer, STREAM)
        count, silent = 0, 0
        while not self._is_closing.is_set():
            await self._confirm(client)
            await self._fetch_declarations(js)
            if client.is_closed:
                raise nats.errors.ConnectionClosedError
            if self._stop.is_set() or not self._has_room():
                await asyncio.sleep(ROOM_WAIT)
                continue
            try:
                messages = await pulled.fetch(BATCH, timeout=WAIT)
                silent = 0
            except TimeoutError:
                messages = []
                if (silent := silent + 1) % SILENT == 0:
                    await js.consumer_info(STREAM, self.consumer)  # raises if somebody has removed it
            for each in messages:
                count += 1
                self._give(each, count)
        await self._confirm(client)
        await client.flush(timeout=1)

    def _give(self, message: Msg, count: int) -> None:
        at = message.metadata
        if at.sequence.consumer != count:
            raise nats.errors.Error("messages were lost on the network")  # they come again
        self._replies.append((at.sequence.stream, message.reply))
        if at.sequence.stream <= self._taken:
            return
        self._taken, self._time = at.sequence.stream, at.timestamp.timestamp()
        first = (message.headers or {}).get(FIRST, "")
        place = StreamPlace(at.sequence.stream, self._time, int(first) if first.isdecimal() else 0)
        key, kind = key_and_kind(message.subject)
        if self._is_wanted(key):
            self._put(kind, key, message.data, place)
        else:
            self._put("", key, b"", place)

    async def _confirm(self, client: Client) -> None:
        """Confirm the written data to the server: one confirmation covers all before it."""
        last, written = "", self._written
        while self._replies and self._replies[0][0] <= written:
            last = self._replies.popleft()[1]
        if last:
            await client.publish(last, b"+ACK")

    async def _fetch_declarations(self, js: JetStreamContext) -> None:
        while self._wanted:
            key, run = self._wanted.popleft()
            with suppress(NotFoundError):
                found = await js.get_last_msg(DECLARATIONS, subject(*key, keys.DECLARATION, run.hex()))
                self._put(keys.DECLARATION, key, found.data or b"", None)


def _filter(patterns: Sequence[str]) -> str:
    """Return the subject of the messages that the server sends: those of one pattern, as far as a subject can express
    it, or of all stations if there are several patterns."""
    site, _, station = (patterns[0] if len(patterns) == 1 else "*/*").partition("/")
    return subject(*("*" if "*" in each else each for each in (site, station)), "*")


def _name(folder: Path) -> str:
    """Return the name of the consumer of a folder. It is stored in the folder, and stays when the folder is moved."""
    file = folder / CONSUMER_FILE
    try:
        return file.read_text(encoding="ascii").strip()
    except FileNotFoundError:
        name = f"recorder-{secrets.token_hex(4)}"
        file.write_text(name + "\n", encoding="ascii")
        return name
