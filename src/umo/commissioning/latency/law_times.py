"""The times of control laws in Python and compiled, in the loop that `umo show latency` measures."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from time import perf_counter_ns
from typing import Any

from umo.commissioning.latency.loop import Example, example
from umo.cycle.connect import connect
from umo.duration import duration
from umo.errors import DeclarationError
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.objects import atoms
from umo.wiring import resolve

ROUNDS = 2000
COMPILE_SHARE = 0.05
"""The share of the period from which on umo advises to compile the laws."""


@dataclass(frozen=True)
class LawTimes:
    """The medians in s of the time that the laws take in one period."""

    python: float
    compiled: float

    def advice(self, period: float) -> str:
        """Return whether umo advises `compile` for this period in s."""
        saved = self.python - self.compiled
        share = saved / period
        what = f"the laws of this loop take {duration(self.compiled)} instead of {duration(self.python)}"
        if share >= COMPILE_SHARE:
            return f"`compile = true` in [process] pays: {what}, {share:.0%} of the period is saved"
        return f"`compile = true` in [process] saves little here: {what}, {share:.1%} of the period"


def law_times() -> LawTimes | None:
    """Measure the times in this process. Return None if there is no compiler."""
    try:
        return LawTimes(_median(compiled=False), _median(compiled=True))
    except DeclarationError:
        return None


def _median(compiled: bool) -> float:
    machine = example()
    wire: dict[str, Any] = {item.path: {"driver": "simulated"} for item in atoms(machine)}
    wired = resolve(machine, {"wire": wire | {"timer": {"driver": "simulated", "period": 0.001}}})
    prepared = prepare(machine, wired) if compiled else None
    connection = connect(machine, wired)
    with connection as m:
        if prepared is not None:
            laws = connection.machine.attach(CompiledLaws(prepared))
            for _ in range(COMPARED + 1):
                _period(m)
            if laws.state != "compiled":
                raise DeclarationError("the laws are not compiled")
        return median(_period(m) for _ in range(ROUNDS)) * 1e-9


def _period(m: Example) -> int:
    """Run one period, and return the time in ns that the laws take."""
    m.timer.read()
    m.sample()
    begun = perf_counter_ns()
    m.control()
    took = perf_counter_ns() - begun
    m.update()
    return took
