"""The margins of a loop as python-control has them."""

from __future__ import annotations

from math import isinf
from typing import Any

import numpy as np
import pytest

from helpers.tuning_plants import Plant
from umo.commissioning.tuning.margins import Gains
from umo.commissioning.tuning.models import ProcessModel


def true_margins(model: ProcessModel, gains: Gains, dt: float) -> tuple[float, float]:
    """Gain margin and phase margin in degrees: the process sampled with a held output, behind whole periods of dead
    time."""
    return _margins(_sampled(model, dt), model.dead_time, gains, dt)


def true_cascade_margins(
    outer: ProcessModel, gains: Gains, inner: ProcessModel, inner_gains: Gains, dt: float
) -> tuple[float, float]:
    """Those of the outer loop of a cascade: both processes in series behind the output that the inner law holds, which
    is closed around the first of them. Dead time is behind the inner measurement."""
    control = _control()
    law = _law(inner_gains, dt)
    closed = law / (1 + law * _sampled(inner, dt))  # from the inner setpoint to the output
    both = control.tf(control.sample_system(_continuous(inner) * _continuous(outer), dt, "zoh"))
    return _margins(control.minreal(closed * both, verbose=False), outer.dead_time, gains, dt)


def _continuous(model: ProcessModel) -> Any:
    control = _control()
    s = control.tf("s")
    lags = [lag * s + 1 for lag in model.lags] + [s] * model.integrates
    process = control.tf([model.gain], [1.0])
    for each in lags:
        process = process / each
    return process


def _sampled(model: ProcessModel, dt: float) -> Any:
    control = _control()
    return control.tf(control.sample_system(_continuous(model), dt, "zoh"))


def _law(gains: Gains, dt: float) -> Any:
    control = _control()
    z = control.tf([1.0, 0.0], [1.0], dt)
    law = control.tf([gains.gain], [1.0], dt)
    if not isinf(gains.integral_time):
        law = law * (1 + dt / gains.integral_time * z / (z - 1))
    if gains.derivative_time:
        share = dt / (gains.filter_time + dt)
        law += gains.gain * gains.derivative_time * share / dt * (z - 1) / (z - (1 - share))
    return law


def _margins(process: Any, dead_time: float, gains: Gains, dt: float) -> tuple[float, float]:
    control = _control()
    frequencies = np.geomspace(1e-5, np.pi / dt * 0.999, 4000)
    delay = control.frd(np.exp(-1j * frequencies * round(dead_time / dt) * dt), frequencies, dt)
    loop = control.frequency_response(process * _law(gains, dt), frequencies) * delay
    gain, phase, *_ = control.margin(loop.magnitude, np.degrees(loop.phase), frequencies)
    return float(gain), float(phase)


def _control() -> Any:
    """Imported by the tests that need it: that takes a second of each process that collects tests."""
    return pytest.importorskip("control")


# Of any plant of `tuning_plants` ---------------------------------------------------------------------------

LOWEST = 1e-4
"""Lowest frequency at which a loop is looked at, in 1 / the time of the plant."""


def sampled_parts(plant: Plant) -> tuple[Any, Any, Any, int]:
    """(state kept, input's share) with the older output and with the newer one, within one period; the row that makes
    the measurement; whole periods of the dead time. Two held samplings of python-control, one after the other, as the
    output changes in between."""
    control = _control()
    whole = int(plant.dead_time / plant.dt + 1e-9)
    rest = max(plant.dead_time - whole * plant.dt, 0.0)
    process = _state_space(plant)
    parts = []
    for lasting in (rest, plant.dt - rest):
        if lasting <= 1e-9 * plant.dt:
            parts.append((np.eye(process.nstates), np.zeros(process.nstates)))
            continue
        sampled = control.sample_system(process, lasting, "zoh")
        parts.append((sampled.A, sampled.B[:, 0]))
    return parts[0], parts[1], process.C[0], whole


def judged(plant: Plant, gains: Gains) -> tuple[bool, float, float]:
    """Whether the loop of the plant without the nonlinearities of its actuator is stable, by its poles; its gain margin
    (a factor above 1, up or down, whichever is nearer) and its phase margin in degrees, both 0 if it is not stable."""
    control = _control()
    dt = plant.dt
    (kept_old, old), (kept, new), out, whole = sampled_parts(plant)
    states = len(out)
    a = np.zeros((states + 1, states + 1))  # with the output of the period before
    a[:states, :states], a[:states, states] = kept @ kept_old, kept @ old
    b = np.append(new, 1.0)
    process = control.ss(a, b[:, None], np.append(out, 0.0)[None, :], 0.0, dt)
    law = control.ss(_law(gains, dt))
    closed = control.feedback(_delayed(process, whole) * law, 1)
    if np.abs(closed.poles()).max() >= 1.0:
        return False, 0.0, 0.0
    frequencies = np.geomspace(LOWEST / plant.time, np.pi / dt * 0.9999, 2500)
    delay = control.frd(np.exp(-1j * frequencies * whole * dt), frequencies, dt)
    loop = control.frequency_response(process * law, frequencies) * delay
    gain, phase, *_ = control.stability_margins(control.frd(loop.frdata[0, 0], frequencies, dt))
    return True, float(max(gain, 1.0 / gain)), float(phase)


def _delayed(process: Any, whole: int) -> Any:
    control = _control()
    if not whole:
        return process
    shift = np.eye(whole, k=-1)
    line = control.ss(shift, np.eye(whole)[:, :1], np.eye(whole)[-1:], 0.0, process.dt)
    return process * line


def _state_space(plant: Plant) -> Any:
    """In series: lags, pairs and integrators, each in its own time, so that numbers stay near 1."""
    control = _control()
    found = control.ss([], [], [], [[plant.gain]])
    zeros = list(plant.zeros)
    for pole in (each for each in plant.poles if each.imag >= 0.0):
        if pole.imag:
            size = abs(pole)
            bottom = [1.0 / size**2, -2.0 * pole.real / size**2, 1.0]
        else:
            bottom = [-1.0 / pole.real, 1.0]
        top = [-1.0 / zeros.pop().real, 1.0] if zeros else [1.0]
        found = found * control.ss(control.tf(top, bottom))
    for _ in range(plant.integrators):
        found = found * control.ss(control.tf([1.0], [1.0, 0.0]))
    return found
