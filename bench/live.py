"""Figures of processes and frames: publishing, reading, real time beside a C loop, kills."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from bench import frames, realtime
from bench.kills import box, campaign
from bench.kills.kinds import KINDS
from bench.report import Target, upper
from umo.latency import Samples
from umo.latency import measure as loops

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


FULL = Size(60_000, 10_000_000, 500, 5.0, 0.5, 720.0)
SHORT = Size(3_000, 300_000, 50, 1.0, 0.05, 75.0)


def measure(size: Size, console: Console) -> list[Target]:
    """All of them. Linux only."""
    if not sys.platform.startswith("linux"):
        return []
    with folders():
        found = []
        with console.status("publishing a frame"):
            found += _publishing(size.batches)
        with console.status(f"{size.frames:,} frames by a reader at full speed"):
            found.append(_torn(size.frames))
        with console.status(f"z-theta at 1 ms over {size.periods:,} periods, a C loop in turns"):
            found += _realtime(size.periods)
        with console.status("2 kHz and 5 kHz"):
            found += [_faster(period, size.seconds) for period in (0.0005, 0.0002)]
        with console.status("z-theta beside a busy Python thread"):
            naive = realtime.naive()
            found.append(Target("one process, a busy thread in it", "-", _two(naive), f"missed {naive.missed:,}"))
        with console.status("kills"):
            found += _kills(size.kills)
        with console.status("memory"):
            found.append(_memory())
        return found


def _publishing(batches: int) -> list[Target]:
    found = []
    for count, limit in ((13, 3.0), (10_000, 60.0)):
        least, median, counting = frames.publishing(count, batches)
        found.append(upper(f"publishing a frame of {count:,} objects", least, limit, "us", median))
        found.append(Target("  of which counters of the system", "-", f"{counting:.2f} us", ""))
    return found


def _torn(count: int) -> Target:
    torn = frames.torn(count)
    verdict = "met" if not torn.torn else f"{torn.torn:,} torn"
    what = "torn frames, writer and reader at full speed"
    return Target(what, "none", f"{torn.torn} of {torn.read:,} read, {torn.lost:,} lapped", verdict)


def _realtime(periods: int) -> list[Target]:
    found = realtime.measure(periods)
    count = len(found.umo.total) + found.umo.missed
    what = f"z-theta, 1 ms, {count:,} periods: waking up + execution"
    targets = [Target(what, "-", _two(found.umo), f"missed {found.umo.missed:,}")]
    targets.append(Target("  waking up alone", "-", _two(found.umo, "wake"), ""))
    if found.c is None:
        return [*targets, Target("  the C loop", "-", "-", "not measured: no compiler")]
    targets.append(Target("  the C loop in turns with it", "-", _two(found.c), f"missed {found.c.missed:,}"))
    ours, theirs = (np.percentile(samples.total, [50, 99]) for samples in (found.umo, found.c))
    alone = np.percentile(found.umo.wake, [50, 99])
    for name, one, other, wake in zip(("p50", "p99"), ours, theirs, alone, strict=True):
        ratio, verdict = one / other, "met" if one / other <= 1.3 else f"missed by {one / other / 1.3 - 1:.0%}"
        measured = f"{ratio:.2f} times (waking up alone {wake / other:.2f})"
        targets.append(Target(f"  {name} against the C loop", "at most 1.3 times", measured, verdict))
    return targets


def _faster(period: float, seconds: float) -> Target:
    found = loops(period, seconds)
    beside = "" if found.c is None else f"; C {_two(found.c)}"
    what = f"13 objects at {1e-3 / period:g} kHz, umo latency's loops"
    return Target(what, "-", f"{_two(found.umo)}{beside}", f"missed {found.umo.missed:,}")


def _kills(share: float) -> list[Target]:
    """The first kinds of `python -m bench --kills`, against its box."""
    if (why := box.missing()) is not None:
        return [Target("kills", "none unsafe", "-", f"not measured: {why}")]
    return [_killed(row) for row in campaign.measure(KILLS, share)]


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
