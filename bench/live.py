"""Figures of processes and frames: publishing, reading, real time beside a C loop, kills."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from rich.console import Console

from bench import frames, kills, realtime
from bench.report import Target, upper
from umo.latency import Samples
from umo.latency import measure as loops

TITLE = "Processes and frames (real time: this machine's own noise is in it)"
PERIODS, KILLS, FRAMES = 60_000, 200, 10_000_000


def measure(quick: bool, console: Console) -> list[Target]:
    """All of them; a twentieth of the counts with `quick`. Linux only."""
    if not sys.platform.startswith("linux"):
        return []
    share = 20 if quick else 1
    with _folders():
        found = []
        with console.status("publishing a frame"):
            found += _publishing(50 if quick else 500)
        with console.status(f"{FRAMES // share:,} frames by a reader at full speed"):
            found.append(_torn(FRAMES // share))
        with console.status(f"z-theta at 1 ms over {PERIODS // share:,} periods, a C loop in turns"):
            found += _realtime(PERIODS // share)
        with console.status("2 kHz and 5 kHz"):
            found += [_faster(period, 1.0 if quick else 5.0) for period in (0.0005, 0.0002)]
        with console.status("z-theta beside a busy Python thread"):
            naive = realtime.naive()
            found.append(Target("one process, a busy thread in it", "-", _two(naive), f"missed {naive.missed:,}"))
        with console.status(f"3 times {KILLS // share} kills"):
            found += _kills(KILLS // share)
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


def _kills(count: int) -> list[Target]:
    found = kills.in_a_fresh_process(count)
    targets = []
    for kill in found:
        late = np.percentile(kill.times, 99) if kill.times else float("nan")
        aimed = "control" in kill.what
        verdict = ("met" if late <= 20 else f"missed by {late / 20 - 1:.0%}") if aimed else ""
        if kill.unsafe:
            verdict = f"{kill.unsafe} unsafe"
        targets.append(Target(kill.what, "p99 20 ms, none unsafe" if aimed else "none unsafe", kill.text(), verdict))
    memory = realtime.memory()
    verdict = "met" if memory <= 60 else f"missed by {memory / 60 - 1:.0%}"
    targets.append(Target("resident memory, z-theta over Modbus", "60 MB", f"{memory:.0f} MB", verdict))
    return targets


def _two(samples: Samples, what: str = "total") -> str:
    values = getattr(samples, what)
    if not len(values):
        return "-"
    middle, late = np.percentile(values, [50, 99])
    return f"p50 {middle:.0f}, p99 {late:.0f} us"


@contextmanager
def _folders() -> Iterator[None]:
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
