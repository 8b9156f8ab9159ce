"""The search for the cause of a missed period in its frames.

A tick is missed between a return of the timer and its next call. So the cause lies in the period before the reporting
frame: the loop woke late, or the work took too long. The part of this period with the largest excess over its usual
time shows where the time was spent. The usual time is the median of the available periods that ended in time; 0 if
there are none. The counters of the operating system and of the interpreter show the reason.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from umo.cycle.phase_times import CONTROL, TRY
from umo.duration import duration
from umo.objects.presentation.run_facts import clock_text
from umo.process.frames.layout import USAGE, Layout
from umo.process.frames.run_reader import Frames
from umo.text import count_of

CAUSE_SHARE = 0.5
"""The least share of the excess that a counter of time must explain to count as the cause."""
MIN_FAULT_TIME = 500.0
"""The least time in ns of a page fault that does not access the disk."""
FAULT_SHARE = 0.1
SOME_FAULTS = 8
ALWAYS_SHARE = 0.5
"""The share of late periods from which on the station counts as always too slow."""
ALWAYS_PERIODS = 10
"""The least number of periods, and of late periods, for this verdict."""
FULL_SHARE = 0.8
"""The share of a period from which on the usual time leaves little room."""
NAMED_SHARE = 0.1
"""The share of a period from which on a part of the period is named if there is little room."""
AFTER = "after"
WAKE = "wake"
CONTROL_CODE = "control code"

PhaseTimes = dict[str, npt.NDArray[np.float64]]


class Cause(Enum):
    """The cause of a missed period."""

    COLLECTION = "collection"
    PREEMPTED = "preempted"
    PAGE_FAULTS = "page faults"
    DRIVER = "driver"
    CONTROL = "control"
    WAKE = "wake"
    AFTER = "after"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class MissCause:
    """The cause of the periods missed at one frame."""

    row: int
    """The row of the frame that reports the missed periods."""
    missed: int
    cause: Cause
    text: str
    excess: float
    """The time in s above the usual time."""


class Evidence:
    """The parts of the time of each period, and the counts in each period, computed once for all verdicts on some
    frames."""

    def __init__(self, frames: Frames, layout: Layout) -> None:
        self._missed = frames["missed"].tolist()
        self._counted = frames["counted"].tolist()
        parts = split(frames, layout)
        usual = _medians(parts, np.append(frames["missed"][1:] == 0, False))
        excess = np.array([times - usual[name] for name, times in parts.items()])
        self._longest = [list(parts)[number] for number in excess.argmax(axis=0)]
        """The part of each period with the largest excess over its usual time."""
        self._excess = excess.max(axis=0).tolist()
        """The excess in ns."""
        self._parts = parts
        self._counts = counts(frames)
        self._tick = 0.5e9 * float(layout.about.get("period", 0.0))
        """The excess in ns above the usual time from which on a period may have caused a missed tick."""

    def explain(self, row: int) -> MissCause:
        """Return the cause of the periods that were missed at this row. The cause is UNKNOWN if the causing period is
        not available. It is also UNKNOWN if there are no counts for this period, as for the first ones, unless a part
        of the causing period took longer than a whole period."""
        first, excess, part = row, 0.0, ""
        while first >= 1:
            before = first - 1
            excess, part = self._excess[before], self._longest[before]
            if not self._missed[before] or excess >= self._tick:
                break
            first = before  # one long period can miss several ticks
        cause, text = Cause.UNKNOWN, "the periods before it are not in this file"
        is_known = first >= 2 or (first == 1 and 0.0 < 2 * self._tick <= excess)
        if is_known:
            end = first if part == AFTER else first - 1  # the counters are read when a frame is being written
            while end + 1 < len(self._counted) and self._counted[end] == self._counted[end - 1]:
                end += 1  # they were not read for this one
            happened = {name: int(values[end]) for name, values in self._counts.items()}
            cause, text = _judge(part, excess, float(self._parts[part][first - 1]), happened)
        still = "still late: " if first < row else ""
        return MissCause(row, self._missed[row], cause, still + text, excess * 1e-9 if is_known else 0.0)


def explain_all(frames: Frames, layout: Layout) -> list[MissCause]:
    """Return the verdict on each row that reports missed periods."""
    rows = np.flatnonzero(frames["missed"]).tolist()
    if not rows:
        return []
    evidence = Evidence(frames, layout)
    return [evidence.explain(row) for row in rows]


def sentences(frames: Frames, layout: Layout, verdicts: list[MissCause], most: int) -> list[str]:
    """Return sentences about parts that are always too slow, about the last verdicts (at most `most`), and about the
    frequency of each cause, such as

    `2 periods missed before 3.456 s (period 3456): control code took 2.1 ms`."""
    period = float(layout.about.get("period", 0.0))
    always = always_slow(frames, layout)
    lines = [always] if always else []
    for verdict in verdicts[-most:]:
        row = frames[verdict.row]
        missed = f"{count_of(verdict.missed, 'period')} missed"
        lines.append(f"{missed} before {clock_text(row['time'], period)} (period {row['number']}): {verdict.text}")
    if len(verdicts) > 1:
        counted = Counter(verdict.cause.value for verdict in verdicts).most_common()
        lines.append(f"all {len(verdicts)} occasions: {', '.join(f'{cause} {count}' for cause, count in counted)}")
    return lines


def always_slow(frames: Frames, layout: Layout) -> str:
    """Return a sentence about the parts that usually take too long, if the period is too short for them: `too slow for
    the period of 10 ms: 98 % of 500 periods are late; usually control code takes 12 ms, driver io (sample) 4 ms`. Empty
    if the usual times fit."""
    period, count = float(layout.about.get("period", 0.0)) * 1e9, len(frames) - 1
    late = np.append(frames["missed"][1:] > 0, False)
    is_slow = late.sum() >= max(ALWAYS_PERIODS, ALWAYS_SHARE * count)
    medians = _medians(split(frames, layout), late if is_slow else np.append(np.full(count, True), False))
    if not is_slow:  # what is left of the period is spent there
        medians |= {WAKE: 0.0, AFTER: 0.0}
    total = sum(medians.values())
    if count < ALWAYS_PERIODS or period <= 0.0 or total < (period if is_slow else FULL_SHARE * period):
        return ""
    told = sorted((part for part in medians if medians[part] >= NAMED_SHARE * period), key=lambda part: -medians[part])
    times = ", ".join(f"{_name(part)} {duration(round(medians[part] * 1e-9, 6))}" for part in told)
    slow = "too slow for" if is_slow else "hardly within"
    what = f"{slow} the period of {duration(period * 1e-9)}: {late.sum() / count:.0%} of {count} periods are late"
    text = f"{what}; usual times: {times}"
    waited = float(np.median(counts(frames)["run_queue_wait"][late])) if is_slow else 0.0
    if waited < NAMED_SHARE * total:
        return text
    return f"{text}; for {duration(round(waited * 1e-9, 6))} of this time, other processes used the core"


def _medians(parts: PhaseTimes, chosen: npt.NDArray[np.bool_]) -> dict[str, float]:
    """Return the median of each part in these rows, in ns; 0 if there are no rows."""
    return {name: float(np.median(times[chosen])) if chosen.any() else 0.0 for name, times in parts.items()}


def _name(part: str) -> str:
    """Return a part of a period as text: `control code of oven`, `driver io (sample)`."""
    kind, _, of = part.partition(" ")
    if kind == CONTROL:
        return f"{CONTROL_CODE}{' of' * bool(of)} {of}".rstrip()
    if of:
        return f"driver {of} ({_driver_work(kind)})"
    return "waking up" if part == WAKE else "observers and the frame"


def _driver_work(kind: str) -> str:
    return "the driver is away, and umo looked for its device" if kind == TRY else kind


def split(frames: Frames, layout: Layout) -> PhaseTimes:
    """Return the parts of each period's time in ns: waking up, the phases, and the work after `update`. The part for
    attempts to reach a driver is left out if there were none."""
    phases = frames["phases"].astype(float)
    parts: PhaseTimes = {name: phases[:, i] for i, name in enumerate(layout.phases) if name != "timer"}
    parts = {name: times for name, times in parts.items() if not name.startswith(f"{TRY} ") or times.any()}
    known = frames["wake"] >= 0
    waiting = phases[:, layout.phases.index("timer")]
    woke = np.where(known, frames["wake"], waiting)  # it did not sleep before a period that was late already
    parts = {WAKE: np.where(frames["missed"] > 0, 0, woke).astype(float), **parts}
    called = frames["began"][1:] - waiting[1:]
    after = called - (frames["began"][:-1] + frames["execution"][:-1])
    parts[AFTER] = np.append(after, 0.0)
    return parts


def counts(frames: Frames) -> dict[str, npt.NDArray[np.float64]]:
    """Return the count of each counter in the period of each row. The counters are not read in every period; the usual
    count is subtracted for the periods between two readings. A row without a reading has the count 0."""
    read = np.flatnonzero(np.diff(frames["counted"])) + 1  # those with a reading of their own
    periods = np.diff(frames["counted"])[read - 1]
    found = {}
    for name, *_ in USAGE:
        values = np.zeros(len(frames))
        counted = np.diff(frames[name])[read - 1].astype(float)
        usual = float(np.median(counted / periods)) if len(read) else 0.0
        values[read] = np.maximum(counted - usual * (periods - 1), 0.0)
        found[name] = values
    return found


def _judge(part: str, excess: float, took: float, counted: dict[str, int]) -> tuple[Cause, str]:
    times = (took, counted["collecting"], counted["run_queue_wait"])
    lasted, collected, preempted = (duration(round(each * 1e-9, 6)) for each in times)
    if counted["collections"] and counted["collecting"] >= CAUSE_SHARE * excess:
        return Cause.COLLECTION, f"a collection ran for {collected} (the garbage collector)"
    if counted["run_queue_wait"] >= CAUSE_SHARE * excess:
        return Cause.PREEMPTED, f"preempted for {preempted}: another process used the core"
    if _faulted(counted, excess):
        return Cause.PAGE_FAULTS, _faults(counted)
    waited = " (it slept or waited)" if counted["voluntary_switches"] > 1 else ""
    kind, _, driver = part.partition(" ")
    if kind == CONTROL:
        return Cause.CONTROL, f"{_name(part)} took {lasted}{waited}"
    if driver:
        return Cause.DRIVER, f"driver {driver} took {lasted} ({_driver_work(kind)})"
    if part == WAKE:
        text = f"the timer woke {lasted} late, but no other process used the core: interrupts, or the host of this VM"
        return Cause.WAKE, text
    return Cause.AFTER, f"observers and the frame took {lasted} after update"


def _faulted(counted: dict[str, int], excess: float) -> bool:
    """Return True if page faults explain the excess: faults that read the disk, or many faults, or some faults (of
    large pages) if most of the time was spent in the kernel."""
    minor = counted["minor_faults"]
    if counted["major_faults"] or minor * MIN_FAULT_TIME >= FAULT_SHARE * excess:
        return True
    return minor >= SOME_FAULTS and counted["in_kernel"] >= CAUSE_SHARE * excess


def _faults(counted: dict[str, int]) -> str:
    disk = f", {counted['major_faults']} of them from disk" if counted["major_faults"] else ""
    count = counted["major_faults"] + counted["minor_faults"]
    return f"{count} page faults{disk}: memory was touched for the first time"
