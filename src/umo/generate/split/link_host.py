"""The host's end of the link. It greets the controller, sends one request at a time, and takes the answers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NoReturn

from umo.drivers.streams import Lost, Stream, TimedOut
from umo.drivers.streams.stream import Dial
from umo.duration import duration
from umo.errors import DeviceTimeout, DriverError
from umo.generate.split.link_bodies import (
    VERSION,
    ControllerState,
    FrameKind,
    StateReader,
    Welcome,
    check_refused,
    hello,
    request,
    welcome_of,
)
from umo.generate.split.link_frames import FrameReader, framed
from umo.generate.split.part_plan import PartPlan
from umo.system import calls

PAUSE = 0.001
"""Time in s between two attempts to write to a line that accepts no data."""


class WrongController(DriverError):
    """Raised if the controller at the other end does not have this part, or has another version of it."""


class LinkHost:
    """One link. `state` is the controller's last answer in the session."""

    def __init__(self, dial: Dial, plan: PartPlan, name: str) -> None:
        self._dial, self._plan, self._name, self._now = dial, plan, name, calls.now
        self._states = StateReader(plan)
        self._stream: Stream | None = None
        self._reader = FrameReader(plan.longest)
        self._nonce = int(self._now() * 1e6) & 0xFFFFFFFF
        self._greets_at = 0.0
        """The time in s at which the next HELLO is sent."""
        self._number = 0
        self._sent: dict[int, float] = {}
        """The times in s at which the unanswered requests were sent, by the numbers of the requests."""
        self._took = 0.0
        self._unsent = bytearray()
        """Data that the line has not accepted yet."""
        self.session = 0
        """The number of the session; 0 if the controller was not started."""
        self.offered = 0
        """The session that the controller has offered, or 0 if there is none."""
        self.awaited = False
        """True if the last request was not answered."""
        self.state: ControllerState | None = None
        self._asked = 0.0
        """The time in s at which the request was sent to which `state` is the answer. The data in `state` are not
        older."""
        self._retry = plan.host_timeout / 5

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None
        self._unsent.clear()
        self._forget()

    def _forget(self) -> None:
        """Forget the session."""
        self.session, self.offered, self.state, self.awaited = 0, 0, None, False
        self._sent.clear()

    # Greeting --------------------------------------------------------------------------------------------

    def greet(self, deadline: float) -> None:
        """Connect, and send greetings until one is answered. Raises DeviceTimeout, DriverError or WrongController."""
        self.close()
        try:
            self._stream = self._dial(deadline)
            self._ask_for_session(deadline)
        except Lost as error:
            self._lost(error, "no answer")

    def _ask_for_session(self, deadline: float) -> None:
        assert self._stream is not None
        self._begin()
        while not self.offered:
            self._say_hello()
            try:
                self._take(self._stream.receive(min(deadline, self._greets_at)))
            except TimedOut:
                if self._now() >= deadline:
                    raise

    def look(self) -> bool | None:
        """Do the same as `greet`, but one step per call. Return None while the result is not known."""
        try:
            if self._stream is None:
                self._stream = next(self._dial.without_waiting(self._now()), None)
                self._begin()
            if self._stream is None:
                return None
            self._say_hello()
            self.receive()
        except Lost as error:
            self._lost(error, "no answer")
        return True if self.offered else None

    def _begin(self) -> None:
        self._reader = FrameReader(self._plan.longest)
        self._nonce, self._greets_at = (self._nonce + 1) & 0xFFFFFFFF, self._now()

    def _say_hello(self) -> None:
        assert self._stream is not None
        if not self.offered and (now := self._now()) >= self._greets_at:
            self._greets_at = now + self._retry
            self._stream.send(framed(hello(self._nonce)), self._greets_at)

    # Exchange --------------------------------------------------------------------------------------------

    def send(self, kind: FrameKind, inhibited: Iterable[bool], items: Iterable[bytes] = ()) -> int:
        """Send a request, and return its number."""
        if self._stream is None:
            raise DriverError("it is not connected")
        self._number = self.next_number
        self._sent[self._number], self.awaited = self._now(), True
        self._unsent += framed(request(kind, self.session, self._number, inhibited, items))
        try:
            self._flush()
        except Lost as error:
            self._lost(error, "not taken")
        return self._number

    @property
    def next_number(self) -> int:
        """The number of the next request."""
        return (self._number + 1) & 0xFFFF

    @property
    def may_send(self) -> bool:
        """True if the last request was answered, or was given up because its answer is late."""
        return not self._unsent and (not self.awaited or self._now() - self._sent[self._number] >= self._patience)

    @property
    def _patience(self) -> float:
        """The timeout in s for an answer, which is longer on a slow line."""
        return min(max(self._retry, 2 * self._took), self._plan.host_timeout / 2)

    def _flush(self) -> None:
        """Send as much as the line accepts, without waiting."""
        if self._unsent and self._stream is not None:
            del self._unsent[: self._stream.give(bytes(self._unsent))]

    def receive(self) -> None:
        """Read received data without waiting."""
        if self._stream is None:
            return
        try:
            self._flush()
            while not self._stream.idle():
                self._take(self._stream.waiting())
        except Lost as error:
            self._lost(error, "no answer")

    def start(self, inhibited: Sequence[bool], items: Sequence[bytes], deadline: float) -> ControllerState:
        """Begin the session that is offered. Raises DeviceTimeout if the controller does not answer before the
        deadline."""
        return self._in_a_session(FrameKind.START, inhibited, items, deadline)

    def stop(self, deadline: float) -> ControllerState:
        """Stop the session, or the session that is offered. Raises DeviceTimeout if the controller does not answer
        before the deadline."""
        return self._in_a_session(FrameKind.STOP, (), (), deadline)

    def _in_a_session(
        self, kind: FrameKind, inhibited: Sequence[bool], items: Sequence[bytes], deadline: float
    ) -> ControllerState:
        """Return the answer to a START or a STOP. If the controller does not answer within `host_timeout`, its session
        has ended, or may have begun and ended, and does not begin again. Then request another session."""
        try:
            while True:
                self.session = self.session or self.offered
                try:
                    until = min(deadline, self._now() + self._plan.host_timeout)
                    return self._answered(kind, inhibited, items, until)
                except TimedOut:
                    if self._now() >= deadline:
                        raise
                self._forget()
                self._ask_for_session(deadline)
        except Lost as error:
            self._lost(error, "no answer")

    def _answered(
        self, kind: FrameKind, inhibited: Sequence[bool], items: Sequence[bytes], deadline: float
    ) -> ControllerState:
        """Send a request repeatedly until it is answered. Raises Lost if the deadline passes or the line fails."""
        first = self.next_number
        while True:
            if not self._unsent:
                self.send(kind, inhibited, items)
            try:
                return self._answer_since(first, min(deadline, self._now() + self._patience))
            except TimedOut:
                if self._now() >= deadline:
                    raise

    def _answer_since(self, first: int, deadline: float) -> ControllerState:
        """Return the answer to the request with this number, or to a later request. Raises Lost if there is none by the
        deadline."""
        assert self._stream is not None
        while self.state is None or _is_after(first, self.state.heard):
            self._flush()
            if self._stream.idle() and self._unsent and self._now() < deadline:
                calls.sleep(PAUSE)
            else:
                self._take(self._stream.receive(deadline))
        self.awaited = False
        return self.state

    @property
    def age(self) -> float:
        """The largest possible age in s of the data in the last answer: the time since its request."""
        return self._now() - self._asked

    def _take(self, data: bytes) -> None:
        for body in self._reader.take(data):
            check_refused(body, self._name)
            if (welcome := welcome_of(body)) is not None:
                self._welcomed(welcome)
            elif (state := self._states.read(body)) is not None:
                self._told(state)

    def _welcomed(self, welcome: Welcome) -> None:
        if welcome.nonce != self._nonce:
            return  # of another greeting
        if welcome.version != VERSION:
            text = f"speaks version {welcome.version} of the link, and this umo version {VERSION}"
        elif welcome.real_size != self._plan.real_size:
            kinds = {4: "float", 8: "double"}
            has = kinds.get(welcome.real_size, "?")
            text = f'has {has}s, and the wiring says {kinds[self._plan.real_size]}: write real = "{has}"'
        elif welcome.hash != self._plan.hash:
            text = (
                f"has another part than {self._plan.path}, or another version of this part: generate the controller "
                f"again and load it"
            )
        else:
            self.offered = welcome.session
            return
        self.close()
        raise WrongController(f"the controller {self._name} {text}")

    def _told(self, state: ControllerState) -> None:
        if state.session != self.session:
            return
        asked = self._sent.get(state.heard)
        if asked is None:
            return  # an answer that was overtaken, or that has come twice
        self.state, self._asked = state, asked
        self._sent = {number: sent for number, sent in self._sent.items() if _is_after(number, state.heard)}
        if not self._sent:
            self.awaited = False
            self._took += (self._now() - asked - self._took) / 4  # one late answer makes no slow line

    def _lost(self, error: Lost, what: str) -> NoReturn:
        self.close()
        if isinstance(error, TimedOut):
            raise DeviceTimeout(f"{what} from the controller {self._name}: timed out") from None
        raise DriverError(f"{what} from the controller {self._name}: {error}") from None


def _is_after(number: int, other: int) -> bool:
    """Compare numbers of requests, which are counted modulo 2**16."""
    return 0 < (number - other) & 0xFFFF < 0x8000


def late(name: str, age: float) -> DeviceTimeout:
    """Return the error for a controller that has not answered for this time in s."""
    return DeviceTimeout(f"no answer from the controller {name} for {duration(age)}")
