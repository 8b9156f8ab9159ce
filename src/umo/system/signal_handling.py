"""The signals that stop a program, and handlers of signals for a block of code."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

from umo.system import calls

Handler = Callable[[int, FrameType | None], object] | signal.Handlers

SIGNALS = [signal.SIGINT, signal.SIGTERM]
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # ignored: under nohup
    SIGNALS.append(signal.SIGHUP)  # the terminal was closed


def signal_name(number: int) -> str:
    """Return the name of a signal, such as SIGTERM."""
    try:
        return signal.Signals(number).name
    except ValueError:  # the real-time signals have numbers alone
        return f"signal {number}"


@contextmanager
def handling(handler: Handler, numbers: Iterable[int]) -> Iterator[None]:
    """Return a context in which this handler is called for each of these signals; with `signal.SIG_IGN` they are
    ignored. In a thread other than the main thread, Python raises ValueError."""
    before = {number: calls.handle_signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, former in before.items():
            calls.handle_signal(number, signal.SIG_DFL if former is None else former)
