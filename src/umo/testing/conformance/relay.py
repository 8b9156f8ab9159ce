"""Passes bytes between a driver and its device, in a thread, and spoils answers.

It does not depend on the protocol. In a mode that spoils answers, an answer consists of all bytes from the device until
none has arrived for `ANSWER_GAP` s. A device that sends by itself may never pause. An answer of such a device lasts at
most `LONGEST_ANSWER` s."""

from __future__ import annotations

import os
import selectors
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from time import monotonic, sleep
from typing import Self

from umo.testing.conformance.closed_twice import out_of_the_way

ANSWER_GAP = 0.005
"""Time in s without a byte after which an answer has ended."""
LONGEST_ANSWER = 0.05
"""Longest time in s that an answer of a device that sends by itself lasts."""
PIECE_INTERVAL = 0.003
"""Time in s between the pieces of an answer."""
MAX_SETTLING_TIME = 5.0
"""Longest time in s to wait for the thread."""
KEPT_EXCHANGES = 64
MAX_RECEIVED = 65536
"""Largest number of bytes that are received in one read."""
Change = Callable[[bytes], bytes]
"""Function that turns the answer of the device into the answer that the driver receives. An empty result means no
answer."""


@dataclass(frozen=True)
class AnswerMode:
    """How answers are treated. By default they pass unchanged."""

    change: Change | None = None
    hangup: bool = False
    """True if the connection is closed after an answer that was changed."""
    reset: bool = False
    """True if the end of the connection is a reset, as from a device that has restarted."""
    holding: bool = False
    """True if answers are kept, to be delivered late."""
    splitting: bool = False
    """True if each answer arrives in four pieces. The first and the last piece have one byte each."""
    step: float = 0.0
    """Time in s between the bytes of an answer that trickles."""
    endless: float = 0.0
    """Time in s between the bytes of an endless stream that replaces the answer."""


PASSING, HOLDING = AnswerMode(), AnswerMode(holding=True)


class Traffic:
    """The bytes that passed a tap in both directions within a block."""

    def __init__(self) -> None:
        self.requests: list[bytes] = []
        """Pieces that the driver sent. A piece is the bytes that the tap found at one look."""
        self.answer = b""
        """Bytes that the device sent."""

    @property
    def asked(self) -> int:
        """Bytes that the driver sent."""
        return sum(map(len, self.requests))


class Tapped:
    """A connection between a driver and its device: two descriptors, and the present exchange."""

    def __init__(self, driver: int, device: int) -> None:
        self.driver, self.device = driver, device
        self.request, self.answer = b"", b""
        self.began = 0.0
        """Time at which the answer began."""
        self.held = b""
        """Answers that are kept to be delivered late."""
        self.due: float | None = None
        """Time at which the answer counts as complete."""
        self.trickle = b""
        """The rest of an answer that is delivered byte by byte."""
        self.next_due = 0.0
        """Time at which the next byte is due."""


