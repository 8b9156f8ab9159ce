"""Snapshots of the process in which a driver runs: its threads and their processor time, and settings that a driver
must not change."""

from __future__ import annotations

import builtins
import decimal
import gc
import locale
import logging
import multiprocessing
import os
import re
import select
import signal
import socket
import sys
import threading
import time
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np

from umo.text import some

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]

TASKS = Path("/proc/self/task")
STATUS = Path("/proc/self/status")
PATCHED = (builtins, os, select, signal, socket, threading, time)
"""Modules whose functions some libraries replace for the whole process."""
LIMITS = tuple(name for name in dir(resource) if name.startswith("RLIMIT_"))
TIMERS = tuple(name for name in dir(signal) if name.startswith("ITIMER_"))


def threads() -> dict[int, tuple[float, float]]:
    """Return, for each thread of the process, the time in s that it has run, and the time in s that it has waited for a
    processor."""
    found = {}
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError, ValueError):
                ran, kept, _ = (TASKS / task / "schedstat").read_text().split()
                found[int(task)] = int(ran) * 1e-9, int(kept) * 1e-9
    return found


State = dict[str, object]
"""Settings of a process that a driver must not change, by name."""


def change(before: State, now: State) -> str:
    """Return the first difference between two states as text, or an empty text if there is none. Values of the
    environment are not shown, because some are secret."""
    for what, value in now.items():
        if value != before[what]:
            if not isinstance(value, dict):
                return f"the {what} from {before[what]} to {value}"
            names = {name for name, _ in value.items() ^ before[what].items()}  # type: ignore[attr-defined]
            return f"the {what}: {some(sorted(names))}"
    return ""


def state() -> State:
    """Return the present state of the process, as this thread sees it."""
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
        "limits of the process": {name: resource.getrlimit(getattr(resource, name)) for name in LIMITS},
        "signals that are blocked": _blocked(),
        "timers of the process that run": [name for name in TIMERS if signal.getitimer(getattr(signal, name))[0]],
        "mask of new files": _umask(),
        "level of the root logger": logging.getLogger().level,
        "level up to which logging is off": logging.root.manager.disable,
        "filters of Python's own warnings": _filters(),
        "hooks for exceptions": {
            "sys.excepthook": sys.excepthook,
            "sys.unraisablehook": sys.unraisablehook,
            "threading.excepthook": threading.excepthook,
        },
        "automatic garbage collection": gc.isenabled(),
        "thresholds of the garbage collector": gc.get_threshold(),
        "places where modules are looked for": {"sys.path": tuple(sys.path)},  # not told: they are of the computer
        "digits that a text of an integer may have": sys.get_int_max_str_digits(),
        "time zone": [*time.tzname, time.timezone, time.altzone],
        "stack size of new threads": threading.stack_size(),
        "way in which processes are started": multiprocessing.get_start_method(allow_none=True),
        "form in which numpy prints": {name: str(value) for name, value in np.get_printoptions().items()},
        "functions of the standard library": _functions(),
    } | {f"handler of {number.name}": signal.getsignal(number) for number in signal.Signals}


def state_of_thread() -> State:
    """Return the state of each thread."""
    decimals = decimal.getcontext()
    return {
        "context of decimal numbers": {
            name: str(getattr(decimals, name))
            for name in ("prec", "rounding", "Emin", "Emax", "capitals", "clamp", "traps")
        },
        "errors of numpy": np.geterr(),
        "trace and profile functions": [sys.gettrace(), sys.getprofile()],
    }


def alarm_time() -> float | None:
    """Return the time (`monotonic`) at which the process gets a single SIGALRM. Return None if it gets none, or gets it
    repeatedly."""
    left, interval = signal.getitimer(signal.ITIMER_REAL) if TIMERS else (0.0, 0.0)
    return time.monotonic() + left if left and not interval else None


def _scheduling() -> str:
    """Return the processors and the priority of this thread as text."""
    processors = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else ""
    return f"{processors} {os.getpriority(os.PRIO_PROCESS, 0)}" if hasattr(os, "getpriority") else str(processors)


def _blocked() -> list[int]:
    return sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())) if hasattr(signal, "pthread_sigmask") else []


def _umask() -> str:
    """Return the mask of new files, read from the kernel, because `os.umask` would change it for a moment."""
    with suppress(OSError):
        found = re.search(r"^Umask:\s*(\d+)", STATUS.read_text(), re.MULTILINE)
        return found[1] if found else ""
    return ""


def _filters() -> list[str]:
    """Return the filters for classes of warnings of Python itself. Many libraries add one for a warning of their
    own."""
    return [
        f"{action} {category.__name__}"
        for action, message, category, module, _ in warnings.filters
        if message is None and module is None and isinstance(category, type) and category.__module__ == "builtins"
    ]


def _functions() -> dict[str, int]:
    return {
        f"{module.__name__}.{name}": id(value)
        for module in PATCHED
        for name, value in vars(module).items()
        if callable(value) and not name.startswith("_") and name != "excepthook"
    }


def _children() -> int:
    count = 0
    with suppress(OSError):
        for task in os.listdir(TASKS):
            with suppress(OSError):
                count += len((TASKS / task / "children").read_text().split())
    return count
