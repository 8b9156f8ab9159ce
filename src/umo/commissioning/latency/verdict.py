"""The verdict on a measurement, and advice to improve it."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from umo.commissioning.latency.measure import Measured
from umo.cycle.conversion import is_built
from umo.digits import number_text
from umo.duration import duration

YES, CARE, NO = "yes", "with care", "no"
SAFE_SHARE = 0.5


@dataclass(frozen=True)
class Verdict:
    """The verdict. `word` is "yes", "with care" or "no"; `text` gives the reason."""

    word: str
    text: str


def judge(found: Measured) -> Verdict:
    """Judge the loop that `umo run` uses on this computer. "yes": no period was missed, and the longest wake-up plus
    work is below half of the period. "with care": at most one of a thousand periods was missed, and in 99.9 % of the
    periods wake-up plus work is below the period. "no": otherwise."""
    total, missed = found.by_itself.total, found.by_itself.missed
    count = len(total) + missed
    period = found.period * 1e6
    if not count:
        return Verdict(NO, "No period was measured")
    if not len(total):
        return Verdict(NO, f"None of {count:,} periods began in time")
    worst, most = float(total.max()), float(np.percentile(total, 99.9))
    lost = f"{missed:,} of {count:,} periods missed" if missed else f"None of {count:,} periods missed"
    longest = f"the longest wake-up plus work was {duration(worst * 1e-6)}, {worst / period:.0%} of the period"
    if not missed and worst < SAFE_SHARE * period:
        return Verdict(YES, f"{lost}; {longest}")
    if missed <= count / 1000 and most < period:
        return Verdict(CARE, f"{lost}; {longest}")
    return Verdict(NO, f"{lost}; {longest}")


def recommend(found: Measured) -> str:
    """Return advice on busy waiting from the measurement: `busy_wait` in the wiring's `[process]`."""
    asleep, awake = found.umo, found.umo_busy
    if not (len(asleep.total) and len(awake.total)):
        return ""
    before, after = (float(np.percentile(samples.total, 99)) * 1e-6 for samples in (asleep, awake))
    wait, cost = duration(found.busy_wait), f"{max(awake.busy - asleep.busy, 0.0):.0%} more of a processor"
    compared = (
        f"99 % of the periods that begin in time end within {duration(after)} instead of {duration(before)}, "
        f"{awake.missed:,} instead of {asleep.missed:,} are missed"
    )
    better = after < before and awake.missed <= asleep.missed + len(awake.total) / 1000
    if better and found.granted:
        return (
            f"umo run waits busily for {wait} here: {compared}, for {cost}; `busy_wait = 0` in [process] turns it off"
        )
    if better:
        where = f'`busy_wait = "{number_text(found.busy_wait * 1e6)} us"` in [process]'
        return (
            f"{where}: {compared}, for {cost}; umo run does this by itself only on a core that is kept free for the "
            f"loop"
        )
    if found.granted:
        return f"`busy_wait = 0` in [process]: busy waiting for {wait} does not help here, and takes {cost}"
    return f"busy waiting does not help here: {compared}"


def _release() -> tuple[int, ...]:
    """Return the release of the kernel, such as (6, 12)."""
    return tuple(int(part) for part in re.findall(r"\d+", platform.release())[:2])


def _read(path: str) -> str:
    with suppress(OSError):
        return Path(path).read_text()
    return ""


def advice(found: Measured, read: Callable[[str], str] = _read, cores: int | None = None) -> list[str]:
    """Return advice on settings of this computer to change, one line for each."""
    lines = [str(refusal) for refusal in found.refusals]
    if read("/sys/kernel/realtime").strip() != "1" and "PREEMPT_RT" not in read("/proc/version"):
        lines.append(
            f"kernel {platform.release()} is not a real-time kernel: install one with PREEMPT_RT (linux-image-rt)"
        )
    if not is_built():
        lines.append(
            "umo's extension in C is not built, so its periods take longer, and only 3 of 1,000 periods are "
            "checked for two writers of one actuator: apt-get install gcc python3-dev, "
            "then install umo again (pip install --force-reinstall --no-deps --no-cache-dir)"
        )
    governor = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").strip()
    if governor and governor != "performance":
        lines.append(f"the frequency governor is {governor}: cpupower frequency-set -g performance")
    if read("/proc/sys/kernel/sched_rt_runtime_us").strip() not in ("", "-1") and not found.refusals:
        lines.append(
            "real-time throttling takes 5 % of each second from a loop that never waits: harmless for a loop that waits"
        )
    if not found.refusals and _release() >= (6, 12):
        lines.append(
            "since Linux 6.12 ordinary processes may run before real-time ones for 50 ms a second: "
            "echo 0 > /sys/kernel/debug/sched/fair_server/cpuN/runtime"
        )
    if " hypervisor" in read("/proc/cpuinfo"):
        lines.append(
            "this is a virtual machine: the host can take the processor away; measure on the physical computer"
        )
    if (cores or os.cpu_count() or 1) < 2:
        lines.append("there is only one core, and all other processes run on it too")
    elif not read("/sys/devices/system/cpu/isolated").strip():
        lines.append("no core is kept free for the loop: isolcpus=domain,1 on the kernel's command line")
    return lines