class Relay(ABC):
    """The base class of the taps."""

    def __init__(self) -> None:
        self.exchanges: deque[tuple[bytes, bytes]] = deque(maxlen=KEPT_EXCHANGES)
        """The last requests, each with what the device answered."""
        self.connections = 0
        self.spoiled = 0
        self.missing = ""
        """Reason why the device could not be reached when a driver last connected; empty if it was reached."""
        self.disturbed = ""
        """The last disturbance as text, until a later call of the driver succeeds."""
        self._speaks = False
        """True if the device sends by itself, and not only a greeting."""
        self._traffic: Traffic | None = None
        self._mode = PASSING
        self._open: list[Tapped] = []
        self._lock = threading.RLock()
        self._selector = selectors.DefaultSelector()
        self._wake, self._waker = os.pipe()
        self._selector.register(self._wake, selectors.EVENT_READ)
        self._end = False
        self._asked_to_settle = self._settled = 0
        """Number of the last request to settle, and of the last one that was met."""
        self._turn = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="umo tap", daemon=True)

    def __enter__(self) -> Self:
        self._appear()
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end = True
        self._nudge()
        self._thread.join()
        self._vanish()
        self.drop()
        self._selector.close()
        os.close(self._wake)
        os.close(self._waker)

    def drop(self) -> None:
        """Act like a device that ends its connections. New connections are accepted immediately."""
        with self._lock:
            if self._open:
                self.disturbed = "a lost connection"
            for each in tuple(self._open):
                self._close(each)

    @property
    def open_connections(self) -> int:
        """Number of connections that neither side has ended."""
        return len(self._open)

    def settle(self) -> None:
        """Wait until everything that is pending now has been handled."""
        with self._turn:
            self._asked_to_settle = asked = self._asked_to_settle + 1
            self._nudge()
            self._turn.wait_for(lambda: self._settled >= asked, MAX_SETTLING_TIME)

    @property
    def descriptors(self) -> int:
        """The open descriptors of the connections."""
        return 2 * len(self._open)

    # What the kinds of taps differ in ----------------------------------------------------------------

    @abstractmethod
    def _appear(self) -> None:
        """Begin to accept connections."""

    @abstractmethod
    def _vanish(self) -> None:
        """Accept no more connections."""

    def _accept(self) -> None:
        """Accept a connection that is waiting."""
        raise NotImplementedError

    def _ended(self, tapped: Tapped, by: int) -> None:
        """Handle the end of a connection by the driver or by the device, whose descriptor is `by`."""
        self._close(tapped)

    def _mirror(self, tapped: Tapped) -> None:
        """Handle a request that is about to be passed on."""
        return

    def _reset(self, tapped: Tapped) -> None:
        """Reset the connection to the driver, if this kind of line can do so."""
        return

    # The thread --------------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._end:
            asked = self._asked_to_settle  # before the look: whatever happened before it was asked is seen
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
        if self._mode.endless:
            return self._mode.endless
        dues = [each.due for each in tuple(self._open) if each.due is not None]
        dues += [each.next_due for each in tuple(self._open) if each.trickle]
        return max(0.0, min(dues) - monotonic()) if dues else None

    def _nudge(self) -> None:
        os.write(self._waker, b"!")

    def _serve(self, ready: int) -> None:
        if ready == self._wake:
            os.read(ready, MAX_RECEIVED)
            return
        tapped = next((each for each in self._open if ready in (each.driver, each.device)), None)
        if tapped is None:
            self._accept()
            return
        try:
            data = os.read(ready, MAX_RECEIVED)
        except OSError:
            data = b""
        if not data:
            self._ended(tapped, ready)
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
        now = monotonic()
        tapped.began = tapped.began if tapped.answer else now
        self._speaks |= bool(tapped.answer) and not tapped.request
        tapped.answer += data
        if self._mode != PASSING or tapped.due is not None:
            tapped.due = min(now + ANSWER_GAP, tapped.began + LONGEST_ANSWER) if self._speaks else now + ANSWER_GAP
            return
        self._put(tapped, tapped.driver, tapped.held + data)
        tapped.held = b""

    def _look(self) -> None:
        now = monotonic()
        for each in tuple(self._open):
            if each.due is not None and now >= each.due:
                self._finish(each)
            if self._mode.endless and each.request:
                self._put(each, each.driver, b"\xff")
            if each.trickle and now >= each.next_due:
                byte, each.trickle, each.next_due = each.trickle[:1], each.trickle[1:], now + self._mode.step
                self._put(each, each.driver, byte)

    # Answers -----------------------------------------------------------------------------------------

    def _finish(self, tapped: Tapped, holding: bool = False) -> None:
        """Handle an answer that is complete."""
        answer, spoils = tapped.answer, tapped.due is not None
        if not answer:
            return
        tapped.due, tapped.answer = None, b""
        self.exchanges.append((tapped.request, answer))
        tapped.request = b"" if not self._mode.endless else tapped.request
        if spoils:
            self._spoil(tapped, answer, holding)

    def _spoil(self, tapped: Tapped, answer: bytes, holding: bool) -> None:
        """Spoil an answer. An answer that the change does not alter does not count as spoiled."""
        mode, began = HOLDING if holding else self._mode, monotonic()
        changed = mode.change(answer) if mode.change is not None else None
        self.spoiled += changed != answer
        if not mode.splitting and (changed != answer or monotonic() - began > ANSWER_GAP):
            self.disturbed = _words(answer, changed, mode)
        if mode.holding:
            tapped.held += answer
        elif changed is not None:
            self._put(tapped, tapped.driver, tapped.held + changed)
            tapped.held = b""
            if mode.hangup and changed != answer:
                if mode.reset:
                    self._reset(tapped)
                self._close(tapped)
        elif mode.step:
            tapped.trickle, tapped.next_due = answer, monotonic() + mode.step
        elif mode.splitting:
            ends = sorted({0, 1, len(answer) // 2, len(answer) - 1, len(answer)})
            for start, end in pairwise(ends):
                self._put(tapped, tapped.driver, answer[start:end])
                sleep(PIECE_INTERVAL)
        elif not mode.endless:  # it began before the mode ended
            self._put(tapped, tapped.driver, answer)

    def _put(self, tapped: Tapped, to: int, data: bytes) -> None:
        try:
            while data:
                data = data[os.write(to, data) :]
        except OSError:
            self._close(tapped)

    def _add(self, driver: int, device: int) -> None:
        tapped = Tapped(out_of_the_way(driver), out_of_the_way(device))
        self._open.append(tapped)
        for each in (tapped.driver, tapped.device):
            self._selector.register(each, selectors.EVENT_READ)

    def _close(self, tapped: Tapped) -> None:
        if tapped not in self._open:
            return
        self._open.remove(tapped)
        if tapped.answer:  # of a driver that connects for each call
            self.exchanges.append((tapped.request, tapped.answer))
        for each in (tapped.driver, tapped.device):
            with suppress(KeyError):
                self._selector.unregister(each)
            os.close(each)


def _words(answer: bytes, changed: bytes | None, mode: AnswerMode) -> str:
    """Return what happens to an answer, as text."""
    if changed is None:
        what = "an answer that came byte by byte" if mode.step else "a late answer"
    elif changed == answer:
        what = "a late answer"
    elif not changed:
        what = "a lost answer"
    else:
        what = "an answer that was cut short" if answer.startswith(changed) else "a garbled answer"
    return f"{what} and the end of the connection" if mode.hangup else what
