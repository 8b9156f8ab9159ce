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

TASKS = Path("/proc/self/task")


def threads() -> dict[int, tuple[float, float]]:
    """For each thread of the process: s that it has run, and that it was kept waiting for a processor."""
    found = {}
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError, ValueError):
                ran, kept, _ = (TASKS / task / "schedstat").read_text().split()
                found[int(task)] = int(ran) * 1e-9, int(kept) * 1e-9
    return found


def state() -> dict[str, object]:
    """What a driver has no business with."""
    return {
        "working directory": os.getcwd(),
        "default timeout of sockets": socket.getdefaulttimeout(),
        "interval of thread switches": sys.getswitchinterval(),
        "recursion limit": sys.getrecursionlimit(),
        "number of child processes": _children(),
        "environment": " ".join(sorted(os.environ)),
        "number of handlers of the root logger": len(logging.getLogger().handlers),
        "locale": locale.setlocale(locale.LC_ALL),
        "processors and priority": _scheduling(),
    } | {f"handler of {number.name}": signal.getsignal(number) for number in signal.valid_signals() if _named(number)}


def _named(number: object) -> bool:
    return isinstance(number, signal.Signals)


def _scheduling() -> str:
    """Of this thread."""
    processors = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else ""
    return f"{processors} {os.getpriority(os.PRIO_PROCESS, 0)}" if hasattr(os, "getpriority") else str(processors)


def _children() -> int:
    count = 0
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError):
                count += len((TASKS / task / "children").read_text().split())
    return count
