"""What the reports of the bench say: rows of its table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.fleet.checker import MADE
from bench.fleet.plant import Truth, stride_of
from bench.fleet.strikes import Strike
from bench.report import Target

PROCESS, COMPUTER = 1.0, 3.0
"""Times in s within which the end of a process, or of a computer, must be seen."""
AFTER = 12.0
"""Time in s after a strike in which what is seen is ascribed to it."""
LIMITS = {"stations killed": PROCESS, "gateway killed": PROCESS, "cable pulled": COMPUTER, "router killed": COMPUTER}


def _verdict(wrong: float) -> str:
    return "missed" if wrong else "met"


# Deltas -------------------------------------------------------------------------------------------------------


@dataclass
class Sums:
    """Of all runs, by what a follower of them has found."""

    runs: int = 0
    expected: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    missing: int = 0
    """Deltas that did not come, and that no gap tells."""
    worst: list[str] = field(default_factory=list)
    latest: float = 0.0

    def add(self, truth: Truth, told: dict[str, Any] | None) -> None:
        expected = truth.reader.head // stride_of(truth.reader)
        self.runs += 1
        self.expected += expected
        if told is None:
            self.missing += expected
            self.worst.append(f"{truth.key}: none of {expected} came")
            return
        missing = max(0, expected - told["next"]) + max(0, told["first"])
        self.missing += missing
        self.latest = max(self.latest, told["latest"])
        for name in ("received", "again", "lost", "untold", "wrong"):
            self.counts[name] += told[name]
        if missing or told["lost"] or told["untold"] or told["wrong"]:
            self.worst.append(
                f"{truth.key}: {expected} made, first {told['first']}, next {told['next']}, gaps {told['gaps'][:3]}, "
                f"wrong {told['wrong']}"
            )


def sums_of(truths: list[Truth], report: dict[str, Any]) -> Sums:
    sums = Sums()
    for truth in truths:
        sums.add(truth, report.get(truth.key))
    return sums


def deltas(sums: Sums) -> Iterator[Target]:
    counts = sums.counts
    what = f"{sums.expected:,} deltas of {sums.runs} runs"
    bad = sums.missing + counts["lost"]
    yield Target(f"{what}: lost", "0", f"{bad:,}", _verdict(bad))
    yield Target("  came without a basis, not used", "0", f"{counts['untold']:,}", _verdict(counts["untold"]))
    yield Target("  values or order not as made", "0", f"{counts['wrong']:,}", _verdict(counts["wrong"]))
    yield Target("  came again after a gateway began anew, left out by number", "-", f"{counts['again']:,}", "")
    yield Target("  oldest when it came", "-", f"{sums.latest:.1f} s", "")


# Presence -----------------------------------------------------------------------------------------------------


def presence(strikes: list[Strike], changes: list[tuple[float, str, bool]], began: float) -> Iterator[Target]:
    """How late each end and each return was seen; what was seen without a reason."""
    seen = {kind: ([], []) for kind in LIMITS}  # type: dict[str, tuple[list[float], list[float]]]
    stray = 0
    for at, key, comes in changes:
        if at < began:
            continue
        strike = next((each for each in reversed(strikes) if _concerns(each, key, at)), None)
        if strike is None:
            stray += 1
        elif comes:
            seen[strike.kind][1].append(at - strike.over)
        else:
            seen[strike.kind][0].append(at - strike.struck)
    for kind, (gone, back) in seen.items():
        limit = LIMITS[kind]
        is_judged = kind != "router killed"
        for what, times in (("seen gone", gone), ("seen back", back)):
            if times:
                middle, worst = np.percentile(times, [50, 100])
                shown = f"p50 {middle:.1f}, worst {worst:.1f} s of {len(times)}"
                yield Target(f"{kind}: {what}", f"{limit:g} s" if is_judged else "-", shown,
                             _verdict(worst > limit) if is_judged else "")  # fmt: skip
    yield Target("changes of presence without a reason", "0", f"{stray}", _verdict(stray))


def _concerns(strike: Strike, key: str, at: float) -> bool:
    site, _, station = key.partition("/")
    is_made = station.startswith(MADE)
    if site not in strike.sites or (strike.made_only and not is_made) or (strike.real_only and is_made):
        return False
    return strike.kind in LIMITS and strike.struck <= at <= strike.over + AFTER


def views(report: dict[str, Any]) -> Target:
    looks = sum(each["looks"] for each in report["views"].values())
    old = [age for each in report["views"].values() for _, age in each["old"]]
    shown = f"{len(old)} spells, oldest {max(old, default=0.0):.1f} s, in {looks:,} looks at {len(report['views'])}"
    return Target("values older than 2 s shown as good", "0", shown, _verdict(len(old)))


def scrapes(reports: list[dict[str, Any]]) -> Target:
    """Of the clients of the faces beside the real stations."""
    count, failed, samples = (sum(each[name] for each in reports) for name in ("scrapes", "failed", "samples"))
    what = f"scrapes of {len(reports)} Prometheus faces beside real stations: without an answer"
    why = next((f": {each['why']}" for each in reports if each["why"]), "")
    return Target(what, "0", f"{failed} of {count:,}, {samples:,} samples{why}", _verdict(failed))


# Commands -----------------------------------------------------------------------------------------------------


def commands(report: dict[str, Any], done: Counter[int]) -> Iterator[Target]:
    twice = sum(count > 1 for count in done.values())
    what = f"{report['sent']:,} commands, sent {report['times']:,} times: done twice"
    yield Target(what, "0", f"{twice}", _verdict(twice))
    untrue = sum(not done[number] for number in report["done"])
    yield Target("  told as done and not done", "0", f"{untrue}", _verdict(untrue))
    unsure = set(report["not sure"])
    refused = sum(bool(done[number]) for number in report["refused"] if number not in unsure)
    yield Target("  told as refused and done", "0", f"{refused}", _verdict(refused))
    told = f"{len(report['done']):,} done, {len(report['refused']):,} refused, {len(unsure):,} told as not certain"
    yield Target("  of them", "-", told, "")
