"""Devices that speak in lines of text: SCPI instruments, controllers, an Arduino sketch; over TCP or a serial line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, get_args

from umo.drivers._block_driver import BlockDriver, Plans, in_turn
from umo.drivers.contract import IntArray
from umo.drivers.option_checks import one_of, within
from umo.drivers.optional import HasWatchdog, KnowsScale, Looks, NoWatchdog, PhysicalScale
from umo.drivers.streams import Host, Serial, place_of
from umo.drivers.streams.line import Flow, Parity
from umo.drivers.text.channel import (
    DRIVERS_ENDS,
    ChannelOptions,
    Channels,
    Query,
    QueryOptions,
    TextChannel,
)
from umo.drivers.text.exchange import QueryLine, RequestLine, plan_reads, plan_writes
from umo.drivers.text.link_settings import LinkSettings
from umo.drivers.text.pattern import NoValue, Pattern
from umo.drivers.text.text_link import TextLink
from umo.duration import duration
from umo.errors import DriverError, WiringError
from umo.system.packages import how_to_install

_DEFAULT_QUIET = 0.5
"""Quiet time in s of a serial line."""
_MAX_WATCHDOG = 86400.0
"""Longest time in s of a watchdog."""
Encoding = Literal["ascii", "latin-1", "utf-8"]
_DEFAULT = Host("", 5025), Serial("", 9600, "none")


class Text(BlockDriver[TextChannel], Looks, HasWatchdog, KnowsScale):
    """A device with a line protocol, which the wiring declares: SCPI instruments, controllers, an Arduino sketch.

    Channels: the names in `channels`; `zone{n}` is zone0, zone1, ..., with `{n}` in the texts of its table too.
    Keys of a channel's table:
        ask, answer: the request that reads, and the pattern of its answer (default "{}": the number alone).
        states: answers that stand for levels, { 0 = "OFF", 1 = ["ON", "1"] }, instead of a number.
        set: the request that writes, "VOLT {:.3f}", or a request for each level, { 0 = "OUTP OFF", 1 = "OUTP ON" }.
        acknowledge, confirm: like the options below, for this channel; "" and {} mean none.
        terminator, answer_terminator: like the options below, for this channel; a terminator may be empty, for example
            if the request is a single control character.
        sets_level: true if `set` sets a level, so that sending it twice does no more than once. Default: false, the
            request may be an event, such as a step: an actuator with on_error="retry" is refused.
        scale: the step of one raw integer: raw = number / scale, to the nearest. Without it numbers are whole.
        units: the unit of the device's numbers, "V": scale is then checked against the resolution of the object.
        bits, signed: default 64 and signed; with levels as many bits as they need, unsigned.
    In a pattern `{}` is the value and `*` any text; a regular expression stands between slashes, with one group.

    Options:
        channels: the tables of the channels, by name.
        host: a TCP device, or a gateway to a serial line; a host name is looked up once, by `open`.
        port: the TCP port. Default: 5025.
        serial: the device file of a serial line, in place of host and port.
        baudrate: the speed of the serial line in bit/s. Default: 9600.
        data_bits: the data bits of a character on the serial line, 5 to 8. Default: 8.
        parity: the parity of the serial line: "none", "even", "odd", "mark" or "space". Default: "none".
        stop_bits: the stop bits of a character on the serial line, 1 or 2. Default: 1.
        flow: flow control of the serial line: "none", "rtscts" or "xonxoff". Default: "none".
        dtr: the level of the serial line's output DTR while it is open. Default: true.
        terminator: the end of a request.
        answer_terminator: the end of an answer. Default: as terminator.
        encoding: the encoding of requests and answers: "ascii", "latin-1" or "utf-8".
        errors: patterns of answers with which the device refuses a request.
        acknowledge: the pattern of the answer to a request that sets.
        confirm: a query after each request that sets, { ask = "SYST:ERR?", answer = '*0,"No error"' }.
        identify: a query after connecting, { ask = "*IDN?", answer = "ACME,PSU*" }: any other device is refused.
        startup: requests that are sent after each connection is made.
        skip_empty_lines: ignore empty lines of the device, for example if its answers begin with a newline.
        echo: true if the device repeats each request before it answers.
        together: the text that joins several queries in one line, and their answers, such as ";". It also joins
            requests that set.
        longest_request: the largest number of characters of such a line.
        longest_answer: the largest number of bytes of an answer.
        pause: the time in s between an answer and the next request.
        boot_time: the time in s that the device may need after connecting; on a serial line only after the first
            connection, or if the device had been removed.
        greeting: the pattern of a line from the device that ends boot_time early.
        quiet: the time in s for which the device must send nothing before a new connection is used. Default: 0.5 on a
            serial line, 0 on TCP.
        watchdog_set: the request that arms the device's watchdog, with {s} or {ms} for the time; 0 disarms it.

    Each call returns within `timeout`, including a reconnection. There is no retry. The connection is closed after a
    timeout, after an answer that is neither as declared nor in `errors`, and after unrequested data. The next call
    opens it again. A serial line has no transaction numbers: an answer that comes later than `timeout` + `quiet` after
    its request can be taken for the answer to another request, unless `identify` detects it. `quiet` is doubled with
    each failure in succession, up to 16 times. A channel without acknowledge and confirm counts as written when its
    request is sent.
    """

    forms = ("NAME", "NAME with a number in place of {n} (names of the option channels)")

    def __init__(
        self,
        *,
        channels: dict[str, ChannelOptions],
        host: str | None = None,
        port: int | None = None,
        serial: str | None = None,
        baudrate: int | None = None,
        data_bits: Literal[5, 6, 7, 8] | None = None,
        parity: Parity | None = None,
        stop_bits: Literal[1, 2] | None = None,
        flow: Flow | None = None,
        dtr: bool | None = None,
        terminator: str = "\n",
        answer_terminator: str | None = None,
        encoding: Encoding = "ascii",
        errors: tuple[str, ...] = (),
        acknowledge: str | None = None,
        confirm: QueryOptions | None = None,
        identify: QueryOptions | None = None,
        startup: tuple[str, ...] = (),
        skip_empty_lines: bool = False,
        echo: bool = False,
        together: str | None = None,
        longest_request: int = 255,
        longest_answer: int = 4096,
        pause: float = 0.0,
        boot_time: float = 0.0,
        greeting: str | None = None,
        quiet: float | None = None,
        watchdog_set: str | None = None,
    ) -> None:
        if host is None and serial is None:
            raise WiringError('a text driver needs host = "..." for TCP or serial = "/dev/tty..."')
        line = {"baudrate": baudrate, "data_bits": data_bits, "parity": parity, "stop_bits": stop_bits}
        self.place = place_of(_DEFAULT, host, port, serial, **line, flow=flow, dtr=dtr)
        one_of("encoding", encoding, get_args(Encoding))
        within("longest_request", longest_request, 1, 1 << 20)
        within("longest_answer", longest_answer, 1, 1 << 20)
        if quiet is None:
            quiet = _DEFAULT_QUIET if serial else 0.0
        _check_times(pause=pause, boot_time=boot_time, quiet=quiet)
        _check_texts(greeting, boot_time, (together, terminator, answer_terminator), watchdog_set)
        _check_sendable([channels, confirm, identify, startup, watchdog_set], terminator, encoding)
        self._dialogue = LinkSettings(
            terminator=terminator,
            answer_terminator=answer_terminator or terminator,
            encoding=encoding,
            errors=tuple(Pattern(text, "errors") for text in errors),
            identify=Query.parse(identify, "identify"),
            startup=tuple(startup),
            acknowledge=Pattern(acknowledge, "acknowledge") if acknowledge else None,
            confirm=Query.parse(confirm, "confirm"),
            greeting=Pattern(greeting, "greeting") if greeting else None,
            echo=echo,
            pause=pause,
            quiet=quiet,
            boot_time=boot_time,
            starts_always=host is not None,
            longest_answer=longest_answer,
            skip_empty_lines=skip_empty_lines,
        )
        self._channels = Channels(channels, self._dialogue.acknowledge, self._dialogue.confirm)
        if skip_empty_lines and (silent := self._channels.with_state("")) is not None:
            raise WiringError(f'channels.{silent}.states: "" never arrives, because skip_empty_lines = true')
        self._joins, self._longest = together is not None, longest_request
        self._watchdog_set = watchdog_set
        self._prepared = self.place.prepared()
        self._link: TextLink | None = None
        self._reads = Plans[TextChannel, tuple[QueryLine, ...]](
            lambda some: plan_reads(some, together, longest_request)
        )
        self._writes = Plans[TextChannel, tuple[RequestLine, ...]](lambda some: plan_writes(some, together))

    def channel(self, text: str) -> TextChannel:
        return self._channels.named(text)

    def devices(self) -> Sequence[str]:
        """Return the host's addresses and port, or the device file."""
        return self.place.devices()

    def physical_scale(self, channel: TextChannel) -> PhysicalScale | None:
        """Return the scale of a channel that has units; zero_offset is 0."""
        return channel.physical

    def open(self) -> None:
        """Connect and identify the device, within `timeout`."""
        if not self._prepared:
            raise DriverError(f"a serial line needs pyserial: {how_to_install('text')}")
        self._link = TextLink(self.place.dial(), self._dialogue)
        self._link.begin(self.timeout)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def read_many(self, channels: Sequence[TextChannel], out: IntArray) -> None:
        plan, link = self._reads.of(channels), self._begin()
        in_turn(plan, lambda line: line.read(link, out), _texts_of, _ends_call)

    def look(self) -> bool | None:
        """Look for the device by a query that is made anyway, or by `identify`. If the device is never queried, only
        connect."""
        if self._link is None:
            return False
        plan = self._reads.last
        return self._link.look(*((plan[0].request, plan[0].ends) if plan else ("", DRIVERS_ENDS)), self.timeout)

    def watchdog(self, seconds: float) -> None:
        """Send `watchdog_set` with this time."""
        self.check_watchdog(seconds)
        assert self._watchdog_set is not None
        milliseconds = max(round(seconds * 1000), 1 if seconds else 0)
        request = self._watchdog_set.replace("{ms}", f"{milliseconds}").replace("{s}", f"{milliseconds / 1000:.3f}")
        self._begin().tell(request, self._dialogue.acknowledge, self._dialogue.confirm)

    def check_watchdog(self, seconds: float) -> None:
        if self._watchdog_set is None:
            raise NoWatchdog("a watchdog needs the option watchdog_set")
        if not 0 <= seconds <= _MAX_WATCHDOG:
            raise DriverError(f"a watchdog of {duration(seconds)} is not within 0 to {duration(_MAX_WATCHDOG)}")

    def _write(self, channels: Sequence[TextChannel], raws: list[int]) -> None:
        # All requests are made before the first is sent: a value that does not fit leaves the device alone.
        requests = list(map(TextChannel.request, channels, raws))
        lines: Sequence[RequestLine] = self._writes.of(channels)
        if self._joins:
            lines = [line for each in lines for line in each.lines(requests, self._longest)]
        link = self._begin()
        in_turn(lines, lambda line: line.write(link, requests), _texts_of, _ends_call)

    def _begin(self) -> TextLink:
        if self._link is None:
            raise DriverError("it is not open")
        self._link.begin(self.timeout)
        return self._link


