"""Collects the commands of a replay with other settings, together with the recorded commands, period by period."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from umo.cycle.frame import Frame
from umo.objects.scaling import FloatArray
from umo.recording.replay.replaying import Replay
from umo.recording.scope.history import ThinnedHistory

MAX_POINTS, MAX_NUMBERS = 20_000, 1 << 25
"""Largest numbers of points, and of numbers in them, that are kept. Above these limits every second point is
dropped."""


@dataclass
class TwoCurves:
    """The values of one actuator, recorded and replayed."""

    path: str
    unit: str
    times: FloatArray
    """Times of the points in s."""
    recorded: FloatArray
    replayed: FloatArray


class RawCurves:
    """An observer of a replay that collects the raw integers of the actuators, recorded and replayed."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._histories: tuple[ThinnedHistory, ThinnedHistory] | None = None

    def __call__(self, frame: Frame) -> None:
        period, comparison = self._replay.player.period, self._replay.comparison
        if period is None:
            return
        if self._histories is None:  # the comparison is there from the first period on
            count = len(comparison.outputs)
            most = min(MAX_POINTS, MAX_NUMBERS // (2 * count or 1))
            self._histories = ThinnedHistory(count, most), ThinnedHistory(count, most)
        time = np.array([frame.time])
        for history, raws in zip(self._histories, (period.raws, comparison.replayed_raws()), strict=True):
            history.add(time, raws[np.newaxis, comparison.outputs])

    def different(self) -> list[TwoCurves]:
        """Return the actuators whose commands differ from the recorded ones, those that differ most often first."""
        if self._histories is None:
            return []
        outputs = self._replay.comparison.outputs
        (times, recorded), (_, replayed) = (each.between(-inf, inf, range(len(outputs))) for each in self._histories)
        counts = (recorded != replayed).sum(axis=1)
        order = [place for place in np.argsort(-counts, kind="stable").tolist() if counts[place]]
        return [self._curve(outputs[place], times, recorded[place], replayed[place]) for place in order]

    def _curve(self, slot: int, times: FloatArray, recorded: FloatArray, replayed: FloatArray) -> TwoCurves:
        about = self._replay.layout.described.objects[slot]
        wire = next(wire for wire in self._replay.program.wired.wires if wire.path == about.path)
        values = [np.array([wire.value(int(raw)) for raw in each.tolist()]) for each in (recorded, replayed)]
        return TwoCurves(about.path, about.unit, times, *values)
