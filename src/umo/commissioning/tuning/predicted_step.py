"""Predicted steps: the response of a loop of umo's `PID` and a model to a step of the setpoint."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import inf

import numpy as np

from umo.commissioning.tuning.margins import Gains
from umo.commissioning.tuning.models import ProcessModel
from umo.control import PID
from umo.objects.scaling import FloatArray

MOST_STEPS = 2000
"""The largest number of computed periods. For a longer time, longer periods are used."""
SETTLED = 0.05
"""Share of a step within which the response counts as settled."""


@dataclass(frozen=True)
class PredictedStep:
    """The answer to a step of the setpoint from 0 to `size`."""

    times: FloatArray
    measurements: FloatArray
    outputs: FloatArray
    size: float

    @property
    def overshoot(self) -> float:
        """Overshoot in per cent of the step."""
        return max(100.0 * (float((self.measurements / self.size).max()) - 1.0), 0.0)

    @property
    def settling_time(self) -> float:
        """Time in s until the response stays within 5 %; infinite if this does not happen within the computed time."""
        away = np.flatnonzero(np.abs(self.measurements / self.size - 1.0) > SETTLED)
        if len(away) and away[-1] == len(self.times) - 1:
            return inf
        return float(self.times[away[-1] + 1]) if len(away) else 0.0


def predicted_step(
    model: ProcessModel, gains: Gains, dt: float, duration: float, size: float = 1.0, limit: float = inf
) -> PredictedStep:
    """Predict a step over `duration` s. `limit`: the largest change of the output, which stands for the limits of the
    actuator."""
    dt = max(dt, duration / MOST_STEPS)
    count = max(int(duration / dt), 2)
    law = PID(**asdict(gains))
    impulse = np.zeros(count + 1)
    impulse[1] = 1.0
    weights = model.response(impulse, dt)[1:]
    measurements, outputs = np.zeros(count), np.zeros(count)
    law.step(0.0, 0.0, dt)  # at rest
    for now in range(count):
        measurements[now] = weights[now:0:-1] @ outputs[:now] if now else 0.0
        outputs[now] = law.step(size, float(measurements[now]), dt, low=-limit, high=limit)
    times: FloatArray = np.arange(count, dtype=np.float64) * dt
    return PredictedStep(times, measurements, outputs, size)
