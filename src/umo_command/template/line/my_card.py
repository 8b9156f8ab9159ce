"""The driver `my_card`, made by `umo new driver`: binary frames over TCP.

Change CHANNELS, the options and the frames. my_card_device.py simulates the device.

    [drivers.my_card]
    type = ".my_card:MyCard"    # without the dot if this is not in a station's folder
    host = "192.168.0.7"

A frame, high bytes first: how many bytes follow (2), the number of the request (2),
GET or SET (1), for each channel its place (1), a status (1; 0: done) and a value
(4, signed), and a checksum (2, CRC-16/XMODEM of all before it). The answer has the
number, the function and the places of its request.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from struct import Struct
from time import monotonic

import numpy as np
from umo.drivers import (
    Channel,
    ChannelError,
    ChannelsFailed,
    DeviceTimeout,
    Direction,
    Driver,
    DriverError,
    IntArray,
    Looks,
)
from umo.drivers.streams import Host, Look, Lost, Stream, TimedOut

CHANNELS = {
    "dac:0": Channel("dac:0", Direction.BOTH, bits=12),
    "relay:0": Channel("relay:0", Direction.BOTH, bits=1),
    "adc:0": Channel("adc:0", Direction.INPUT, bits=12),
    "switch:0": Channel("switch:0", Direction.INPUT, bits=1),
    "spare:0": Channel("spare:0", Direction.BOTH, bits=12),  # an option of the device
}
PLACES = {text: place for place, text in enumerate(CHANNELS)}
GET, SET = 1, 2
STATUS = {1: "there is no such channel", 2: "the value is out of range"}
HEAD, ITEM, CHECKSUM = Struct(">HHB"), Struct(">BBi"), Struct(">H")
MAX_REPLY = 4096
"""Largest number of bytes that may arrive in place of an answer."""

Item = tuple[int, int, int]
"""Place, status and value."""


class MyCard(Driver, Looks):
    """What the device is, in one line.

    Options:
        host: name or address of the device.
        port: its TCP port.
    """

    def __init__(self, *, host: str = "127.0.0.1", port: int = 7000) -> None:
        self.place = Host(host, port)
        self._dial = self.place.dial()  # nothing is opened before `open`
        self._look = Look(self._dial)
        self._stream: Stream | None = None
        self._is_open = False
        self._number = 0

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def devices(self) -> Sequence[str]:
        """Return one text per device, the same for all spellings: only one run at a time uses a device."""
        return self.place.devices()

    def open(self) -> None:
        self._is_open = True
        with self._connection():  # an error if the device is missing
            pass

    def close(self) -> None:
        self._is_open = False
        self._drop()

    def look(self) -> bool | None:
        """Return whether the device answers again, without waiting.

        The next call uses the stream on which the device has answered."""
        if self._stream is not None and self._stream.idle():
            return True
        if not self._look.under_way:
            self._drop()
            self._number = number = self._number % 0xFFFF + 1
            place = min(PLACES.values())
            request = framed(number, GET, [(place, 0, 0)])

            def has_answered(received: bytes) -> bool:
                return found(received, number, GET, [place]) is not None

            self._look.begin(request, has_answered, self.timeout)
        try:
            self._stream = self._look.found()
        except Lost as error:
            raise DriverError(str(error) or "not connected") from None
        return None if self._stream is None else True

    def read(self, channel: Channel) -> int:
        out = np.zeros(1, np.int64)
        self.read_many((channel,), out)
        return int(out[0])

    def write(self, channel: Channel, raw: int) -> None:
        self._set((channel,), (raw,))

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        failed = {}
        for i, (_, status, value) in enumerate(self._ask(GET, channels, ())):
            channel = channels[i]
            if status:
                failed[channel.text] = f"the device answers: {_meaning(status)}"
            elif not channel.lowest <= value <= channel.highest:
                failed[channel.text] = f"the device gives {value}, beyond its bits"
            else:
                out[i] = value
        if failed:
            raise ChannelsFailed(failed)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        self._set(channels, raws.tolist())

    def _set(self, channels: Sequence[Channel], raws: Sequence[int]) -> None:
        for channel, raw in zip(channels, raws, strict=True):  # before anything is sent
            channel.check(raw)
        failed = {}
        for i, (_, status, value) in enumerate(self._ask(SET, channels, raws)):
            if status:
                failed[channels[i].text] = f"the device answers: {_meaning(status)}"
            elif value != raws[i]:
                failed[channels[i].text] = f"the device took {value}, not {raws[i]}"
        if failed:
            raise ChannelsFailed(failed)

    # The line -------------------------------------------------------------------------

    def _ask(
        self,
        function: int,
        channels: Sequence[Channel],
        values: Sequence[int],
    ) -> list[Item]:
        """Send one request for all channels of a call, and return its answer."""
        if not channels:
            return []
        self._number = self._number % 0xFFFF + 1
        places = [PLACES[channel.text] for channel in channels]
        values = values or [0] * len(places)
        sent = framed(
            self._number,
            function,
            [(place, 0, value) for place, value in zip(places, values, strict=True)],
        )
        received = b""
        with self._connection() as (stream, deadline):
            stream.send(sent, deadline)
            while True:
                items = found(received, self._number, function, places)
                if items is not None:
                    return items
                if len(received) > MAX_REPLY:
                    raise Lost(f"{len(received)} bytes came that are not the answer")
                try:
                    received += stream.receive(deadline)
                except TimedOut:
                    came = f"{len(received)} bytes came that are not the answer"
                    raise TimedOut(came if received else "no answer") from None

    @contextmanager
    def _connection(self) -> Iterator[tuple[Stream, float]]:
        """Return a context with the stream for one call, and the call's deadline.

        After a failure the stream is closed, and the next call opens a new one: a late
        answer must not be taken for the answer to a later request.
        """
        if not self._is_open:
            raise DriverError("it is not open")
        deadline = monotonic() + self.timeout
        try:
            if self._stream is not None and not self._stream.idle():
                self._drop()  # it has ended, or has unexpected data
            if self._stream is None:
                self._look.stop()
                self._stream = self._dial(deadline)
            yield self._stream, deadline
        except TimedOut as error:
            self._drop()
            why, limit = str(error) or "not connected", self.timeout * 1000
            raise DeviceTimeout(f"{why}: timed out ({limit:g} ms)") from None
        except Lost as error:
            self._drop()
            raise DriverError(str(error)) from None
        except BaseException:
            self._drop()
            raise

    def _drop(self) -> None:
        self._look.stop()
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()


def framed(number: int, function: int, items: Sequence[Item]) -> bytes:
    """Return the bytes of a frame."""
    size = HEAD.size - 2 + ITEM.size * len(items) + CHECKSUM.size
    body = HEAD.pack(size, number, function)
    body += b"".join(ITEM.pack(*item) for item in items)
    return body + CHECKSUM.pack(crc_hqx(body, 0))


def found(
    received: bytes,
    number: int,
    function: int,
    places: Sequence[int],
) -> list[Item] | None:
    """Return the answer to a request, wherever it stands in the received bytes; None if it is missing or incomplete.
    All other bytes, such as noise or an earlier answer, are skipped.
    """
    whole = HEAD.size + ITEM.size * len(places) + CHECKSUM.size
    head = HEAD.pack(whole - 2, number, function)
    at = received.find(head)
    while at >= 0:
        frame = received[at : at + whole]
        items: list[Item] = []
        if len(frame) == whole:
            items += ITEM.iter_unpack(frame[HEAD.size : -CHECKSUM.size])
        asked = [place for place, _, _ in items] == places
        if asked and framed(number, function, items) == frame:
            return items
        at = received.find(head, at + 1)
    return None


def _meaning(status: int) -> str:
    return STATUS.get(status, f"status {status}")
