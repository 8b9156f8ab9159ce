"""Taps: each stands between a driver and its device, passes everything on, and spoils answers when it is told to.

A tap knows no protocol. In a mode that spoils, an answer is what comes from the device until nothing more has come for
`QUIET` s.
"""

from __future__ import annotations

import os
import selectors
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic, sleep
from types import TracebackType
from typing import Self

QUIET = 0.005
PIECE = 0.003
"""s between the pieces of an answer."""
LAST = 0.5
"""s in which an answer that is to be late must have come."""
SETTLE = 5.0
"""s that the thread of a tap is waited for."""
KEPT = 64
"""Exchanges that are remembered."""
SIZE = 65536

Change = Callable[[bytes], bytes]
"""Makes what the driver gets out of what the device answered; nothing: no answer."""


class Traffic:
    """The bytes that passed a tap in both directions within a block."""

    def __init__(self) -> None:
        self.requests: list[bytes] = []
        """Pieces that the driver sent: each is what was there when the tap looked."""
        self.answer = b""
        """What the device sent."""

    @property
    def asked(self) -> int:
        """Bytes that the driver sent."""
        return sum(map(len, self.requests))


class Tapped:
    """A driver and its device: two descriptors, and the present exchange."""

    def __init__(self, driver: int, device: int) -> None:
        self.driver, self.device = driver, device
        self.request, self.answer = b"", b""
        self.held = b""
        """Late answers."""
        self.due: float | None = None
        """When the answer counts as complete."""
        self.trickle = b""
        """The rest of an answer that is delivered byte by byte."""
        self.next = 0.0
        """When the next byte of it is due."""


