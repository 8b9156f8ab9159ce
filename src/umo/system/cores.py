"""The cores of the computer, shared out among the control processes that run on it: each takes the one with the fewest
others.

A place on a core is taken by an abstract Unix socket of its name, as devices are held (`device_lock`): atomic, for every user
of the computer, and given back by the kernel at the latest when the last process that has it ends.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator

from umo.system.realtime import isolated_cores

SOCKET_NAME = "umo core"
MAX_PLACES = 16
"""Places on a core that are counted."""


class CorePlace:
    """A place on a core, taken for the control process of the process that makes this. `cpu` is the core asked for."""

    def __init__(self, cpu: int | None = None) -> None:
        self.core: int | None = cpu
        """None if no core is to be kept: there is only one."""
        self._socket: socket.socket | None = None
        for core, number in _places(cpu):
            taken = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            try:
                taken.bind(f"\0{SOCKET_NAME} {core} {number}".encode())
            except OSError:
                taken.close()
                continue
            self.core, self._socket = core, taken
            return

    def release(self) -> None:
        """Give it back. (A process that was forked keeps it until it ends or gives it back too.)"""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _places(cpu: int | None) -> Iterator[tuple[int, int]]:
    """Cores and places on them in the order of trying: empty cores first, of these the isolated ones, then the last."""
    allowed, isolated = os.sched_getaffinity(0), set(isolated_cores())
    if cpu is None and len(allowed) < 2:
        return
    cores = sorted(allowed, key=lambda core: (core in isolated, core), reverse=True) if cpu is None else [cpu]
    for number in range(MAX_PLACES):
        for core in cores:
            yield core, number
