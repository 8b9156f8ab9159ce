"""The functions of the module `time` on the clock of a world: to be put in place before umo is imported, as parts of it
keep them (the cycle, drivers off the cycle)."""

from __future__ import annotations

import time
from collections.abc import Callable

WALL_CLOCK = 1_700_000_000 * 10**9
"""ns since 1970 when the clock of a world shows 0."""


def install(now: Callable[[], int], sleep: Callable[[float], None]) -> None:
    """`now` in ns; `sleep` in s."""

    def seconds() -> float:
        return now() * 1e-9

    def wall_ns() -> int:
        return WALL_CLOCK + now()

    def clock_ns(clock: int) -> int:
        return wall_ns() if clock == time.CLOCK_REALTIME else now()

    replaced: dict[str, Callable[..., object]] = {
        "monotonic": seconds,
        "monotonic_ns": now,
        "perf_counter": seconds,
        "perf_counter_ns": now,
        "thread_time_ns": lambda: 0,
        "time": lambda: wall_ns() * 1e-9,
        "time_ns": wall_ns,
        "clock_gettime_ns": clock_ns,
        "clock_gettime": lambda clock: clock_ns(clock) * 1e-9,
        "sleep": sleep,
    }
    for name, function in replaced.items():
        setattr(time, name, function)
