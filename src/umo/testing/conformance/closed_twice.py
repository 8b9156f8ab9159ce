"""Finds descriptors that are closed twice. At the second time the number may already belong to a descriptor of other
code, such as another driver."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress

try:
    import fcntl
    import resource
except ImportError:  # not on Windows
    fcntl = resource = None  # type: ignore[assignment]

OPEN = "/proc/self/fd"
KIT_DESCRIPTORS = 400
"""Lowest number of the kit's own descriptors. It is high because the kernel gives a driver the lowest free number."""


def out_of_the_way(descriptor: int) -> int:
    """Return the same file with a number that no driver has had, if the limits of the process allow it. This protects
    the kit against a driver that closes a descriptor twice."""
    if fcntl is None or resource.getrlimit(resource.RLIMIT_NOFILE)[0] <= 2 * KIT_DESCRIPTORS:
        return descriptor
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, KIT_DESCRIPTORS)
    os.close(descriptor)
    return moved


class Placeholders:
    """Open files that occupy each descriptor number that becomes free after a call. If one of these files is closed
    later, the driver has closed a descriptor of this number twice."""

    def __init__(self) -> None:
        self.closed_by = ""
        """The first call that closed a placeholder; empty if no call did."""
        self._held: set[int] = set()
        self._null = os.stat(os.devnull)
        self._before = set(_numbers())
        self._highest = -1
        """The highest descriptor number that has been in use so far."""

    def look(self, call: str) -> None:
        """Look for closed placeholders. This is called after each call of the driver."""
        for number in [each for each in self._held if not self._is_there(each)]:
            self._held.discard(number)
            self.closed_by = self.closed_by or call
        self._highest = max({self._highest, *_numbers()} - self._before)
        while (number := os.open(os.devnull, os.O_RDONLY)) <= self._highest:
            self._held.add(number)
        os.close(number)

    def release(self) -> None:
        for number in self._held:
            with suppress(OSError):
                os.close(number)

    def _is_there(self, number: int) -> bool:
        with suppress(OSError):
            return os.path.samestat(os.fstat(number), self._null)
        return False


def _numbers() -> Iterator[int]:
    """Numbers of the descriptors that are open, without the kit's own."""
    try:
        listed = [number for number in map(int, os.listdir(OPEN)) if number < KIT_DESCRIPTORS]
    except OSError:
        return
    for number in listed:
        with suppress(OSError):  # the descriptor by which they were listed is closed again
            os.fstat(number)
            yield number
