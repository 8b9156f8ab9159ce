"""The host's end of the link: greets the controller, sends one request at a time, takes its answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from time import monotonic, sleep
from typing import NoReturn

from umo.drivers.streams import Lost, Stream, TimedOut
from umo.drivers.streams.stream import Dial
from umo.errors import DeviceTimeout, DriverError
from umo.presentation.durations import duration
from umo.split.link_bodies import (
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
from umo.split.link_frames import FrameReader, framed
from umo.split.part_plan import PartPlan

PAUSE = 0.001
"""Time in s between two attempts at a line that takes nothing."""


class WrongController(DriverError):
    """The controller at the other end does not have this part, or not this version of it."""


class LinkHost:
    """One link. `state` is the last answer of the session, `arrived` its time in s of `now`."""

    def __init__(self, dial: Dial, plan: PartPlan, name: str, now: Callable[[], float] = monotonic) -> None:
        self._dial, self._plan, self._name, self._now = dial, plan, name, now
        self._states = StateReader(plan)
        self._stream: Stream | None = None
        self._reader = FrameReader(plan.longest)
        self._nonce = int(now() * 1e6) & 0xFFFFFFFF
        self._greeted = 0.0
        self._number = 0
        self._sent = self._took = 0.0
        self._unsent = bytearray()
        """What the line has not taken yet."""
        self.session = 0
        """0: the controller was not started."""
        self.offered = 0
        """The session that the controller has offered; 0: none."""
        self.awaited = False
        """Whether the last request was not answered."""
        self.state: ControllerState | None = None
        self.arrived = 0.0
        self._retry = plan.host_timeout / 5

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream, self.session, self.offered, self.state, self.awaited = None, 0, 0, None, False
        self._unsent.clear()

    # Greeting --------------------------------------------------------------------------------------------

    def greet(self, deadline: float) -> None:
        """Connect, and ask who is there until it answers. DeviceTimeout, DriverError, WrongController."""
        self.close()
        try:
            self._stream = self._dial(deadline)
            self._begin()
            while not self.offered:
                self._say_hello()
                try:
                    self._take(self._stream.receive(min(deadline, self._greeted + self._retry)))
                except TimedOut:
                    if self._now() >= deadline:
                        raise
        except Lost as error:
            self._lost(error, "no answer")

    def look(self) -> bool | None:
        """The same, a step with each call: None while it is not known."""
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
        self._nonce, self._greeted = (self._nonce + 1) & 0xFFFFFFFF, self._now() - 2 * self._retry

    def _say_hello(self) -> None:
        assert self._stream is not None
        if not self.offered and self._now() - self._greeted >= self._retry:
            self._greeted = self._now()
            self._stream.send(framed(hello(self._nonce)), self._greeted + self._retry)

    # Exchange --------------------------------------------------------------------------------------------

    def send(self, kind: FrameKind, inhibited: Iterable[bool], items: Iterable[bytes] = ()) -> int:
        """Send a request; its number."""
        if self._stream is None:
            raise DriverError("it is not connected")
        self._number = (self._number + 1) & 0xFFFF
        self._sent, self.awaited = self._now(), True
        self._unsent += framed(request(kind, self.session, self._number, inhibited, items))
        try:
            self._flush()
        except Lost as error:
            self._lost(error, "not taken")
        return self._number

    @property
    def may_send(self) -> bool:
        """Whether the last request was answered, or is given up: its answer is late."""
        return not self._unsent and (not self.awaited or self._now() - self._sent >= self._patience)

    @property
    def _patience(self) -> float:
        """Time in s for which an answer is waited for: longer on a slow line."""
        return min(max(self._retry, 2 * self._took), self._plan.host_timeout / 2)

    def _flush(self) -> None:
        """Send what the line takes, without waiting."""
        if self._unsent and self._stream is not None:
            del self._unsent[: self._stream.give(bytes(self._unsent))]

    def receive(self) -> None:
        """Take what has come in, without waiting."""
        if self._stream is None:
            return
        try:
            self._flush()
            while not self._stream.idle():
                self._take(self._stream.waiting())
        except Lost as error:
            self._lost(error, "no answer")

    def ask(
        self, kind: FrameKind, inhibited: Sequence[bool], items: Sequence[bytes], deadline: float
    ) -> ControllerState:
        """Send a START or a STOP again and again, until it is answered. DeviceTimeout if it is not by then."""
        self.session = self.session if kind is FrameKind.STOP and self.session else self.offered
        while True:
            number = self.send(kind, inhibited, items) if not self._unsent else self._number
            until = self._now() + self._plan.host_timeout
            try:
                while self.state is None or self.state.heard != number or self.awaited:
                    assert self._stream is not None
                    self._flush()
                    if self._stream.idle() and self._unsent and self._now() < min(deadline, until):
                        sleep(PAUSE)
                    else:
                        self._take(self._stream.receive(min(deadline, until)))
                return self.state
            except Lost as error:
                if not isinstance(error, TimedOut) or self._now() >= deadline:
                    self._lost(error, "no answer")

    @property
    def age(self) -> float:
        """Time in s since the last answer."""
        return self._now() - self.arrived

    def _take(self, data: bytes) -> None:
        for body in self._reader.take(data):
            check_refused(body, self._name)
            if (welcome := welcome_of(body)) is not None:
                self._welcomed(welcome)
            elif (state := self._states.read(body)) is not None:
                self._told(state)

    def _welcomed(self, welcome: Welcome) -> None:
        if welcome.nonce != self._nonce or self.offered:
            return  # of another greeting
        if welcome.version != VERSION:
            text = f"speaks version {welcome.version} of the link, and this umo version {VERSION}"
        elif welcome.real_size != self._plan.real_size:
            kinds = {4: "float", 8: "double"}
            has = kinds.get(welcome.real_size, "?")
            text = f'has {has}s, and the wiring says {kinds[self._plan.real_size]}: write real = "{has}"'
        elif welcome.hash != self._plan.hash:
            text = f"has another {self._plan.path}, or another version of it: generate it again, and load it"
        else:
            self.offered = welcome.session
            return
        self.close()
        raise WrongController(f"the controller {self._name} {text}")

    def _told(self, state: ControllerState) -> None:
        if state.session != self.session:
            return
        if self.state is not None and 0 < (self.state.heard - state.heard) & 0xFFFF < 0x8000:
            return  # an answer that was overtaken
        self.state, self.arrived = state, self._now()
        if self.awaited and state.heard == self._number:
            self.awaited = False
            self._took += (self._now() - self._sent - self._took) / 4  # one late answer makes no slow line

    def _lost(self, error: Lost, what: str) -> NoReturn:
        self.close()
        if isinstance(error, TimedOut):
            raise DeviceTimeout(f"{what} from the controller {self._name}: timed out") from None
        raise DriverError(f"{what} from the controller {self._name}: {error}") from None


def late(name: str, age: float) -> DeviceTimeout:
    """The controller has given no answer for this time in s."""
    return DeviceTimeout(f"no answer from the controller {name} for {duration(age)}")
