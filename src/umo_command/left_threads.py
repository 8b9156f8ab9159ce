"""Ends a command whose application has left threads. Python waits silently for threads that are not daemons."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType
from typing import NoReturn

from umo.cycle.insisting import place_within
from umo.system.processes import flush
from umo.system.signal_handling import SIGNALS
from umo.system.streams import say_without_waiting
from umo.text import in_brackets, printable, some

THREAD_TIMEOUT = 1.0
"""Time in s after which a notice says that the command waits for threads. Threads of executors end by themselves before
that."""


def prepare_end(status: int) -> None:
    """End this process with this status, after its machine has been reset. If the process then waits for threads, the
    threads are printed once with their places. A signal ends the process."""
    if not left_threads():
        return

    def end(number: int, frame: FrameType | None) -> NoReturn:
        flush()
        os._exit(status or 128 + number)

    for number in SIGNALS:
        signal.signal(number, end)
    threading.Thread(target=tell_threads, name="umo end", daemon=True).start()


def left_threads() -> list[threading.Thread]:
    """Return the threads that keep this process from ending."""
    threads = [each for each in threading.enumerate() if each is not threading.main_thread() and not each.daemon]
    return [each for each in threads if each.is_alive()]


def tell_threads(patience: float = THREAD_TIMEOUT) -> None:
    """Print the threads that still run after this time in s, if any."""
    threading.Event().wait(patience)
    if left := left_threads():
        frames = sys._current_frames()
        names = [f"{each.name}{in_brackets(place_within(frames.get(each.ident or 0), None))}" for each in left]
        what = "a thread" if len(left) == 1 else f"{len(left)} threads"
        text = (
            f"umo: the command is done, but {what} of the application still {'runs' if len(left) == 1 else 'run'}: "
            f"{some(names)}; Ctrl-C ends the command"
        )
        say_without_waiting(printable(text))
