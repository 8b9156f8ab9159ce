"""Taps. A tap is between a driver and its device, passes everything on, and changes answers on request."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from time import monotonic, sleep

from umo.testing.conformance.relay import ANSWER_GAP, HOLDING, PASSING, AnswerMode, Change, Relay, Tapped, Traffic

MAX_LATENESS = 0.5
"""Time in s within which an answer that will be delivered late must have arrived."""


class Tap(Relay):
    """The base class of TcpTap and PtyTap.

    with TcpTap("127.0.0.1", 502) as tap:
        driver = Modbus(host=tap.host, port=tap.port)
        ...
        with tap.silent():
            driver.read(channel)  # times out
    """

    ordered = True
    """True if a connection that the driver opens again does not carry data that was sent on the earlier connection."""
    _gone = False

    def spoiling(self, change: Change, *, hangup: bool = False, reset: bool = False) -> AbstractContextManager[None]:
        """Return a context in which each answer is changed. With `hangup` the connection is closed after the answer.
        With `reset` the connection ends as if the device had restarted."""
        return self._in(AnswerMode(change=change, hangup=hangup or reset, reset=reset))

    def silent(self) -> AbstractContextManager[None]:
        """Return a context in which requests reach the device, but answers get lost."""
        return self.spoiling(lambda answer: b"")

    @contextmanager
    def late(self, *, behind: bool = False) -> Iterator[None]:
        """Return a context whose answers are delivered at its end. `behind`: each late answer is delivered with the
        answer to the next request."""

        def deliver(tapped: Tapped) -> None:
            self._finish(tapped, holding=True)
            if not behind:
                self._put(tapped, tapped.driver, tapped.held)
                tapped.held = b""

        spoiled = self.spoiled
        with self._in(HOLDING, deliver):
            yield
            self.await_answer(spoiled)

    def split(self) -> AbstractContextManager[None]:
        """Return a context in which each answer comes in pieces. The first and the last piece have one byte."""
        return self._in(AnswerMode(splitting=True))

    def trickling(self, step: float) -> AbstractContextManager[None]:
        """Return a context in which each answer comes byte by byte, one every `step` s. At the end of the context the
        remaining bytes are sent immediately."""

        def deliver(tapped: Tapped) -> None:
            self._put(tapped, tapped.driver, tapped.trickle)
            tapped.trickle = b""

        return self._in(AnswerMode(step=step), deliver)

    def endless(self, step: float = 0.001) -> AbstractContextManager[None]:
        """Return a context in which an endless stream of bytes replaces an answer, one every `step` s."""
        return self._in(AnswerMode(endless=step))

    @contextmanager
    def counting(self, answers: bool = False) -> Iterator[Traffic]:
        """Return a context that yields the traffic during it. With `answers` an answer that arrives after the context
        counts, too."""
        traffic, spoiled = Traffic(), self.spoiled
        with self._lock:
            self._traffic = traffic
        try:
            yield traffic
            self.settle()
            end = monotonic() + MAX_LATENESS
            while answers and traffic.asked and not traffic.answer and self.spoiled == spoiled and monotonic() < end:
                sleep(ANSWER_GAP)
        finally:
            with self._lock:
                self._traffic = None

    def await_answer(self, spoiled: int) -> bool:
        """Wait for the answer to a request that is in progress, or for data that a device sends by itself. Return True
        if the number of spoiled answers is now greater than `spoiled`."""
        self.settle()
        end = monotonic() + MAX_LATENESS
        while self.spoiled == spoiled and self._is_awaited and monotonic() < end:
            sleep(ANSWER_GAP)
        return self.spoiled > spoiled

    @property
    def _is_awaited(self) -> bool:
        """True if something must come from the device."""
        return any(each.request or self._speaks for each in tuple(self._open))

    @contextmanager
    def gone(self) -> Iterator[None]:
        """Return a context in which the device is away: its connections end, and it accepts no new ones."""
        self._go()
        try:
            yield
        finally:
            self._return()

    @contextmanager
    def unreachable(self, seconds: float | None = None) -> Iterator[bool]:
        """Return a context in which nothing answers a request to connect, as if a cable were cut, for the duration of
        the context or for a time in s. The context yields False if this kind of line cannot do so."""
        yield False

    @property
    def passes(self) -> bool:
        """True if all data pass unchanged."""
        return self._mode is PASSING and not self._gone

    def heal(self) -> None:
        """End every disturbance that was requested, and close the connections."""
        with self._lock:
            self._mode = PASSING
            with suppress(OSError):  # the device is not there
                self._return()
            self.drop()

    @contextmanager
    def _in(self, mode: AnswerMode, at_end: Callable[[Tapped], None] = lambda tapped: None) -> Iterator[None]:
        """Return a context in which answers are treated in this mode. At its end `at_end` is called for each
        connection, before any other data pass."""
        with self._lock:
            for each in tuple(self._open):
                if each.due is None:
                    self._finish(each)  # it has passed already
            before, self._mode = self._mode, mode
        self._nudge()
        try:
            yield
        finally:
            with self._lock:
                self._mode = before
                for each in tuple(self._open):
                    at_end(each)

    def _go(self) -> None:
        with self._lock:
            self._gone = True
            self._vanish()
            self.drop()
            self.disturbed = "the absence of the device"

    def _return(self) -> None:
        with self._lock:
            if self._gone:
                self._gone = False
                self._appear()