def _texts_of(line: QueryLine | RequestLine) -> Sequence[str]:
    return line.texts


def _ends_call(error: DriverError) -> bool:
    """Return True if the connection is lost after this error, so that the later lines fail, too."""
    return not isinstance(error, NoValue)


def _check_times(**times: float) -> None:
    for name, seconds in times.items():
        if not 0 <= seconds <= 60:
            raise WiringError(f"{name} must be from 0 to 60 s, not {seconds!r}")


def _check_texts(
    greeting: str | None, boot_time: float, ends: tuple[str | None, ...], watchdog_set: str | None
) -> None:
    """Check options that are texts. Raises WiringError if one is empty, or lacks another option or a part that it
    needs."""
    if greeting is not None and not boot_time:
        raise WiringError("greeting needs boot_time, the longest time in s to wait for the greeting")
    if "" in ends:
        raise WiringError("together, terminator and answer_terminator must not be empty")
    if watchdog_set is not None and ("{s}" in watchdog_set) == ("{ms}" in watchdog_set):
        raise WiringError(f"watchdog_set: {watchdog_set!r} needs {{s}} or {{ms}} for the time")


def _check_sendable(thing: object, terminator: str, encoding: str) -> None:
    """Check that every text, including those of answers, can be encoded and contains no terminator."""
    if isinstance(thing, str):
        try:
            thing.encode(encoding)
        except UnicodeEncodeError:
            raise WiringError(f"{thing!r} is not {encoding}; encodings: ascii, latin-1, utf-8") from None
        if terminator and terminator in thing:
            raise WiringError(f"{thing!r} contains the terminator {terminator!r}")
    elif isinstance(thing, Mapping):
        given = thing.get("terminator", terminator)
        own = given if isinstance(given, str) else terminator  # else it is a channel of this name
        for key, each in thing.items():
            if key in ("terminator", "answer_terminator") and isinstance(each, str):
                _check_sendable(each, "", encoding)
            else:
                _check_sendable(each, terminator if key == "confirm" else own, encoding)
    elif isinstance(thing, list | tuple):
        for each in thing:
            _check_sendable(each, terminator, encoding)
