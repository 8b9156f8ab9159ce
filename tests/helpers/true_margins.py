"""The margins of a loop as python-control has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from umo.tuning.margins import Gains
from umo.tuning.models import ProcessModel


def true_margins(model: ProcessModel, gains: Gains, dt: float) -> tuple[float, float]:
    """Gain margin and phase margin in degrees: the process sampled with a held output, behind whole periods of dead
    time."""
    import control as imported

    control: Any = imported
    s = control.tf("s")
    lags = [lag * s + 1 for lag in model.lags] + [s] * model.integrates
    process = control.tf([model.gain], [1.0])
    for each in lags:
        process = process / each
    sampled = control.tf(control.sample_system(process, dt, "zoh"))
    z = control.tf([1.0, 0.0], [1.0], dt)
    law = control.tf([gains.gain], [1.0], dt) * (1 + dt / gains.integral_time * z / (z - 1))
    if gains.derivative_time:
        share = dt / (gains.filter_time + dt)
        law += gains.gain * gains.derivative_time * share / dt * (z - 1) / (z - (1 - share))
    frequencies = np.geomspace(1e-5, np.pi / dt * 0.999, 4000)
    delay = control.frd(np.exp(-1j * frequencies * round(model.dead_time / dt) * dt), frequencies, dt)
    loop = control.frequency_response(sampled * law, frequencies) * delay
    gain, phase, *_ = control.margin(loop.magnitude, np.degrees(loop.phase), frequencies)
    return float(gain), float(phase)
