"""The margins of a loop as python-control has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from umo.tuning.margins import Gains
from umo.tuning.models import ProcessModel


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
    law = control.tf([gains.gain], [1.0], dt) * (1 + dt / gains.integral_time * z / (z - 1))
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
