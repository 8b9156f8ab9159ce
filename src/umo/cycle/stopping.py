"""SIGINT, SIGTERM and SIGHUP set a flag that is read between periods; they never raise inside a driver call."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

from umo.cycle.frame import Frame

SIGNALS = [signal.SIGINT, signal.SIGTERM]
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # ignored: under nohup
    SIGNALS.append(signal.SIGHUP)  # the terminal was closed


def signal_name(number: int) -> str:
    """Such as SIGTERM."""
    try:
        return signal.Signals(number).name
    except ValueError:  # the real-time signals have numbers alone
        return f"signal {number}"


_flags: dict[StopFlag, bool] = {}  # every connected machine's, and whether it was connected in the main thread
_before: dict[int, Any] = {}  # the handlers from before the first of those


class StopFlag:
    """`requested` becomes true at the first signal; further ones change nothing, so resetting is not interrupted.

    One signal stops every machine of the process. Python handles signals in the main thread alone: while no
    machine was connected there, the flags are only set by `request`.
    """

    def __init__(self) -> None:
        self.requested = False
        self.signal: int | None = None
        self.time_over = False
        """Whether a `TimeLimit` has requested it."""
        self.end_wait: Callable[[], object] = lambda: None
        """Function that is called at each request: the machine's timer does not wait any longer."""

    def install(self) -> None:
        """Start listening."""
        self.requested, self.signal, self.time_over = False, None, False
        _flags[self] = _in_main_thread()
        if _flags[self] and not _before:
            _before.update({number: signal.signal(number, _caught) for number in SIGNALS})

    def restore(self) -> None:
        """Stop listening. The last machine that disconnects restores the signal handlers."""
        _flags.pop(self, None)
        if _in_main_thread() and not any(_flags.values()):
            while _before:
                number, handler = _before.popitem()
                signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def request(self, number: int | None = None) -> None:
        self.signal = self.signal or number
        self.requested = True
        self.end_wait()


class TimeLimit:
    """An observer that asks the machine to stop at a time on its clock, in s."""

    def __init__(self, seconds: float, stop: StopFlag) -> None:
        self._seconds = seconds
        self._stop = stop

    def __call__(self, frame: Frame) -> None:
        if frame.time >= self._seconds and not self._stop.requested:
            self._stop.time_over = True
            self._stop.request()


def request_stop(number: int | None = None) -> None:
    """Ask every connected machine of this process to stop, as a signal does."""
    for flag in tuple(_flags):
        flag.request(number)


def _caught(number: int, frame: FrameType | None) -> None:
    request_stop(number)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
