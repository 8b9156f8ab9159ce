"""The result of tuning a loop: its model, sets of gains with margins, and the steps that they promise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from umo.errors import RangeError
from umo.tuning.axis_tuning import AxisModel, axis_sets, identify_axis
from umo.tuning.gain_rules import BALANCED, GainSet, gain_sets, tyreus_luyben
from umo.tuning.identification import Identified, identify
from umo.tuning.law_facts import LawFacts
from umo.tuning.margins import LoopMargins, margins
from umo.tuning.measured_response import MeasuredResponse
from umo.tuning.models import FIRST_ORDER, SECOND_ORDER, ProcessModel
from umo.tuning.predicted_step import PredictedStep, predicted_step
from umo.tuning.relay_cycles import RelayCycles, relay_cycles

PRESENT = "present"
"""The name of the gains that the law has."""
STEP_TIMES = 25.0
"""Duration of a predicted step in times of 1 / crossover."""
FASTER = 3.0
"""Times by which the inner loop of a cascade is to be faster at least; 5 is better (Astrom and Hagglund, PID
Controllers: Theory, Design, and Tuning, 1995, section 7.2)."""
UNKNOWN_MARGINS = LoopMargins(float("nan"), float("nan"))


@dataclass(frozen=True)
class TuningResult:
    """What was found of one loop."""

    facts: LawFacts
    response: MeasuredResponse
    identified: Identified | None
    """None: no model fits, and the gains are those of the critical point."""
    relay: RelayCycles | None
    sets: list[GainSet]
    """The present gains first, if they make a loop at all; then cautious, balanced and quick."""
    inner: ProcessModel | None = None
    """Of a cascade: from the inner setpoint to the inner measurement; None: it is not known."""
    axis: AxisModel | None = None
    """What moves the axis, if it is one; then the response is that of its velocity."""

    @property
    def model(self) -> ProcessModel | None:
        """From the output of the law to its measurement; None: no model fits."""
        if self.axis is not None:
            return self.axis.position
        return None if self.identified is None else self.identified.model

    @property
    def inner_time(self) -> float | None:
        """Average residence time of the closed inner loop, s; None: it is not known."""
        return None if self.inner is None else residence_time(self.inner)

    @property
    def faster(self) -> float | None:
        """How many times faster the inner loop is than the rest of the outer process; None: it is not known, or the
        process integrates."""
        if self.inner_time is None or self.model is None or self.model.integrates:
            return None
        return max(residence_time(self.model) - self.inner_time, 0.0) / max(self.inner_time, self.facts.dt)

    def set_of(self, name: str) -> GainSet:
        """One of the sets; RangeError if there is none of this name."""
        found = {each.name: each for each in self.sets}
        if name not in found:
            raise RangeError(f"there is no set {name!r}: {', '.join(found)}")
        return found[name]

    @cached_property
    def steps(self) -> dict[str, PredictedStep]:
        """The predicted step of the setpoint with each set, by its name; none without a model."""
        model, dt = self.model, self.facts.dt
        if model is None:
            return {}
        crossover = self.set_of(BALANCED).margins.crossover
        duration = STEP_TIMES / crossover if crossover else 10.0 * (model.dead_time + max(model.lags, default=1.0))
        stable = (each for each in self.sets if each.margins.gain > 1.0 and each.margins.phase > 0.0)
        return {each.name: predicted_step(model, each.gains, dt, duration) for each in stable}


def tuned(facts: LawFacts, response: MeasuredResponse, relay: bool = False, derivative: bool = False) -> TuningResult:
    """Find the model and the gains. `relay`: the response is that of a relay, whose critical point counts where no
    model fits. `derivative`: the gains may have one, also if the law has none now. RangeError if nothing can be learnt
    from the response."""
    response.check_moved(facts.resolution, facts.actuator, facts.sensor)
    cycles = relay_cycles(response, facts.present.gain >= 0.0) if relay else None
    try:
        identified = identify(response, sign=facts.present.gain)
    except RangeError:
        if cycles is None or not cycles.is_critical:
            raise
        return TuningResult(facts, response, None, cycles, _by_relay(cycles, facts), _inner_loop(response))
    derivative = derivative or facts.present.derivative_time > 0.0
    sets = gain_sets(identified.model, facts.dt, identified.intervals["L"], derivative)
    sets = [*_present(identified.model, facts), *sets]
    return TuningResult(facts, response, identified, cycles, sets, _inner_loop(response))


def residence_time(model: ProcessModel) -> float:
    """The average residence time of a process that does not integrate, s."""
    return model.dead_time + sum(model.lags)


def _inner_loop(response: MeasuredResponse) -> ProcessModel | None:
    if response.inner is None:
        return None
    try:
        return identify(response.inner, (FIRST_ORDER, SECOND_ORDER), sign=1.0).model
    except RangeError:
        return None


def tuned_axis(facts: LawFacts, response: MeasuredResponse) -> TuningResult:
    """As `tuned`, of the servo of an axis from its moves."""
    response.check_moved(facts.resolution, facts.actuator, facts.sensor)
    axis = identify_axis(response, facts.present.gain)
    sets = [*_present(axis.position, facts), *axis_sets(axis, facts.dt)]
    return TuningResult(facts, axis.velocities, axis.identified, None, sets, axis=axis)


def _present(model: ProcessModel, facts: LawFacts) -> list[GainSet]:
    """The present gains, if their sign is that of the process."""
    if facts.present.gain * model.gain <= 0.0:
        return []
    return [GainSet(PRESENT, "", facts.present, margins(model, facts.present, facts.dt))]


def _by_relay(cycles: RelayCycles, facts: LawFacts) -> list[GainSet]:
    sign = -1.0 if facts.present.gain < 0.0 else 1.0
    found = tyreus_luyben(sign * cycles.ultimate_gain, cycles.ultimate_period)
    return [GainSet(name, "Tyreus-Luyben", gains, UNKNOWN_MARGINS) for name, gains in found.items()]
