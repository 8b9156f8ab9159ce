"""SIGINT, SIGTERM and SIGHUP set a flag that is read between periods. A further signal ends code that does not end by
itself (`insisting`)."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

from umo.cycle.frame import Frame
from umo.cycle.insisting import SignalledMachine, StopSignals
from umo.errors import Interrupted
from umo.system.signal_handling import SIGNALS, handling, signal_name
from umo.system.streams import say_without_waiting

_flags: dict[StopFlag, None] = {}  # every connected machine's
_before: dict[int, Any] = {}  # the handlers from before the first of those
_insistence: list[StopSignals] = []  # one, from the first signal to the end of the last machine


class StopFlag:
    """The request to stop: `requested` becomes true at the first signal. Further signals end user code that does not
    end by itself; they do not interrupt a reset.

    One signal stops every machine of the process. Python handles signals only in the main thread. So while no machine
    is connected in the main thread, only `request` sets the flags.
    """

    def __init__(self) -> None:
        self.requested = False
        self.signal: int | None = None
        self._to_come = {"first signal": True}
        self.title = "a machine"
        """The name of the machine in messages."""
        self.pid = 0
        """The id of the process in which the machine is connected."""
        self.thread: threading.Thread = threading.main_thread()
        """The thread in which the machine is connected."""
        self.is_leaving = False
        """True if the machine's actuators are being reset at its end."""
        self.time_over = False
        """True if a `TimeLimit` has requested the stop."""
        self.end_wait: Callable[[], object] = lambda: None
        """Function that is called at each request, and ends the wait of the machine's timer."""
        self.insists = True
        """True if further signals end code that does not end by itself. False if a guardian does this for its control
        process."""
        self.call_limit: Callable[[], float] = lambda: 0.0
        """Time in s after which a call of one of the machine's drivers counts as hanging."""
        self.leave_at_once: Callable[[], Sequence[str]] = lambda: ()
        """Function that brings the machine's outputs to their defaults in the middle of the user's code, and returns
        the paths of those that were not reached."""
        self.stand_aside: Callable[[], object] = lambda: None
        """Function that is called in a process forked from this one, to which the machine does not belong."""

    def install(self) -> None:
        """Start handling signals."""
        self.requested, self.signal, self.time_over = False, None, False
        self._to_come = {"first signal": True}
        self.pid, self.thread, self.is_leaving = os.getpid(), threading.current_thread(), False
        _flags[self] = None
        if self.is_of_main_thread and not _before:
            _before.update({number: signal.signal(number, _caught) for number in SIGNALS})

    def restore(self) -> None:
        """Stop handling signals. The last machine that disconnects restores the signal handlers."""
        _flags.pop(self, None)
        if in_main_thread() and not any(flag.is_of_main_thread for flag in connected()):
            _insistence.clear()
            while _before:
                number, handler = _before.popitem()
                signal.signal(number, signal.SIG_DFL if handler is None else handler)

    @property
    def is_of_main_thread(self) -> bool:
        """True if the machine is connected in the main thread."""
        return self.thread is threading.main_thread()

    def is_first_signal(self) -> bool:
        """Return True if this is the first signal of the operating system; the result is therefore True only once. The
        check is a single step that a signal cannot divide, because a signal may interrupt the handler of another
        signal."""
        return self._to_come.pop("first signal", False)

    def request(self, number: int | None = None) -> None:
        self.signal = self.signal or number
        self.requested = True
        self.end_wait()


class TimeLimit:
    """An observer that requests the machine to stop at a time on its clock, in s."""

    def __init__(self, seconds: float, stop: StopFlag) -> None:
        self._seconds = seconds
        self._stop = stop

    def __call__(self, frame: Frame) -> None:
        if frame.time >= self._seconds and not self._stop.requested:
            self._stop.time_over = True
            self._stop.request()


def request_stop(number: int | None = None) -> None:
    """Request every connected machine of this process to stop, as a signal does."""
    for flag in connected():
        flag.request(number)


def connected() -> tuple[StopFlag, ...]:
    """Return the stop flags of the machines that are connected in this process, in any thread."""
    return tuple(_flags)


def end_forked(title: str) -> NoReturn:
    """End a process that the user's code has forked, when the process is about to use a device of the machine with this
    title."""
    say_without_waiting(
        f"umo: {title}: control code forked process {os.getpid()}, which was ended because it tried to drive the "
        "machine too; start programs with subprocess"
    )
    os._exit(1)


def _stand_aside() -> None:
    for flag in connected():
        flag.stand_aside()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_stand_aside)


def usual_handler(number: int) -> object:
    """Return the handler of a signal while no machine is connected."""
    return _before.get(number, signal.getsignal(number))


def _caught(number: int, frame: FrameType | None) -> None:
    found = [flag for flag in connected() if flag.is_of_main_thread]
    first = [flag.is_first_signal() for flag in found]
    request_stop(number)
    insists = all(flag.insists for flag in found)
    machines = [SignalledMachine(flag.call_limit(), flag.leave_at_once) for flag in found] if insists else []
    if any(first):
        _insistence[:] = [StopSignals()]
        _insistence[0].begin(frame, machines)
    elif insists:
        if not _insistence:  # it has interrupted the handler of the first one
            _insistence.append(StopSignals())
        _insistence[0].insist(number, frame, machines)


@contextmanager
def raising_signals() -> Iterator[None]:
    """Return a context in which a signal that would end the program immediately raises `Interrupted` in the main
    thread, so that outputs driven by other threads can still be reset. In another thread nothing is changed."""
    deadly = [number for number in SIGNALS if signal.getsignal(number) is signal.SIG_DFL] if in_main_thread() else []
    with handling(_raise, deadly):
        yield


def _raise(number: int, frame: FrameType | None) -> None:
    raise Interrupted(signal_name(number), number)


def in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
