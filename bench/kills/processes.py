"""Looking at processes through /proc, and ending those that one try has left behind."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

LOOK = 0.005
"""s between two looks."""


def alive(pid: int) -> bool:
    """Not gone, and more than a zombie."""
    return _status(pid)[0] not in "ZX"


def parent(pid: int) -> int:
    """0 where there is no such process any more."""
    return _status(pid)[1]


def _status(pid: int) -> tuple[str, int]:
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    except OSError:
        return "X", 0
    return fields[0].decode(), int(fields[1])


def children(pid: int) -> list[int]:
    """Living children, the oldest first."""
    return sorted(other for other in _pids() if parent(other) == pid and alive(other))


def child(pid: int, name: str) -> int:
    """The living child of this name; 0 if there is none."""
    return next((other for other in children(pid) if _name(other) == name), 0) if pid else 0


def _name(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/comm").read_text().strip()
    return ""


def marked(text: str) -> set[int]:
    """The living processes that have this text in their environment, whoever started them."""
    found = set()
    for pid in _pids():
        with suppress(OSError):
            if text.encode() in Path(f"/proc/{pid}/environ").read_bytes() and alive(pid):
                found.add(pid)
    return found


def _pids() -> Iterable[int]:
    return (int(name) for name in os.listdir("/proc") if name.isdigit())


def send(pid: int, number: int) -> None:
    """A signal to a process that may have ended meanwhile."""
    with suppress(ProcessLookupError):
        os.kill(pid, number)


def send_to_group(pid: int, number: int) -> None:
    """A signal to the group of a process."""
    with suppress(ProcessLookupError):
        os.killpg(os.getpgid(pid), number)


def end_marked(text: str) -> None:
    """Kill what is left of one try, each process by its id."""
    until = monotonic() + 5.0
    while (left := marked(text)) and monotonic() < until:
        for pid in left:
            send(pid, signal.SIGKILL)
        sleep(LOOK)
