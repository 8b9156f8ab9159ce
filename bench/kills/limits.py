"""Taking processes and descriptors away from a running process."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from time import sleep

HIERARCHIES = (Path("/sys/fs/cgroup/pids"), Path("/sys/fs/cgroup"))
"""Folders in which groups of processes are made: cgroup v1, v2."""


@cache
def group_place() -> Path | None:
    """Folder in which a group with `pids.max` can be made; None where that is not permitted."""
    for place in HIERARCHIES:
        probe = place / f"umo-kills-{os.getpid()}-probe"
        try:
            probe.mkdir()
        except OSError:
            continue
        found = (probe / "pids.max").exists()
        probe.rmdir()
        if found:
            return place
    return None


def can_take_processes() -> bool:
    """Whether `no_more_processes` works here: by a group, or, for who is not root, by a limit of the user's."""
    return group_place() is not None or os.getuid() != 0


@contextmanager
def no_more_processes(pid: int) -> Iterator[None]:
    """While the block lasts, `pid` cannot fork."""
    place = group_place()
    if place is None:
        before = resource.prlimit(pid, resource.RLIMIT_NPROC, (1, resource.getrlimit(resource.RLIMIT_NPROC)[1]))
        yield
        with suppress(ProcessLookupError):
            resource.prlimit(pid, resource.RLIMIT_NPROC, before)
        return
    group = place / f"umo-kills-{os.getpid()}-{pid}"
    group.mkdir()
    (group / "cgroup.procs").write_text(str(pid))
    (group / "pids.max").write_text("1")
    try:
        yield
    finally:
        (group / "pids.max").write_text("max")
        _dissolve(group, place)


def _dissolve(group: Path, place: Path) -> None:
    for _ in range(100):
        for pid in (group / "cgroup.procs").read_text().split():
            with suppress(OSError):
                (place / "cgroup.procs").write_text(pid)
        with suppress(OSError):
            group.rmdir()
            return
        sleep(0.01)


def descriptors_left(pid: int, count: int) -> None:
    """From now on `pid` can open `count` files more."""
    used = {int(name) for name in os.listdir(f"/proc/{pid}/fd")}
    limit = free = 0
    while free < count or limit in used:
        free += limit not in used
        limit += 1
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (limit, resource.prlimit(pid, resource.RLIMIT_NOFILE)[1]))
