"""The conversation with a device that speaks in lines: one request, one answer, all of a call by one deadline."""

from __future__ import annotations

from dataclasses import dataclass
from time import monotonic, sleep

from umo.drivers.text.channel import Query
from umo.drivers.text.pattern import NoValue, Pattern, UnexpectedAnswer, shown, stripped
from umo.drivers.text.port import Dial, Hangup, Port
from umo.errors import DeviceTimeout, DriverError

_MOST_DOUBLED = 4
"""How often the quiet time is doubled: a device that answered late once is given longer."""


@dataclass(frozen=True)
class Dialogue:
    """How the device is spoken to: the options of the driver that are not about a channel."""

    terminator: str
    answer_terminator: str
    encoding: str
    errors: tuple[Pattern, ...]
    identify: Query | None
    startup: tuple[str, ...]
    acknowledge: Pattern | None
    confirm: Query | None
    greeting: Pattern | None
    echo: bool
    pause: float
    quiet: float
    boot_time: float
    starts_always: bool
    """A new connection starts the device; else only the first one."""
    longest_answer: int


class TextLink:
    """One connection. It is dropped after any failure but an error that the device answers, and the next call opens it
    again. An answer that comes late is lost with the connection; on a serial line it is thrown away until the line has
    been quiet for a time, and the answer to `identify` shows that none is left."""

    def __init__(self, dial: Dial, dialogue: Dialogue) -> None:
        self._dial, self._dialogue = dial, dialogue
        self._end = dialogue.answer_terminator.encode(dialogue.encoding)
        self._port: Port | None = None
        self._ready = False
        self._boots = True
        self._failures = 0
        """Connections that were dropped in succession."""
        self._data = bytearray()
        self._timeout = self._deadline = 0.0
        self._started = self._heard = self._free = 0.0

    def begin(self, timeout: float) -> None:
        """Begin one call of the driver, which ends within `timeout` s: connected, nothing left over."""
        self._timeout, self._deadline = timeout, monotonic() + timeout
        if self._ready and self._port is not None:
            self._failures = 0  # any failure would have dropped the connection
            try:
                self._look(self._port)
            except Hangup:
                self.close()  # and opened again
        if self._port is None:
            self._open()
        if self._port is not None and not self._ready:
            self._prepare(self._port)

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
        self._port, self._ready = None, False
        self._data.clear()

    def ask(self, request: str) -> str:
        """The device's answer; NoValue if it is one of the error answers."""
        self._send(request)
        line = self._line(request)
        self._nothing_waits()
        self.refuse(line, request)
        return line

    def refuse(self, line: str, request: str) -> None:
        """NoValue if the line is one of the error answers."""
        for pattern in self._dialogue.errors:
            if pattern.match(line) is not None:
                raise NoValue(f"the device answers {shown(line)} to {shown(request)}")

    def tell(self, request: str, acknowledge: Pattern | None, confirm: Query | None) -> None:
        """A request that sets something, confirmed as the device does it."""
        if acknowledge is not None:
            self._must_be(acknowledge, request, self.ask(request))
        else:
            self._send(request)
        if confirm is not None:
            try:
                self._must_be(confirm.answer, confirm.ask, self.ask(confirm.ask))
            except NoValue as error:
                raise NoValue(f"{error} after {shown(request)}") from None

    def dropped(self, error: DriverError) -> DriverError:
        """The error, after the connection was dropped because of it."""
        self._failures += 1
        self.close()
        return error

    def _must_be(self, pattern: Pattern, request: str, line: str) -> None:
        if pattern.match(line) is None:
            text = f"the device answers {shown(line)} to {shown(request)}, expected {pattern.text!r}"
            raise self.dropped(UnexpectedAnswer(text))

    # Opening -------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """A serial line starts its device when it is opened first, or after the device was away; TCP always."""
        boots, self._boots = self._boots, True
        self._port = self._dial(self._deadline)
        self._boots = self._dialogue.starts_always
        self._heard = monotonic()
        self._started = self._heard + (self._dialogue.boot_time if boots else 0.0)

    def _prepare(self, port: Port) -> None:
        """Bring a new connection into step; a call whose time is over leaves the rest to the next one."""
        try:
            self._settle(port)
            self._data.clear()
            dialogue = self._dialogue
            if dialogue.identify is not None:
                self._must_be(dialogue.identify.answer, dialogue.identify.ask, self.ask(dialogue.identify.ask))
            for request in dialogue.startup:
                self.tell(request, dialogue.acknowledge, dialogue.confirm)
        except _StillStarting as error:
            raise DeviceTimeout(str(error)) from None
        except DriverError as error:
            raise self.dropped(error) from None
        self._ready = True

    def _settle(self, port: Port) -> None:
        """Wait until the device has started and the line was quiet for its time; what comes in is thrown away."""
        dialogue = self._dialogue
        quiet = dialogue.quiet * 2 ** min(max(self._failures - 1, 0), _MOST_DOUBLED)
        while (ready := max(self._heard + quiet, self._started)) > (now := monotonic()):
            if now >= self._deadline:
                what = "the device has not started yet" if now < self._started else "the line is not quiet"
                raise _StillStarting(f"{what}: timed out ({self._timeout * 1000:g} ms)")
            data = port.receive(min(ready, self._deadline) - now)
            if data:
                self._heard = monotonic()
                if dialogue.greeting is not None and self._greets(dialogue.greeting, data):
                    self._started = self._heard

    def _greets(self, greeting: Pattern, data: bytes) -> bool:
        self._data += data
        *lines, rest = bytes(self._data).split(self._end)
        self._data[:] = rest[-self._dialogue.longest_answer :]
        encoding = self._dialogue.encoding
        return any(greeting.match(stripped(line.decode(encoding, "replace"))) is not None for line in lines)

    def _look(self, port: Port) -> None:
        """Nothing may have come in unasked: it would be taken for the answer to the next request."""
        self._data += port.receive(0.0)
        self._nothing_waits()

    def _nothing_waits(self) -> None:
        if self._data:
            sent = shown(bytes(self._data).decode(self._dialogue.encoding, "replace"))
            raise self.dropped(UnexpectedAnswer(f"the device sent {sent} unasked"))

    # Lines ---------------------------------------------------------------------------------------------

    def _send(self, request: str) -> None:
        assert self._port is not None
        dialogue = self._dialogue
        if dialogue.pause and (wait := self._free + dialogue.pause - monotonic()) > 0:
            if wait > self._left():
                raise self._late(request)
            sleep(wait)
        try:
            self._look(self._port)
            sent = self._port.send((request + dialogue.terminator).encode(dialogue.encoding), self._left())
        except Hangup as error:
            raise self.dropped(DriverError(f"sending {shown(request)}: {error}")) from None
        if not sent:
            raise self._late(request)
        if dialogue.pause:
            self._free = monotonic()
        if dialogue.echo and (line := self._line(request)) != stripped(request):
            text = f"the device echoes {shown(line)}, not {shown(request)}; echo = false if it does not echo"
            raise self.dropped(UnexpectedAnswer(text))

    def _line(self, request: str) -> str:
        """The next line, without its terminator and the blanks around it."""
        data, end, searched = self._data, self._end, 0
        while (at := data.find(end, searched)) < 0:
            if len(data) > self._dialogue.longest_answer:
                break
            searched = max(len(data) - len(end) + 1, 0)  # a terminator may be in two pieces
            self._take(request)
        if not 0 <= at <= self._dialogue.longest_answer:
            text = f"the answer to {shown(request)} is longer than {self._dialogue.longest_answer} bytes"
            raise self.dropped(UnexpectedAnswer(text))
        line = bytes(data[:at])
        del data[: at + len(end)]
        if self._dialogue.pause:
            self._free = monotonic()
        try:
            return stripped(line.decode(self._dialogue.encoding))
        except UnicodeDecodeError:
            text = f"the answer to {shown(request)} is not {self._dialogue.encoding}: {shown(line)}"
            raise self.dropped(UnexpectedAnswer(text)) from None

    def _take(self, request: str) -> None:
        """Wait for some bytes, if the time is not over."""
        assert self._port is not None
        if (left := self._left()) <= 0:
            raise self._late(request)
        try:
            self._data += self._port.receive(left)
        except Hangup as error:
            raise self.dropped(DriverError(f"waiting for the answer to {shown(request)}: {error}")) from None

    def _left(self) -> float:
        return self._deadline - monotonic()

    def _late(self, request: str) -> DriverError:
        limit = f"{self._timeout * 1000:g} ms"
        so_far = f" after {shown(bytes(self._data))}" if self._data else ""
        return self.dropped(DeviceTimeout(f"no answer to {shown(request)}{so_far}: timed out ({limit})"))


class _StillStarting(DriverError):
    """The time of the call is over before the line is ready; the connection stays."""
