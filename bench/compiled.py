"""Compiled laws (`[process] compile = true`) in real time, in turns with the same machine in Python and a C loop that
makes the same transfers: z-theta at 1 ms as `umo run` has it, z-theta at 10 kHz and a converter at 20 kHz."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench import live, realtime
from bench.fast_loop import FastLoop
from bench.report import Doing, Target, upper
from umo.commissioning.latency import Samples, native
from umo.system.realtime import busy_wait_for

TITLE = "Compiled laws"
PAIR_TAKES = 75.0
"""Time in s, about, of a pair at 1 ms and of the fast loops."""
FAST = (("ztheta", 0.0001), ("converter", 0.00005))
SLICE = 2.0
"""Time in s of a slice of a fast loop."""
SETTLED = 1_000
"""Periods of z-theta at 1 ms that are left out: in them compiled laws are compared with Python's."""
WATCHED = "ztheta", "converter", "batch"
MOST_LOOKS = 1.05
"""A period with the looks at what the laws take as known, to one without them, at most."""
SLICES = 3
"""Of each fast loop in a pair."""


def measure(pairs: int, doing: Doing) -> Iterator[Target]:
    with live.folders(), native.compiled() as program:
        if program is None:
            yield Target("compiled laws", "-", "-", "not measured: no compiler")
            return
        yield from _at_1_ms(pairs, program, doing)
        for name, period in FAST:
            yield from _fast(name, period, pairs * SLICES, program, doing)
        for name in WATCHED:
            yield _looks(name, doing)


def _at_1_ms(pairs: int, program: object, doing: Doing) -> Iterator[Target]:
    loops = {"Python": Samples(), "compiled": Samples(), "C": Samples()}
    ratios: dict[str, list[tuple[float, float]]] = {"Python": [], "compiled": []}
    granted = realtime._granted()
    with realtime._busy():
        for pair in range(pairs):
            doing(f"z-theta at 1 ms, {pair + 1} of {pairs}")
            slices = {name: Samples() for name in loops}
            for name in ("Python", "compiled") if pair % 2 else ("compiled", "Python"):
                with realtime._station(slices[name], "auto", compiled=name == "compiled", after=SETTLED):
                    if name == "Python":
                        count = realtime._count(slices[name])
                        slices["C"].add(native.run(program, realtime.PERIOD, count, granted.priority, granted.cpu))
            for name, samples in slices.items():
                loops[name] = _joined(loops[name], samples)
            c = np.percentile(slices["C"].total, [50, 99])
            for name in ratios:
                ratios[name].append(tuple(np.percentile(slices[name].total, [50, 99]) / c))
    for name, samples in loops.items():
        yield live._row(f"z-theta, 1 ms, {name}: waking up + execution", samples)
    for name, found in ratios.items():
        for place, (what, limit) in enumerate((("p50", 0.8), ("p99", 0.9))):
            each = sorted(ratio[place] for ratio in found)
            ratio = float(np.median(each))
            text = f"{each[0]:.2f} to {each[-1]:.2f}"
            yield upper(f"  {name}, {what}, to the C loop that sleeps ({text})", ratio, limit, "times", ratio)


def _joined(one: Samples, other: Samples) -> Samples:
    return Samples(
        np.append(one.wake, other.wake),
        np.append(one.work, other.work),
        one.missed + other.missed,
        one.processor + other.processor,
        one.elapsed + other.elapsed,
    )


def _looks(name: str, doing: Doing) -> Target:
    doing(f"{name}, with and without the looks at what is taken as known")
    loop = FastLoop(name, 0.001, True)
    loop.run(1_000, 0.0)  # the laws are compared in these
    state, ratio = loop.close()
    return upper(f"{name} ({state}), a period with the looks, to one without", ratio, MOST_LOOKS, "times", ratio)


def _fast(name: str, period: float, slices: int, program: object, doing: Doing) -> Iterator[Target]:
    compiled, python = (
        FastLoop(name, period, True),
        FastLoop(name, period, False),
    )  # the timer of neither stands still for long
    loops = {"Python": Samples(), "compiled": Samples(), "C": Samples()}
    count = int(SLICE / period)
    compiled.run(int(1.0 / period), busy_wait_for(period, True))  # the laws are compared in these
    for turn in range(slices):
        doing(f"{name} at {1e-3 / period:g} kHz, {turn + 1} of {slices}")
        loops["Python"].add(python.run(count, busy_wait_for(period)))
        # the kernel would stop a C loop that never sleeps for a twentieth of the time
        loops["C"].add(native.run(program, period, count, compiled.priority, compiled.cpu, busy_wait_for(period)))
        loops["compiled"].add(compiled.run(count, busy_wait_for(period, True)))
    python.close()
    state, _ = compiled.close()
    for what, samples in loops.items():
        label = f"{what} ({state})" if what == "compiled" else what
        share = "half of each period" if what == "C" else "as umo run does"
        yield live._row(f"{name}, {1e-3 / period:g} kHz, {label}, waiting busily {share}", samples)
    verdict = "met" if loops["compiled"].missed <= loops["C"].missed else "missed"
    of = count * slices
    missed = f"{loops['compiled'].missed:,} and {loops['C'].missed:,} of {of:,}"
    yield Target("  missed periods, compiled and C", "no more than C", missed, verdict)
