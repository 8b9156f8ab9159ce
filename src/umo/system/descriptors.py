"""A check that this process and the processes that it starts are permitted to open the number of files that a run in
real time needs."""

from __future__ import annotations

from collections.abc import Callable

from umo.errors import UmoError

NEEDED = 64
"""The number of descriptors for the processes of a run. Each process uses up to 50 (memory, locks, pipes, sockets of
the other processes), in addition to those that its drivers open."""

USUAL = 1024
"""The limit on open files on most systems."""


class TooFewDescriptors(UmoError, OSError):
    """A process may not open as many files as a run needs."""


def _limits() -> tuple[int, int]:
    import resource  # of Unix

    return resource.getrlimit(resource.RLIMIT_NOFILE)


def _set(soft: int, hard: int) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def ensure(limits: Callable[[], tuple[int, int]] = _limits, set_limits: Callable[[int, int], object] = _set) -> None:
    """Let this process open as many files as a run needs. Raises TooFewDescriptors, with advice, if the process is not
    permitted to raise its limit so far. A limit below 0 means no limit."""
    soft, hard = limits()
    if soft < 0 or soft >= NEEDED:
        return
    if 0 <= hard < NEEDED:
        raise TooFewDescriptors(
            f"a run in real time needs {NEEDED} open files in a process, and more for drivers with many connections; "
            f"{soft} are allowed here: run `ulimit -n {USUAL}` in a new terminal, and start the run there (for a "
            f"service set LimitNOFILE={USUAL})"
        )
    set_limits(USUAL if hard < 0 else min(USUAL, hard), hard)
