"""The end of a program in which machines are still connected: before the program ends, the outputs of these machines
are brought to their defaults.

At the end of the program Python freezes the remaining threads, that is, daemon threads and threads that were not
joined, wherever they are. Before this happens, a machine in such a thread is requested to stop, and disconnects in its
thread. The main thread resets a machine that does not disconnect in time, and a machine that the main thread itself has
not disconnected.
"""

from __future__ import annotations

import atexit
import os
import signal
import threading
from collections.abc import Callable, Sequence
from time import monotonic, sleep

from umo.cycle.stopping import StopFlag, connected, in_main_thread, usual_handler
from umo.errors import DeclarationError
from umo.system.signal_handling import SIGNALS, signal_name
from umo.system.streams import say_without_waiting
from umo.text import printable, some

STOPPING_TIMEOUT = 10.0
"""Time in s within which a machine must begin to disconnect, in addition to the time limit of a call."""
LEAVING_TIMEOUT = 60.0
"""The time in s within which a machine must have disconnected after it has begun to disconnect."""
LOOK_INTERVAL = 0.005
"""The time in s between two checks."""


def end_machines() -> None:
    """Stop the machines of this process that are still connected, and wait for their resets."""
    machines = [flag for flag in connected() if flag.pid == os.getpid()]
    threads = [flag for flag in machines if not flag.is_of_main_thread]
    for flag in threads:
        flag.request()
    try:
        for flag in threads:
            _wait_for(flag)
    except BaseException:  # a further signal: nothing is waited for any more
        pass
    for flag in machines:
        if flag in connected():
            _leave(flag)


def _wait_for(flag: StopFlag) -> None:
    begun = monotonic()
    while flag in connected() and flag.thread.is_alive():
        if monotonic() - begun > (LEAVING_TIMEOUT if flag.is_leaving else STOPPING_TIMEOUT + flag.call_limit()):
            return
        sleep(LOOK_INTERVAL)


def _leave(flag: StopFlag) -> None:
    """Reset a machine from this thread. Nothing that the machine's own thread does afterwards reaches a device."""
    left: Sequence[str]
    try:
        left = flag.leave_at_once()
    except BaseException as error:
        left = [f"all outputs of a machine ({type(error).__name__})"]
    flag.restore()
    end = f"not reached: {some(left)}" if left else "every actuator is at its default"
    say_without_waiting(printable(f"umo: the program has ended while {flag.title} was connected; {end}"))


def check_thread(has_devices: bool, handler: Callable[[int], object] = usual_handler) -> None:
    """Check the thread. Raises DeclarationError if a machine with devices would be connected in a thread other than the
    main thread while a signal would end the program without a reset."""
    if in_main_thread() or not has_devices:
        return
    if deadly := [signal_name(number) for number in SIGNALS if handler(number) is signal.SIG_DFL]:
        raise DeclarationError(
            f"in thread {threading.current_thread().name!r}: {' and '.join(deadly)} would end this program and leave "
            f"the outputs as they are, because Python handles signals only in the main thread; write in the main "
            f"thread, before this thread is started: signal.signal(signal.{deadly[0]}, signal.default_int_handler)"
            f"{' for each signal' if len(deadly) > 1 else ''}; or use umo.start, which has a guardian"
        )


atexit.register(end_machines)
