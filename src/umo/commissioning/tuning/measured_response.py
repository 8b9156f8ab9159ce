"""Measured responses: the output and the measurement of a law at evenly spaced times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from umo.errors import RangeError
from umo.objects.scaling import FloatArray
from umo.recording.scope.history import ValueHistory

MIN_RESPONSE_SAMPLES = 20
"""Smallest number of samples of a response."""
MAX_RESPONSE_SAMPLES = 2000
"""The largest number of samples that are kept. In a longer response each sample stands for several."""
LEAST_MOVES = 3
"""The number of resolutions by which the output must have moved."""
MIN_SIGNAL_TO_NOISE = 1.5
"""Least spread of the measurement, in standard deviations of its noise."""


@dataclass(frozen=True)
class MeasuredResponse:
    """Samples of one response."""

    dt: float
    """Time in s from one sample to the next."""
    outputs: FloatArray
    """The output that was held after each sample."""
    measurements: FloatArray
    inner: MeasuredResponse | None = None
    """The measurement of the inner law of a cascade, whose setpoints are the outputs; None without a cascade."""

    @classmethod
    def of_rows(cls, rows: FloatArray) -> MeasuredResponse:
        """Return a response like `of`. The columns are time, output, measurement, and for a cascade the inner
        measurement."""
        found = cls.of(rows[:, 0], rows[:, 1], rows[:, 2])
        return found if rows.shape[1] < 4 else replace(found, inner=cls.of(rows[:, 0], rows[:, 1], rows[:, 3]))

    @classmethod
    def of_history(
        cls, history: ValueHistory, columns: Sequence[int], start: float = -np.inf, stop: float = np.inf
    ) -> MeasuredResponse:
        """Return a response like `of_rows`, from these columns of a run between these times in s."""
        times, values = history.between(start, stop, columns)
        return cls.of_rows(np.column_stack([times, *values]))

    @classmethod
    def of(cls, times: FloatArray, outputs: FloatArray, measurements: FloatArray) -> MeasuredResponse:
        """Make a response from rows in the order of time (s); rows may be missing. Raises RangeError if there are too
        few rows, or if the times do not rise."""
        known = np.isfinite(times) & np.isfinite(outputs) & np.isfinite(measurements)
        times, outputs, measurements = times[known], outputs[known], measurements[known]
        if len(times) < MIN_RESPONSE_SAMPLES:
            raise RangeError(
                f"{len(times)} samples have a time, an output and a measurement; at least {MIN_RESPONSE_SAMPLES} are "
                f"needed"
            )
        steps = np.diff(times)
        if not (steps > 0.0).all():
            raise RangeError("the times of the samples do not increase")
        dt = float(np.median(steps))
        if steps.max() > 1.5 * dt:
            even = np.arange(times[0], times[-1] + 0.5 * dt, dt)
            places = np.clip(np.searchsorted(times, even + 1e-6 * dt, side="right") - 1, 0, None)
            outputs, measurements = outputs[places], np.interp(even, times, measurements)
        return cls(dt, outputs, measurements)

    @property
    def times(self) -> FloatArray:
        """The times in s since the first sample."""
        found: FloatArray = np.arange(len(self.outputs), dtype=np.float64) * self.dt
        return found

    @property
    def duration(self) -> float:
        """Duration in s."""
        return len(self.outputs) * self.dt

    def thinned(self, most: int = MAX_RESPONSE_SAMPLES) -> MeasuredResponse:
        """Return a response with at most this number of samples: each sample has the measurement at its time, and the
        mean of the outputs until the next sample."""
        every = -(-len(self.outputs) // most)
        if every == 1:
            return self
        count = len(self.outputs) // every
        outputs = self.outputs[: count * every].reshape(count, every).mean(axis=1)
        return MeasuredResponse(self.dt * every, outputs, self.measurements[: count * every : every])

    def check_moved(self, resolution: float = 0.0, output: str = "the output", measurement: str = "") -> None:
        """Check that the response is usable. Raises RangeError unless the output moved by `LEAST_MOVES` resolutions,
        and the measurement by more than its noise."""
        moved = float(np.ptp(self.outputs))
        if moved <= max(LEAST_MOVES * resolution, 1e-12 * float(np.abs(self.outputs).max())):
            raise RangeError(
                f"{output} moved by only {moved:g} in {self.duration:g} s: the gains cannot be found from this; "
                f"make an experiment with --step or --relay"
            )
        spread, noise = float(np.std(self.measurements)), self.noise
        if not spread or spread < MIN_SIGNAL_TO_NOISE * noise:
            raise RangeError(
                f"{measurement or 'the measurement'} shows no response: it changes by {spread:.3g}, and its noise is "
                f"{noise:.3g}; use a larger amplitude"
            )

    @property
    def noise(self) -> float:
        """Standard deviation of the noise of the measurement, from its second differences."""
        second = np.diff(self.measurements, 2)
        return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0))
