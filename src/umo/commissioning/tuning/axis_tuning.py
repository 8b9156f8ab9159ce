"""Tuning of servo axes from moves: feed-forward, inertia and friction of the motor, then the velocity loop and the
position loop. A `Servo` on an encoder contains both.

The output u moves the axis at velocity v: u = feed_forward v + inertia dv/dt + friction sign(v) + offset (Armstrong,
Control of Machines with Friction, 1991). The output without friction and offset determines the velocity through a
first-order model. A derivative on the encoder is the velocity loop: gain (e - derivative_time v), so the gain of the
velocity loop is gain * derivative_time, and the gain of the position loop is 1 / derivative_time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from umo.commissioning.tuning.gain_rules import GainSet, gain_sets
from umo.commissioning.tuning.identification import Identified, identify
from umo.commissioning.tuning.margins import Gains
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.models import FIRST_ORDER, LAGGED_INTEGRATOR, ProcessModel
from umo.errors import RangeError
from umo.objects.scaling import FloatArray

SMOOTHED = 0.02
"""Time in s over which position and output are smoothed for the regression."""
FEWEST_SMOOTHED, MOST_SMOOTHED = 7, 101
MOVING = 0.05
"""Share of the largest velocity above which the axis counts as moving."""
LEAST_MOVING = 30
"""Smallest number of samples in motion."""


@dataclass(frozen=True)
class AxisModel:
    """The model of an axis."""

    identified: Identified
    """The first-order model from the output without friction and offset to the velocity."""
    velocities: MeasuredResponse
    """The response from which the model was found."""
    friction: float
    """Output that overcomes dry friction."""
    offset: float
    """The output that holds the axis at rest, for example against gravity."""

    @property
    def feed_forward(self) -> float:
        """Output for one unit of velocity."""
        return 1.0 / self.identified.model.gain

    @property
    def inertia(self) -> float:
        """Output for one unit of acceleration."""
        return self.identified.model.lags[0] / self.identified.model.gain

    @property
    def position(self) -> ProcessModel:
        """The model from the output to the position."""
        return _position(self.identified.model)

    @property
    def as_good(self) -> list[ProcessModel]:
        """The models that fit equally well, in the form of `position`."""
        return [_position(each) for each in self.identified.as_good]

    def feed_forward_with(self, gains: Gains) -> float:
        """Return the feed-forward of a `Servo`: its derivative acts on the encoder, and the feed-forward compensates
        this effect."""
        return self.feed_forward + gains.gain * gains.derivative_time


def identify_axis(response: MeasuredResponse, sign: float = 0.0) -> AxisModel:
    """Identify an axis from moves in both directions. Raises RangeError if the axis did not move enough, or if no model
    fits."""
    velocity, acceleration, output = _smoothed(response)
    moving = np.abs(velocity) > MOVING * np.abs(velocity).max()
    if np.count_nonzero(moving) < LEAST_MOVING or not (velocity[moving] > 0.0).any() or (velocity[moving] > 0.0).all():
        raise RangeError(
            "the axis must move in both directions: otherwise its friction cannot be distinguished from its speed"
        )
    direction = np.sign(velocity)
    columns = np.column_stack([velocity, acceleration, direction, np.ones(len(velocity))])[moving]
    _, _, friction, offset = np.linalg.lstsq(columns, output[moving], rcond=None)[0]
    friction = friction if friction * (sign or 1.0) > 0.0 else 0.0
    left = np.where(moving, response.outputs - friction * direction - offset, 0.0)
    velocities = replace(response, outputs=left, measurements=np.gradient(response.measurements, response.dt))
    return AxisModel(identify(velocities, (FIRST_ORDER,), sign), velocities, float(friction), float(offset))


def axis_sets(axis: AxisModel, dt: float) -> list[GainSet]:
    """Return the gains of the `Servo`. They determine the gains of its velocity loop and its position loop."""
    return gain_sets(axis.position, dt, axis.as_good)


def _position(velocity: ProcessModel) -> ProcessModel:
    return replace(velocity, kind=LAGGED_INTEGRATOR)


def _smoothed(response: MeasuredResponse) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the smoothed velocity, acceleration and output (Savitzky and Golay, Anal. Chem. 36, 1964)."""
    from scipy.signal import savgol_filter

    dt = response.dt
    count = int(np.clip(round(SMOOTHED / dt), FEWEST_SMOOTHED, MOST_SMOOTHED)) | 1
    if len(response.outputs) < 2 * count:
        raise RangeError(f"{len(response.outputs)} samples are too few for an axis; {2 * count} are needed")
    velocity = savgol_filter(response.measurements, count, 2, deriv=1, delta=dt)
    acceleration = savgol_filter(response.measurements, count, 2, deriv=2, delta=dt)
    return velocity, acceleration, savgol_filter(response.outputs, count, 2)
