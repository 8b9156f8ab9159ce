"""The process in which a driver runs: its threads and their processor time, and what a driver has no business with."""

from __future__ import annotations

import locale
import logging
import os
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path

from umo.text import some

TASKS = Path("/proc/self/task")


def threads() -> dict[int, tuple[float, float]]:
    """Times in s that each thread of the process has run, and that it was kept waiting for a processor."""
    found = {}
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError, ValueError):
                ran, kept, _ = (TASKS / task / "schedstat").read_text().split()
                found[int(task)] = int(ran) * 1e-9, int(kept) * 1e-9
    return found


State = dict[str, object]
"""Settings of a process that a driver has no business with, by name."""


def change(before: State, now: State) -> str:
    """The first difference between two states, in words; empty if there is none. Values of the environment are not
    told: some are secret."""
    for what, value in now.items():
        if value != before[what]:
            if not isinstance(value, dict):
                return f"the {what} from {before[what]} to {value}"
            names = {name for name, _ in value.items() ^ before[what].items()}  # type: ignore[attr-defined]
            return f"the {what}: {some(sorted(names))}"
    return ""


def state() -> State:
    """The present one, as this thread has it."""
    return {
        "working directory": os.getcwd(),
        "default timeout of sockets": socket.getdefaulttimeout(),
        "interval of thread switches": sys.getswitchinterval(),
        "recursion limit": sys.getrecursionlimit(),
        "number of child processes": _children(),
        "environment": dict(os.environ),
        "number of handlers of the root logger": len(logging.getLogger().handlers),
        "locale": locale.setlocale(locale.LC_ALL),
        "processors and priority": _scheduling(),
    } | {f"handler of {number.name}": signal.getsignal(number) for number in signal.Signals}


def _scheduling() -> str:
    """The processors and the priority of this thread."""
    processors = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else ""
    return f"{processors} {os.getpriority(os.PRIO_PROCESS, 0)}" if hasattr(os, "getpriority") else str(processors)


def _children() -> int:
    count = 0
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError):
                count += len((TASKS / task / "children").read_text().split())
    return count
