"""Figures of processes and frames: publishing, reading, real time beside a C loop, kills."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from bench import at_tick, frames, realtime
from bench.kills import box, campaign
from bench.kills.kinds import KINDS
from bench.report import Doing, Target, upper
from umo.commissioning.latency import Samples
from umo.commissioning.latency import measure as loops

TITLE = "Processes and frames (real time: this machine's own noise is in it)"
KILLS = [
    kind for kind in KINDS if kind.name.startswith(("SIGKILL of the control", "SIGSTOP of it", "SIGKILL of the gu"))
]


@dataclass(frozen=True)
class Size:
    """How much of everything; `takes` is about how long, in s, on two shared cores."""

    periods: int
    frames: int
    batches: int
    seconds: float
    kills: float
    """The share of `python -m bench --kills`."""
    takes: float


FULL = Size(60_000, 10_000_000, 500, 5.0, 0.5, 900.0)
SHORT = Size(3_000, 300_000, 50, 1.0, 0.05, 75.0)


def measure(size: Size, doing: Doing) -> Iterator[Target]:
    """All of them, one after the other. Linux only."""
    if not sys.platform.startswith("linux"):
        return
    with folders():
        doing("publishing a frame")
        yield from _publishing(size.batches)
        doing("looking for commands")
        yield from _looking(size.batches)
        doing(f"{size.frames:,} frames by a reader at full speed")
        yield _torn(size.frames)
        doing(f"z-theta at 1 ms over {size.periods:,} periods, C loops in turns")
        yield from _realtime(size.periods)
        for period in (0.001, 0.0005, 0.0002, 0.0001):
            doing(f"13 objects at {1e-3 / period:g} kHz")
            yield from _faster(period, size.seconds)
        doing("outputs at the next tick")
        yield from _outputs(size.seconds)
        doing("13 objects beside a busy Python thread")
        naive = realtime.naive()
        yield Target(
            "13 objects, one process, a busy thread in it", "-", _two(naive), f"missed {naive.missed:,} of 5,000"
        )
        doing("kills")
        yield from _kills(size.kills)
        doing("memory")
        yield _memory()


def _publishing(batches: int) -> Iterator[Target]:
    for count, limit in ((13, 3.0), (10_000, 60.0)):
        found = frames.publishing(count, batches)
        yield upper(f"publishing a frame of {count:,} objects", found.alone[0], limit, "us", found.alone[1])
        least, median = found.in_period
        yield Target("  the same between two periods' work", "-", f"{least:.2f} ({median:.2f}) us", "")
        yield Target("  reading the counters of the system, for one of 32", "-", f"{found.counting:.2f} us", "")


def _looking(batches: int) -> Iterator[Target]:
    (least, median), (read, read_median) = frames.looking(batches)
    share = f"{least / read:.2f} ({median / read_median:.2f}) times its {read:.2f} ({read_median:.2f}) us"
    yield upper("the look for commands, none there", least, 1.0, "us", median)
    yield Target("  against one os.pread of 8 bytes", "-", share, "")


def _torn(count: int) -> Target:
    torn = frames.torn(count)
    verdict = "met" if not torn.torn else f"{torn.torn:,} torn"
    what = "torn frames, writer and reader at full speed"
    return Target(what, "none", f"{torn.torn} of {torn.read:,} read, {torn.lost:,} lapped", verdict)


def _realtime(periods: int) -> Iterator[Target]:
    found = realtime.measure(periods)
    count = len(found.umo.total) + found.umo.missed
    yield _row(f"z-theta, 1 ms, {count:,} periods: waking up + execution", found.umo)
    yield Target("  waking up alone", "-", _two(found.umo, "wake"), "")
    yield _row("  a process that sleeps until the tick (busy_wait = 0)", found.asleep)
    if found.c is None or found.c_busy is None:
        yield Target("  the C loop", "-", "-", "not measured: no compiler")
        return
    yield _row("  the C loop, which sleeps until the tick, in turns", found.c)
    yield _row("  the C loop, waiting busily as long", found.c_busy)
    c = np.percentile(found.c.total, [50, 99])
    both, wake = (np.percentile(values, [50, 99]) for values in (found.umo.total, found.umo.wake))
    against = "against the C loop that sleeps"
    yield upper(f"  waking up + execution, p50, {against}", both[0] / c[0], 0.9, "times", both[0] / c[0])
    yield upper(f"  waking up + execution, p99, {against}", both[1] / c[1], 1.0, "times", both[1] / c[1])
    yield upper(f"  waking up alone, p99, {against}", wake[1] / c[1], 0.1, "times", wake[1] / c[1])


def _row(what: str, samples: Samples) -> Target:
    return Target(what, "-", _two(samples), f"missed {samples.missed:,}; {samples.busy:.0%} of a processor")


def _faster(period: float, seconds: float) -> Iterator[Target]:
    """The loops of `umo show latency`."""
    for name, samples in loops(period, seconds).loops.items():
        count = max(len(samples.total) + samples.missed, 1)
        missed = f"missed {1e5 * samples.missed / count:,.0f} of 100,000; {samples.busy:.0%} of a processor"
        yield Target(f"13 objects at {1e-3 / period:g} kHz: {name}", "-", _two(samples), missed)


def _outputs(seconds: float) -> Iterator[Target]:
    handed, c = at_tick.measure(seconds)
    yield Target("outputs at the next tick: from the tick to the last one handed", "-", _two(handed), "")
    if c is None:
        yield Target("  against the C loop", "-", "-", "not measured: no compiler")
        return
    ratio = float(np.percentile(handed.total, 99) / np.percentile(c.wake, 99))
    yield Target("  waking up of the C loop that sleeps, in turns", "-", _two(c, "wake"), "")
    yield upper("  p99 against its waking up", ratio, 0.5, "times", ratio)


def _kills(share: float) -> Iterator[Target]:
    """The first kinds of `python -m bench --kills`, against its box."""
    if (why := box.missing()) is not None:
        yield Target("kills", "none unsafe", "-", f"not measured: {why}")
        return
    yield from map(_killed, campaign.measure(KILLS, share))


def _killed(row: campaign.Row) -> Target:
    late = np.percentile(row.times, 99) if row.times else float("nan")
    aimed = "control" in row.kind.name
    verdict = ("met" if late <= 20 else f"missed by {late / 20 - 1:.0%}") if aimed else ""
    if row.unsafe or row.wrong:
        verdict = f"{len(row.unsafe)} unsafe, {len(row.wrong)} not as they must be"
    return Target(row.kind.name, "p99 20 ms, none unsafe" if aimed else "none unsafe", _three(row.times), verdict)


def _three(times: list[float]) -> str:
    if not times:
        return "-"
    middle, late, worst = np.percentile(times, [50, 99, 100])
    return f"median {middle:.1f}, p99 {late:.1f}, worst {worst:.1f} ms of {len(times)}"


def _memory() -> Target:
    memory = realtime.memory()
    verdict = "met" if memory <= 60 else f"missed by {memory / 60 - 1:.0%}"
    return Target("resident memory, z-theta over Modbus", "60 MB", f"{memory:.0f} MB", verdict)


def _two(samples: Samples, what: str = "total") -> str:
    values = getattr(samples, what)
    if not len(values):
        return "-"
    middle, late = np.percentile(values, [50, 99])
    return f"p50 {middle:.0f}, p99 {late:.0f} us"


@contextmanager
def folders() -> Iterator[None]:
    """What umo keeps of these runs goes away with them."""
    names = ("UMO_STATE", "UMO_FRAMES")
    before = {name: os.environ.get(name) for name in names}
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=shared) as folder:
        os.environ |= dict.fromkeys(names, folder)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
