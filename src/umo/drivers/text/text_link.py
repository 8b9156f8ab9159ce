"""The conversation with a device that speaks in lines: one answer for each request, and one deadline for a whole
call."""

from __future__ import annotations

from time import monotonic, sleep

from umo.drivers.streams import Gone, Lost, Stream, TimedOut
from umo.drivers.streams.stream import Dial
from umo.drivers.text.channel import DRIVERS_ENDS, Ends, Query
from umo.drivers.text.link_settings import LinkSettings, is_blank
from umo.drivers.text.pattern import BLANKS, LINE_BLANKS, NoValue, Pattern, UnexpectedAnswer, shown
from umo.drivers.text.text_look import TextLook
from umo.duration import duration
from umo.errors import DeviceTimeout, DriverError

_MAX_EMPTY_LINES = 100
"""Largest number of empty lines before an answer, where they are skipped."""
_MAX_DOUBLINGS = 4
"""Largest number of doublings of the quiet time: a device that answered late once is given longer."""


class TextLink:
    """One connection. After any failure except an error answer of the device, the connection is dropped, and the next
    call opens it again. On TCP a late answer is lost with the connection. On a serial line received data are discarded
    until the line has been quiet for a time; then the answer to `identify` shows that no late answer is pending."""

    def __init__(self, dial: Dial, dialogue: LinkSettings) -> None:
        self._dial, self._dialogue = dial, dialogue
        self._search = TextLook(dial, dialogue)
        self.errors, self._longest = dialogue.errors, dialogue.longest_answer
        self._end = self._drivers_end = dialogue.end(DRIVERS_ENDS)
        """The bytes that end the answer to the last request, and the bytes that end answers by default."""
        self._stream: Stream | None = None
        self._ready = False
        self._was_found = False
        """True if the device has answered a look on this connection."""
        self._is_known_idle = False
        """True if it is known that no unrequested data have arrived since the last look."""
        self._is_under_way = False
        """True while a request is sent and answered. It stays True if Ctrl-C ends this: the answer may come late."""
        self._boots = True
        self._failures = 0
        """The number of connections that were dropped in succession."""
        self._data = bytearray()
        self._timeout = self._deadline = 0.0
        self._started = self._heard = self._free = 0.0

    def begin(self, timeout: float) -> None:
        """Begin one call of the driver, which ends within `timeout` s: connect if needed, and discard leftover data."""
        self._timeout, self._deadline = timeout, monotonic() + timeout
        if self._is_under_way:
            self.close()
        if self._ready and self._stream is not None:
            self._failures = 0  # any failure would have dropped the connection
            if not self._stream.idle():
                try:
                    self._look(self._stream)
                except Gone:
                    self.close()  # and opened again
        stream = self._stream or self._open()
        if not self._ready:
            self._prepare(stream)
        self._is_known_idle = True

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream, self._ready, self._was_found, self._is_under_way = None, False, False, False
        self._data.clear()
        self._search.stop()

    def look(self, query: str, ends: Ends, seconds: float) -> bool | None:
        """Return whether the device answers this query in any way, on a new connection and without waiting; without a
        query, whether a connection is possible. None if this is not known yet. Raises DriverError if the device does
        not answer now."""
        answered = (self._ready or self._was_found) and not self._is_under_way
        if answered and self._stream is not None and self._stream.idle():
            return True  # it answered the last request: any failure would have dropped the connection
        try:
            if not self._search.under_way:
                self.close()
                self._search.ask(query, ends, seconds, self._boots)
            stream = self._search.found()
        except (Lost, DriverError) as error:
            self._boots = True
            raise DriverError(str(error) or "connecting: timed out") from None
        if stream is None:
            return None
        self._stream, self._boots, self._was_found = stream, self._dialogue.starts_always, True
        self._started = self._heard = 0.0  # its answer has come: nothing else will
        self._free = monotonic()
        return True

    def ask(self, request: str, ends: Ends = DRIVERS_ENDS) -> str:
        """Send a query, and return the device's answer. Raises NoValue if it is one of the error answers."""
        self._is_under_way = True
        self._send(request, ends)
        line = self._line(request)
        self._is_under_way = False
        if self._data and not self._skips(self._data):
            raise self._unasked()
        if self.errors:
            self.refuse(line, request)
        return line

    def refuse(self, line: str, request: str) -> None:
        """Check a line. Raises NoValue if it is one of the error answers."""
        for pattern in self.errors:
            if pattern.match(line) is not None:
                raise NoValue(f"the device answers {shown(line)} to {shown(request)}")

    def tell(self, request: str, acknowledge: Pattern | None, confirm: Query | None, ends: Ends = DRIVERS_ENDS) -> None:
        """Send a request that sets something, and check its confirmation."""
        if acknowledge is not None:
            line = self.ask(request, ends)
            if acknowledge.match(line) is None:
                self._must_be(acknowledge, request, line)
        else:
            self._is_under_way = True
            self._send(request, ends)
            self._is_under_way = False
        if confirm is not None:
            try:
                self._must_be(confirm.answer, confirm.ask, self.ask(confirm.ask, confirm.ends))
            except NoValue as error:
                raise NoValue(f"{error} after {shown(request)}") from None

    def dropped(self, error: DriverError) -> DriverError:
        """Drop the connection because of an error, and return the error."""
        self._failures += 1
        self.close()
        return error

    def _must_be(self, pattern: Pattern, request: str, line: str) -> None:
        if pattern.match(line) is None:
            text = f"the device answers {shown(line)} to {shown(request)}, expected {pattern.text!r}"
            raise self.dropped(UnexpectedAnswer(text))

    # Opening -------------------------------------------------------------------------------------------

    def _open(self) -> Stream:
        """Open the stream. Each TCP connection starts the device; on a serial line only the first one, or one after the
        device was away."""
        boots, self._boots = self._boots, True
        try:
            stream = self._stream = self._dial(self._deadline)
        except TimedOut as error:
            raise DeviceTimeout(f"connecting: {str(error) or 'timed out'}") from None
        except Gone as error:
            raise DriverError(f"connecting: {error}") from None
        self._boots = self._dialogue.starts_always
        self._heard = monotonic()
        self._started = self._heard + (self._dialogue.boot_time if boots else 0.0)
        return stream

    def _prepare(self, stream: Stream) -> None:
        """Bring a new connection into step. If the time of the call ends first, the next call continues with it."""
        try:
            self._settle(stream)
            self._data.clear()
            dialogue = self._dialogue
            if (query := dialogue.identify) is not None:
                self._must_be(query.answer, query.ask, self.ask(query.ask, query.ends))
            for request in dialogue.startup:
                self.tell(request, dialogue.acknowledge, dialogue.confirm)
        except _StillStarting as error:
            raise DeviceTimeout(str(error)) from None
        except Gone as error:
            raise self.dropped(DriverError(f"connecting: {error}")) from None
        except DriverError as error:
            raise self.dropped(error) from None
        self._ready = True

    def _settle(self, stream: Stream) -> None:
        """Wait until the device has started and the line was quiet for its time. Received data are discarded."""
        dialogue = self._dialogue
        quiet = dialogue.quiet * 2 ** min(max(self._failures - 1, 0), _MAX_DOUBLINGS)
        while (ready := max(self._heard + quiet, self._started)) > (now := monotonic()):
            if now >= self._deadline:
                what = "the device has not started yet" if now < self._started else "the line is not quiet"
                raise _StillStarting(f"{what}: timed out ({duration(self._timeout)})")
            try:
                data = stream.receive(min(ready, self._deadline))
            except TimedOut:
                continue
            self._heard = monotonic()
            if dialogue.greeting is not None and self._greets(dialogue.greeting, data):
                self._started = self._heard

    def _greets(self, greeting: Pattern, data: bytes) -> bool:
        self._data += data
        *lines, rest = bytes(self._data).split(self._drivers_end)
        self._data[:] = rest[-self._longest :]
        encoding = self._dialogue.encoding
        return any(greeting.match(line.decode(encoding, "replace").strip(BLANKS)) is not None for line in lines)

    def _look(self, stream: Stream) -> None:
        """Check that nothing has come in without a request: it would be taken for the answer to the next request."""
        data = bytearray(stream.waiting())
        if data and not self._skips(data):
            self._data += data
            raise self._unasked()

    def _skips(self, data: bytearray) -> bool:
        """Discard the data if it consists of empty lines only and empty lines are skipped. Return True if it was
        discarded."""
        skips = self._dialogue.skip_empty_lines and is_blank(bytes(data).replace(self._end, b""))
        if skips:
            data.clear()
        return skips

    def _unasked(self) -> DriverError:
        sent = shown(bytes(self._data).decode(self._dialogue.encoding, "replace"))
        return self.dropped(UnexpectedAnswer(f"the device sent {sent} unasked"))

    # Lines ---------------------------------------------------------------------------------------------

    def _send(self, request: str, ends: Ends) -> None:
        dialogue, stream = self._dialogue, self._stream
        assert stream is not None
        if dialogue.pause:
            self._pause(request)
        try:
            if not self._is_known_idle and not stream.idle():
                self._look(stream)
            self._is_known_idle = False
            self._end = self._drivers_end if ends is DRIVERS_ENDS else dialogue.end(ends)
            stream.send(dialogue.encoded(request, ends), self._deadline)
        except TimedOut:
            raise self._late(request) from None
        except Gone as error:
            raise self.dropped(DriverError(f"sending {shown(request)}: {error}")) from None
        if dialogue.pause:
            self._free = monotonic()
        if dialogue.echo and (line := self._line(request)) != request.strip(BLANKS):
            text = f"the device echoes {shown(line)}, not {shown(request)}; echo = false if it does not echo"
            raise self.dropped(UnexpectedAnswer(text))

    def _pause(self, request: str) -> None:
        """Wait until the device takes the next request."""
        if (wait := self._free + self._dialogue.pause - monotonic()) > 0:
            if wait > self._deadline - monotonic():
                raise self._late(request)
            sleep(wait)
            self._is_known_idle = False

    def _line(self, request: str) -> str:
        """Return the next line without its terminator and without blanks at both ends. If empty lines are skipped,
        return the next line that is not empty."""
        line = self._next_line(request)
        if not line and self._dialogue.skip_empty_lines:
            for _ in range(_MAX_EMPTY_LINES):
                if line := self._next_line(request):
                    return line
            text = f"more than {_MAX_EMPTY_LINES} empty lines in place of an answer to {shown(request)}"
            raise self.dropped(UnexpectedAnswer(text))
        return line

    def _next_line(self, request: str) -> str:
        stream, end = self._stream, self._end
        assert stream is not None
        try:
            received = b"" if self._data else stream.receive(self._deadline)
            at = received.find(end)
            whole = 0 <= at == len(received) - len(end) <= self._longest  # as it mostly is: no more and no less
            line = received[:at] if whole else self._pieces(received, stream, request)
        except TimedOut:
            raise self._late(request) from None
        except Gone as error:
            raise self.dropped(DriverError(f"waiting for the answer to {shown(request)}: {error}")) from None
        if self._dialogue.pause:
            self._free = monotonic()
        try:
            return line.decode(self._dialogue.encoding).strip(LINE_BLANKS)
        except UnicodeDecodeError:
            text = f"the answer to {shown(request)} is not {self._dialogue.encoding}: {shown(line)}"
            raise self.dropped(UnexpectedAnswer(text)) from None

    def _pieces(self, received: bytes, stream: Stream, request: str) -> bytes:
        """Return the next line of the received data and what follows."""
        data, end, searched = self._data, self._end, 0
        data += received
        while (at := data.find(end, searched)) < 0:
            if len(data) > self._longest:
                break
            searched = max(len(data) - len(end) + 1, 0)  # a terminator may be in two pieces
            data += stream.receive(self._deadline)
        if not 0 <= at <= self._longest:
            text = f"the answer to {shown(request)} is longer than {self._longest} bytes"
            raise self.dropped(UnexpectedAnswer(text))
        line = bytes(data[:at])
        del data[: at + len(end)]
        return line

    def _late(self, request: str) -> DriverError:
        limit = duration(self._timeout)
        if self._data:
            sent, end = (each.decode(self._dialogue.encoding, "replace") for each in (bytes(self._data), self._end))
            text = f"the device sent {shown(sent)} without the terminator {end!r}: timed out ({limit})"
            return self.dropped(DeviceTimeout(f"{text}; set answer_terminator"))
        return self.dropped(DeviceTimeout(f"no answer to {shown(request)}: timed out ({limit})"))


class _StillStarting(DriverError):
    """The time of the call is over before the device or the line is ready. The connection stays open."""
