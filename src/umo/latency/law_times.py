"""How long control laws take in Python, and compiled: those of the loop that `umo latency` measures."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from time import perf_counter_ns
from typing import Any

from umo.cycle.connect import connect
from umo.errors import DeclarationError
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.latency.loop import Example, example
from umo.objects import atoms
from umo.presentation.durations import duration
from umo.wiring import resolve

ROUNDS = 2000
PAYS = 0.05
"""Share of the period from which on compiling is advised."""


@dataclass(frozen=True)
class LawTimes:
    """Medians in s of one period's laws."""

    python: float
    compiled: float

    def advice(self, period: float) -> str:
        """Whether `compile` pays at this period in s."""
        saved = self.python - self.compiled
        share = saved / period
        what = f"the laws of this loop take {duration(self.compiled)} instead of {duration(self.python)}"
        if share >= PAYS:
            return f"`compile = true` in [process] pays: {what}, {share:.0%} of the period is saved"
        return f"`compile = true` in [process] saves little here: {what}, {share:.1%} of the period"


def law_times(rounds: int = ROUNDS) -> LawTimes | None:
    """Measured in this process; None without a compiler."""
    try:
        return LawTimes(_median(rounds, compiled=False), _median(rounds, compiled=True))
    except DeclarationError:
        return None


def _median(rounds: int, compiled: bool) -> float:
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
        return median(_period(m) for _ in range(rounds)) * 1e-9


def _period(m: Example) -> int:
    """The ns that the laws take."""
    m.timer.read()
    m.sample()
    begun = perf_counter_ns()
    m.control()
    took = perf_counter_ns() - begun
    m.update()
    return took
