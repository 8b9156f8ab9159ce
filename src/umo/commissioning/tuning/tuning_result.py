"""The result of tuning a loop: its model, sets of gains with margins, and the predicted steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from umo.commissioning.tuning.axis_tuning import AxisModel, axis_sets, identify_axis
from umo.commissioning.tuning.gain_rules import BALANCED, GainSet, gain_sets
from umo.commissioning.tuning.identification import Identified, identify
from umo.commissioning.tuning.law_facts import LawFacts
from umo.commissioning.tuning.margins import SampledModels
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.models import FIRST_ORDER, SECOND_ORDER, ProcessModel
from umo.commissioning.tuning.predicted_step import PredictedStep, predicted_step
from umo.commissioning.tuning.relay_cycles import RelayCycles, relay_cycles
from umo.errors import RangeError

PRESENT = "present"
"""The name of the gains that the law has."""
PREDICTED_MODELS = 12
"""The approximate number of models, among those that fit equally well, for which steps are predicted."""
STEP_TIMES = 25.0
"""Duration of a predicted step as a multiple of 1 / crossover."""
FASTER = 3.0
"""Least factor by which the inner loop of a cascade should be faster; 5 is better (Astrom and Hagglund, PID
Controllers: Theory, Design, and Tuning, 1995, section 7.2)."""
MOST_UNEXPLAINED = 15.0
"""Largest part of the spread of the measurement, in per cent, that neither a model nor noise describes."""
MOST_BENT = 0.1
"""Largest permitted relative change of the gain with the amplitude."""
LONGEST_SECOND_LAG = 0.3
"""The largest permitted lag beside an integrator or a longer lag, as a share of the response's duration. The effect of
a zero is subtracted from the lag. A longer lag looks like an integrator."""
LEAST_DAMPING = 0.3
"""The least damping of an oscillating process for which gains are printed."""


@dataclass(frozen=True)
class TuningResult:
    """The results for one loop."""

    facts: LawFacts
    response: MeasuredResponse
    identified: Identified
    relay: RelayCycles | None
    sets: list[GainSet]
    """The sets of gains: first the present gains, if they close a loop; then cautious, balanced and quick."""
    inner: ProcessModel | None = None
    """The model from the inner setpoint to the inner measurement of a cascade; None if not known."""
    axis: AxisModel | None = None
    """The model of the axis, if the loop is one of an axis; then the response is that of the velocity."""

    @property
    def model(self) -> ProcessModel:
        """The model from the output of the law to its measurement."""
        return self.identified.model if self.axis is None else self.axis.position

    @property
    def inner_time(self) -> float | None:
        """Average residence time of the closed inner loop, s, or None if it is not known."""
        return None if self.inner is None else residence_time(self.inner)

    @property
    def faster(self) -> float | None:
        """The factor by which the inner loop is faster than the remaining outer process; None if it is not known, or if
        the process integrates."""
        if self.inner_time is None or self.model.integrates:
            return None
        return max(residence_time(self.model) - self.inner_time, 0.0) / max(self.inner_time, self.facts.dt)

    def set_of(self, name: str) -> GainSet:
        """Return one of the sets. Raises RangeError if there is none with this name."""
        found = {each.name: each for each in self.sets}
        if name not in found:
            raise RangeError(f"there is no set {name!r}: {', '.join(found)}")
        return found[name]

    @cached_property
    def steps(self) -> dict[str, PredictedStep]:
        """The predicted step of the setpoint with each set, by the name of the set."""
        model, dt = self.model, self.facts.dt
        crossover = self.set_of(BALANCED).margins.crossover
        duration = STEP_TIMES / crossover if crossover else 10.0 * (model.dead_time + max(model.lags, default=1.0))
        stable = (each for each in self.sets if each.margins.stable)
        return {each.name: predicted_step(model, each.gains, dt, duration) for each in stable}

    def doubt(self, name: str) -> list[PredictedStep]:
        """Return the predicted steps with a set for some of the models that fit equally well."""
        found = self.identified.as_good if self.axis is None else self.axis.as_good
        stable = [each for each in found if not each.structure.unstable]
        times, gains = self.steps[name].times, self.set_of(name).gains
        few = stable[:: max(len(stable) // PREDICTED_MODELS, 1)]
        return [predicted_step(each, gains, self.facts.dt, float(times[-1])) for each in few]


def tuned(facts: LawFacts, response: MeasuredResponse, relay: bool = False, derivative: bool = False) -> TuningResult:
    """Find the model and the gains. `relay`: whether the response is that of a relay experiment. `derivative`: whether
    the gains may have a derivative, even if the law has none now. Raises RangeError, with the reason, if no model can
    be found from the response."""
    response.check_moved(facts.resolution, facts.actuator, facts.sensor)
    cycles = relay_cycles(response, facts.present.gain >= 0.0) if relay else None
    identified = identify(response, sign=facts.present.gain)
    check_tunable(identified)
    derivative = derivative or facts.present.derivative_time > 0.0
    sets = gain_sets(identified.model, facts.dt, identified.as_good, derivative)
    sets = [*_present(identified.as_good, facts), *sets]
    return TuningResult(facts, response, identified, cycles, sets, _inner_loop(response))


def check_tunable(identified: Identified) -> None:
    """Check that gains can be recommended. Raises RangeError if a `PID` should not be tuned for such a process, or if
    the process is not linear."""
    model = identified.model
    if identified.unexplained > MOST_UNEXPLAINED:
        raise RangeError(
            f"no linear model describes the response: {identified.unexplained:.0f} % of it is explained neither by a "
            "model nor by noise; look for stiction, backlash, a dead band or a limit of the actuator, or for a "
            "disturbance"
        )
    if identified.bend > MOST_BENT:
        raise RangeError(
            f"the response is not linear: its gain changes by {100.0 * identified.bend:.0f} % with the amplitude; look "
            "for stiction, backlash, a dead band or a limit of the actuator"
        )
    if model.structure.unstable:
        raise RangeError(
            f"the process without control is unstable (time constant {model.lags[0]:.3g} s): no gains are printed for "
            f"it"
        )
    behind = model.lags if model.integrates or model.structure.oscillates else model.lags[1:]
    if max(behind, default=0.0) - max(model.zero, 0.0) > LONGEST_SECOND_LAG * identified.duration:
        raise RangeError(
            f"the response of {identified.duration:.3g} s is too short: the process may be a double integrator; a "
            f"longer "
            "experiment or a wider --within may help"
        )
    if model.structure.oscillates and model.damping < LEAST_DAMPING:
        raise RangeError(
            f"the process without control oscillates (period {6.283 * model.lags[0]:.3g} s, damping "
            f"{model.damping:.2g}): no "
            "gains are printed for it"
        )


def residence_time(model: ProcessModel) -> float:
    """Return the average residence time of a process that does not integrate, s."""
    return model.dead_time + sum(model.lags)


def _inner_loop(response: MeasuredResponse) -> ProcessModel | None:
    if response.inner is None:
        return None
    try:
        return identify(response.inner, (FIRST_ORDER, SECOND_ORDER), sign=1.0).model
    except RangeError:
        return None


def tuned_axis(facts: LawFacts, response: MeasuredResponse) -> TuningResult:
    """Find the model and the gains, like `tuned`, for the servo of an axis from its moves."""
    response.check_moved(facts.resolution, facts.actuator, facts.sensor)
    axis = identify_axis(response, facts.present.gain)
    sets = [*_present(axis.as_good, facts), *axis_sets(axis, facts.dt)]
    return TuningResult(facts, axis.velocities, axis.identified, None, sets, axis=axis)


def _present(models: Sequence[ProcessModel], facts: LawFacts) -> list[GainSet]:
    """Return the present gains, if their sign is that of the process; otherwise an empty list."""
    if facts.present.gain * models[0].gain <= 0.0:
        return []
    return [GainSet(PRESENT, "", facts.present, SampledModels(models, facts.dt).margins(facts.present))]
