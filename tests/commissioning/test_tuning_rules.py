"""Models, margins and gains of `umo.commissioning.tuning`, against python-control and known processes."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.tiers import first
from helpers.true_margins import judged, true_margins
from helpers.tuning_plants import Plant
from umo.commissioning.tuning.gain_rules import LEAST, gain_sets
from umo.commissioning.tuning.identification import POOR_FIT, Identified, identify
from umo.commissioning.tuning.margins import Gains, SampledModels, margins
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.models import FIRST_ORDER, INTEGRATOR, OSCILLATING, ProcessModel
from umo.commissioning.tuning.predicted_step import predicted_step
from umo.commissioning.tuning.relay_cycles import relay_cycles
from umo.commissioning.tuning.tuning_result import check_tunable
from umo.control import PID
from umo.errors import RangeError

pytest.importorskip("scipy")

PLANTS = {
    "two lags": ProcessModel("second order", 3.0, 1.0, (20.0, 8.0)),
    "lag": ProcessModel("first order", 10.4, 0.9, (137.8,)),
    "dead time": ProcessModel("first order", 2.0, 5.0, (1.0,)),
    "integrator": ProcessModel("integrator", 0.05, 2.0),
    "lagged integrator": ProcessModel("lagged integrator", 5.0, 0.5, (3.0,)),
}
DT = 0.1


def step_response(model: ProcessModel, noise: float = 0.0, seed: int = 1, count: int = 1500) -> MeasuredResponse:
    outputs = np.full(count, 20.0)
    outputs[100 : 600 if model.integrates else None] = 30.0
    change = model.response(outputs, DT)
    random = np.random.default_rng(seed).standard_normal(count)
    return MeasuredResponse.of(np.arange(count) * DT, outputs, 300.0 + change + noise * np.ptp(change) * random)


@cache
def found_in_all_kinds(name: str, noise: float) -> Identified:
    """From the step of a plant. Each takes a second."""
    return identify(step_response(PLANTS[name], noise), sign=1.0)


@pytest.mark.parametrize("name", first(1, PLANTS))
def test_margins_are_those_of_python_control(name: str) -> None:
    model = PLANTS[name]
    for each in gain_sets(model, DT):
        gain, phase = true_margins(model, each.gains, DT)
        assert each.margins.gain == pytest.approx(gain, rel=0.01)
        assert each.margins.phase == pytest.approx(phase, abs=0.5)


JUDGED = [
    (ProcessModel("third order", 2.0, 0.3, (4.0, 1.0)), Gains(0.4, 5.0)),
    (ProcessModel("oscillating", 2.0, 0.33, (3.0,), damping=0.3), Gains(0.1, 2.0)),
    (ProcessModel("second order with a zero", 2.0, 0.25, (5.0, 2.0), zero=-1.5), Gains(0.5, 6.0)),
    (ProcessModel("lagged integrator with a zero", 0.5, 0.3, (2.0,), zero=0.7), Gains(0.6, 20.0)),
    (ProcessModel("oscillating integrator", 0.5, 0.3, (2.0,), damping=0.4), Gains(0.2, 60.0)),
    (ProcessModel("unstable", 2.0, 0.4, (5.0,)), Gains(2.0, 20.0)),
    (ProcessModel("unstable", 2.0, 0.4, (5.0,)), Gains(0.4, 20.0)),
    (ProcessModel("oscillating", 2.0, 0.33, (3.0,), damping=0.05), Gains(1.0, 2.0)),
]


@pytest.mark.parametrize(("model", "gains"), JUDGED)
def test_stability_and_margins_of_each_structure_are_those_of_python_control(model: ProcessModel, gains: Gains) -> None:
    poles = tuple(complex(each) for each in model.poles if each)
    zeros = (-1.0 / model.zero,) if model.zero else ()
    gain = -model.gain if model.structure.unstable else model.gain  # K / (T s - 1) is -K / (1 - T s)
    plant = Plant(model.kind, gain, model.dead_time, poles, zeros, int(model.integrates), dt=DT)
    stable, gain_margin, phase_margin = judged(plant, gains)
    found = margins(model, gains, DT)
    assert found.stable == stable
    if stable:
        assert found.gain == pytest.approx(gain_margin, rel=0.02)
        assert found.phase == pytest.approx(phase_margin, abs=0.6)


def test_margins_of_several_models_are_those_of_the_worst() -> None:
    models = [PLANTS["lag"], replace(PLANTS["lag"], gain=20.0), replace(PLANTS["lag"], dead_time=3.0)]
    gains = Gains(2.0, 50.0)
    each, worst = [margins(model, gains, DT) for model in models], SampledModels(models, DT).margins(gains)
    assert worst.gain == min(one.gain for one in each)
    assert worst.phase == min(one.phase for one in each)
    unstable = ProcessModel("unstable", 10.4, 0.9, (1.0,))
    assert not SampledModels([*models, unstable], DT).margins(gains).stable


def test_what_noise_does_not_exclude_fits_as_well_and_makes_the_stated_margins_smaller() -> None:
    model = PLANTS["two lags"]
    exact, noisy = (found_in_all_kinds("two lags", noise) for noise in (0.0, 0.01))
    assert exact.kinds == [model.kind]
    assert len(noisy.kinds) > 1
    gains = Gains(0.8, 25.0)
    less, true = (SampledModels(each.as_good, DT).margins(gains) for each in (noisy, exact))
    assert less.gain < 0.9 * true.gain
    assert less.phase < true.phase


def test_a_gain_that_depends_on_the_amplitude_is_told() -> None:
    outputs, dt, kinds = np.repeat([20.0, 30.0, 25.0], 100), 0.4, [FIRST_ORDER]
    dead_band = np.maximum(outputs - 20.0 - 3.0, 0.0) + 20.0
    times, model = np.arange(300) * dt, PLANTS["dead time"]
    noise = 0.01 * np.random.default_rng(2).standard_normal(300)
    straight, bent = (
        identify(MeasuredResponse.of(times, outputs, model.response(each, dt) + noise), kinds, sign=1.0)
        for each in (outputs, dead_band)
    )
    assert straight.bend == 0.0
    assert bent.bend > 0.2
    with pytest.raises(RangeError, match="not linear"):
        check_tunable(bent)


@pytest.mark.parametrize("noise", first(1, [0.01, 0.0]))
@pytest.mark.parametrize("name", first(1, PLANTS))
def test_balanced_gains_of_an_identified_model_have_their_margins_on_the_true_process(name: str, noise: float) -> None:
    found = found_in_all_kinds(name, noise)
    sets = {each.name: each for each in gain_sets(found.model, DT, found.as_good)}
    assert list(sets) == list(LEAST)
    gain, phase = true_margins(PLANTS[name], sets["balanced"].gains, DT)
    assert gain >= 2.0
    assert phase >= 45.0


@pytest.mark.parametrize("name", first(1, PLANTS))
def test_parameters_are_found_and_lie_in_their_intervals(name: str) -> None:
    model = PLANTS[name]
    exact = found_in_all_kinds(name, 0.0)
    assert exact.model.kind == model.kind
    assert exact.model.describe() == pytest.approx(model.describe(), rel=1e-3)
    inside = []
    for seed in range(3):
        found = identify(step_response(model, 0.005, seed), [model.kind], sign=1.0)
        known = model.describe()
        inside += [
            abs(value - known[each]) <= 1.5 * found.intervals[each] for each, value in found.model.describe().items()
        ]
    assert sum(inside) >= 0.7 * len(inside)


@settings(max_examples=15, deadline=None)
@given(
    gain=st.floats(-10.0, 10.0).filter(lambda each: abs(each) > 0.01),
    lag=st.floats(0.5, 100.0),
    second=st.floats(0.0, 1.0),
    dead_time=st.floats(0.0, 20.0),
    kind=st.sampled_from(["first order", "second order", "integrator", "lagged integrator"]),
)
def test_each_set_of_any_model_has_its_margins(
    gain: float, lag: float, second: float, dead_time: float, kind: str
) -> None:
    lags = {"first order": (lag,), "second order": (lag, max(lag * second, 0.01)), "integrator": ()}.get(kind, (lag,))
    for each in gain_sets(ProcessModel(kind, gain, dead_time, lags), DT):
        assert each.margins.at_least(*LEAST[each.name])
        PID(**asdict(each.gains))


def test_a_response_of_a_model_is_that_of_small_steps() -> None:
    model, fine = PLANTS["two lags"], 0.001
    outputs = np.repeat(np.random.default_rng(3).uniform(0.0, 1.0, 300), 100)
    first = second = 0.0
    slow, path = np.concatenate([np.full(1000, outputs[0]), outputs])[: len(outputs)] - outputs[0], []
    for each in slow:
        path.append(second)
        second += fine * (first - second) / 8.0
        first += fine * (3.0 * each - first) / 20.0
    assert model.response(outputs[::100], DT) == pytest.approx(np.array(path)[::100], abs=1e-3)


def test_a_predicted_step_settles_at_its_size() -> None:
    (_, balanced, _) = gain_sets(PLANTS["two lags"], DT)
    step = predicted_step(PLANTS["two lags"], balanced.gains, DT, 200.0, size=5.0)
    assert step.measurements[-1] == pytest.approx(5.0, abs=0.01)
    assert 0.0 < step.settling_time < 60.0
    assert step.overshoot < 40.0
    limited = predicted_step(PLANTS["two lags"], balanced.gains, DT, 200.0, size=5.0, limit=2.0)
    assert np.abs(limited.outputs).max() == 2.0


def test_a_relay_gives_the_critical_point() -> None:
    model, level, value, path = PLANTS["dead time"], 1.0, 0.0, []
    history: list[float] = [0.0] * 50
    for _ in range(2000):
        level = -1.0 if value > 0.1 else 1.0 if value < -0.1 else level
        path.append((level, value))
        history.append(level)
        value += DT * (2.0 * history[-51] - value) / 1.0
    rows = np.array(path)
    found = relay_cycles(MeasuredResponse.of(np.arange(len(rows)) * DT, rows[:, 0], rows[:, 1]))
    critical = margins(model, Gains(1e-9), DT).gain * 1e-9
    assert found.ultimate_gain == pytest.approx(critical, rel=0.25)
    assert found.ultimate_period == pytest.approx(12.0, rel=0.1)
    assert not found.uneven
    with pytest.raises(RangeError, match="made 1 complete cycle, and 2 are needed"):
        relay_cycles(MeasuredResponse.of(np.arange(300) * DT, rows[:300, 0], rows[:300, 1]))


# Refusals --------------------------------------------------------------------------------------------------


def test_an_output_that_did_not_move_is_refused() -> None:
    rows = np.arange(100.0)
    with pytest.raises(RangeError, match="motor moved by only 0 in 100 s"):
        MeasuredResponse.of(rows, np.full(100, 3.0), rows).check_moved(0.1, "motor")
    with pytest.raises(RangeError, match="moved by only"):
        MeasuredResponse.of(rows, 3.0 + 0.1 * (rows % 2), rows).check_moved(0.1, "motor")


def test_noise_alone_is_refused() -> None:
    noise = np.random.default_rng(1).standard_normal(300)
    outputs = np.repeat([0.0, 1.0], 150)
    response = MeasuredResponse.of(np.arange(300.0), outputs, noise)
    with pytest.raises(RangeError, match="shows no response"):
        response.check_moved()
    with pytest.raises(RangeError, match="no model fits"):
        identify(response, [INTEGRATOR, FIRST_ORDER, OSCILLATING])


def test_samples_without_values_are_left_out_and_too_few_refused() -> None:
    times = np.arange(100.0)
    values = np.where(times == 40.0, np.nan, times)
    response = MeasuredResponse.of(times, times, values)
    assert response.measurements[40] == 40.0
    assert len(response.outputs) == 100
    with pytest.raises(RangeError, match="2 samples"):
        MeasuredResponse.of(times, times, np.where(times < 2.0, times, np.nan))
    with pytest.raises(RangeError, match="do not increase"):
        MeasuredResponse.of(times[::-1], times, times)


def test_gains_of_the_wrong_sign_are_refused() -> None:
    with pytest.raises(RangeError, match="away from its setpoint"):
        margins(PLANTS["lag"], Gains(-1.0), DT)


@pytest.mark.parametrize("seed", first(1, [10, 85]))
def test_a_simple_model_that_fits_badly_is_not_taken_for_its_simplicity(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(25, 60))
    outputs = np.zeros(count)
    outputs[count // 5 :] = 1.0
    dead_time, lag = random.uniform(0, 0.3), random.uniform(0.1, 0.6)
    measured = ProcessModel(FIRST_ORDER, 1.0, dead_time, (lag,)).response(outputs, 0.1)
    drift = np.cumsum(random.normal(size=count)) * random.uniform(0.03, 0.12)
    response, kinds = MeasuredResponse(0.1, outputs, measured + drift), [INTEGRATOR, FIRST_ORDER, OSCILLATING]
    assert identify(response, kinds, sign=1.0).fit >= POOR_FIT