class Tap(ABC):
    """Base of the taps. One thread moves the bytes.

    with TcpTap("127.0.0.1", 502) as tap:
        driver = Modbus(host=tap.host, port=tap.port)
        ...
        with tap.silent():
            driver.read(channel)  # times out
    """

    ordered = True
    """Whether a connection that the driver opens again begins without what was sent to the one before."""

    def __init__(self) -> None:
        self.exchanges: deque[tuple[bytes, bytes]] = deque(maxlen=KEPT)
        """The last requests, each with what the device answered."""
        self.connections = 0
        """Connections that a driver has made so far."""
        self.spoiled = 0
        """Answers that were spoiled so far."""
        self.missing = ""
        """Why the device could not be reached when a driver connected last; empty if it could."""
        self._traffic: Traffic | None = None
        self._change: Change | None = None
        self._hangup = self._holding = False
        self._endless = self._step = 0.0
        self._splitting = self._gone = False
        self._open: list[Tapped] = []
        self._lock = threading.RLock()
        self._selector = selectors.DefaultSelector()
        self._wake, self._waker = os.pipe()
        self._selector.register(self._wake, selectors.EVENT_READ)
        self._end = False
        self._asked = self._settled = 0
        """How often it was asked to settle, and up to which of these it has."""
        self._turn = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="umo tap", daemon=True)

    def __enter__(self) -> Self:
        self._appear()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end = True
        self._nudge()
        self._thread.join()
        self._vanish()
        self.drop()
        self._selector.close()
        os.close(self._wake)
        os.close(self._waker)

    # What a rule asks for ----------------------------------------------------------------------------

    @contextmanager
    def spoiling(self, change: Change, *, hangup: bool = False) -> Iterator[None]:
        """Each answer is changed; `hangup`: then the connection is closed."""
        with self._lock:
            self._change, self._hangup = change, hangup
        try:
            yield
        finally:
            with self._lock:
                self._change, self._hangup = None, False

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Requests reach the device, answers get lost."""
        with self.spoiling(lambda answer: b""):
            yield

    @contextmanager
    def late(self, *, behind: bool = False) -> Iterator[None]:
        """Answers within the block are delivered at its end; `behind`: with the answer to the request after it."""
        with self._lock:
            self._holding = True
        spoiled = self.spoiled
        try:
            yield
            self.await_answer(spoiled)
        finally:
            with self._lock:
                self._holding = False
                for each in self._open:
                    self._finish(each, holding=True)
                    if not behind:
                        self._put(each, each.driver, each.held)
                        each.held = b""

    @contextmanager
    def split(self) -> Iterator[None]:
        """Each answer comes in three pieces."""
        with self._lock:
            self._splitting = True
        try:
            yield
        finally:
            with self._lock:
                self._splitting = False

    @contextmanager
    def trickling(self, step: float) -> Iterator[None]:
        """Each answer comes byte by byte, one every `step` s. What is left at the end comes at once."""
        with self._lock:
            self._step = step
        try:
            yield
        finally:
            with self._lock:
                self._step = 0.0
                for each in tuple(self._open):
                    self._put(each, each.driver, each.trickle)
                    each.trickle = b""

    @contextmanager
    def counting(self, answers: bool = False) -> Iterator[Traffic]:
        """What passes within the block; `answers`: an answer that comes after it counts too."""
        traffic, spoiled = Traffic(), self.spoiled
        with self._lock:
            self._traffic = traffic
        try:
            yield traffic
            self.settle()
            end = monotonic() + LAST
            while answers and traffic.asked and not traffic.answer and self.spoiled == spoiled and monotonic() < end:
                sleep(QUIET)
        finally:
            with self._lock:
                self._traffic = None

    def await_answer(self, spoiled: int) -> bool:
        """Waits for the answer to a request that is under way; whether one was spoiled since `spoiled` was counted."""
        self.settle()
        end = monotonic() + LAST
        while self.spoiled == spoiled and any(each.request for each in tuple(self._open)) and monotonic() < end:
            sleep(QUIET)
        return self.spoiled > spoiled

    @contextmanager
    def endless(self, step: float = 0.001) -> Iterator[None]:
        """In place of an answer, bytes come without an end, one every `step` s."""
        self._endless = step
        self._nudge()
        try:
            yield
        finally:
            self._endless = 0.0

    @contextmanager
    def gone(self) -> Iterator[None]:
        """The device is away: its connections end, and it takes no new ones."""
        self._go()
        try:
            yield
        finally:
            self._return()

    @contextmanager
    def unreachable(self) -> Iterator[bool]:
        """Nothing answers a request to connect, as if a cable were cut; False if this kind of line cannot do so."""
        yield False

    def drop(self) -> None:
        """The device ends its connections. It takes new ones at once."""
        with self._lock:
            for each in tuple(self._open):
                self._close(each)

    def heal(self) -> None:
        """Whatever was asked for ends, and so do the connections."""
        with self._lock:
            self._change, self._hangup, self._holding, self._endless = None, False, False, 0.0
            self._splitting, self._step = False, 0.0
            with suppress(OSError):  # the device is not there
                self._return()
            self.drop()

    def settle(self) -> None:
        """Returns when everything has been dealt with that waits now."""
        with self._turn:
            self._asked = asked = self._asked + 1
            self._nudge()
            self._turn.wait_for(lambda: self._settled >= asked, SETTLE)

    @property
    def descriptors(self) -> int:
        """Open descriptors of the connections."""
        return 2 * len(self._open)

    # What the kinds of taps differ in ----------------------------------------------------------------

    @abstractmethod
    def _appear(self) -> None:
        """Begin to take connections."""

    @abstractmethod
    def _vanish(self) -> None:
        """Take no connections any more."""

    def _accept(self) -> None:
        """A connection waits to be taken."""
        raise NotImplementedError

    def _mirror(self, tapped: Tapped) -> None:
        """A request is about to be passed on."""
        return

    # Within ------------------------------------------------------------------------------------------

    def _go(self) -> None:
        with self._lock:
            self._gone = True
            self._vanish()
            self.drop()

    def _return(self) -> None:
        with self._lock:
            if self._gone:
                self._gone = False
                self._appear()

    def _work(self) -> None:
        while not self._end:
            asked = self._asked  # before the look: whatever happened before it was asked is seen
            ready = self._selector.select(self._pause() if self._settled == asked else 0)
            with self._lock:
                for key, _ in ready:
                    if self._selector.get_map().get(key.fd) is key:  # else closed since, and perhaps used again
                        self._serve(key.fd)
                self._look()
            with self._turn:
                self._settled = asked
                self._turn.notify_all()

    def _pause(self) -> float | None:
        if self._endless:
            return self._endless
        dues = [each.due for each in tuple(self._open) if each.due is not None]
        dues += [each.next for each in tuple(self._open) if each.trickle]
        return max(0.0, min(dues) - monotonic()) if dues else None

    def _nudge(self) -> None:
        os.write(self._waker, b"!")

    def _serve(self, ready: int) -> None:
        if ready == self._wake:
            os.read(ready, SIZE)
            return
        tapped = next((each for each in self._open if ready in (each.driver, each.device)), None)
        if tapped is None:
            self._accept()
            return
        try:
            data = os.read(ready, SIZE)
        except OSError:
            data = b""
        if not data:
            self._close(tapped)
        elif ready == tapped.driver:
            self._requested(tapped, data)
        else:
            self._answered(tapped, data)

    def _requested(self, tapped: Tapped, data: bytes) -> None:
        if self._traffic is not None:
            self._traffic.requests.append(data)
        if tapped.answer:  # of the request before
            self._finish(tapped)
            tapped.request = b""
        tapped.request += data
        self._mirror(tapped)
        self._put(tapped, tapped.device, data)

    def _answered(self, tapped: Tapped, data: bytes) -> None:
        if self._traffic is not None:
            self._traffic.answer += data
        tapped.answer += data
        spoils = self._change or self._holding or self._endless or self._splitting or self._step
        if spoils or tapped.due is not None:
            tapped.due = monotonic() + QUIET
            return
        self._put(tapped, tapped.driver, tapped.held + data)
        tapped.held = b""

    def _look(self) -> None:
        now = monotonic()
        for each in tuple(self._open):
            if each.due is not None and now >= each.due:
                self._finish(each)
            if self._endless and each.request:
                self._put(each, each.driver, b"\xff")
            if each.trickle and now >= each.next:
                byte, each.trickle, each.next = each.trickle[:1], each.trickle[1:], now + self._step
                self._put(each, each.driver, byte)

    def _finish(self, tapped: Tapped, holding: bool = False) -> None:
        """The answer is complete."""
        answer, spoils = tapped.answer, tapped.due is not None
        if not answer:
            return
        tapped.due, tapped.answer = None, b""
        self.exchanges.append((tapped.request, answer))
        tapped.request = b"" if not self._endless else tapped.request
        if spoils:
            self._spoil(tapped, answer, holding)

    def _spoil(self, tapped: Tapped, answer: bytes, holding: bool) -> None:
        """An answer that a change leaves as it was does not count as spoiled."""
        changed = self._change(answer) if self._change is not None and not self._holding and not holding else None
        self.spoiled += changed != answer
        if self._holding or holding:
            tapped.held += answer
        elif changed is not None:
            self._put(tapped, tapped.driver, tapped.held + changed)
            tapped.held = b""
            if self._hangup:
                self._close(tapped)
        elif self._step:
            tapped.trickle, tapped.next = answer, monotonic() + self._step
        elif self._splitting:
            for piece in (answer[:1], answer[1 : len(answer) // 2], answer[max(1, len(answer) // 2) :]):
                self._put(tapped, tapped.driver, piece)
                sleep(PIECE)
        elif not self._endless:  # it began before the mode ended
            self._put(tapped, tapped.driver, answer)

    def _put(self, tapped: Tapped, to: int, data: bytes) -> None:
        try:
            while data:
                data = data[os.write(to, data) :]
        except OSError:
            self._close(tapped)

    def _add(self, driver: int, device: int) -> None:
        self._open.append(Tapped(driver, device))
        for each in (driver, device):
            self._selector.register(each, selectors.EVENT_READ)

    def _close(self, tapped: Tapped) -> None:
        if tapped not in self._open:
            return
        self._open.remove(tapped)
        for each in (tapped.driver, tapped.device):
            with suppress(KeyError):
                self._selector.unregister(each)
            os.close(each)
