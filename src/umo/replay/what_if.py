"""What a replay with other settings commands beside what was recorded, period by period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.frame import Frame
from umo.replay.replaying import Replay

MAX_POINTS, MAX_NUMBERS = 20_000, 1 << 25
"""Points, and numbers in them, that are kept at most: beyond these every second one is dropped."""


@dataclass
class TwoCurves:
    """The values of one actuator, recorded and replayed."""

    path: str
    unit: str
    recorded: npt.NDArray[np.float64]
    replayed: npt.NDArray[np.float64]


class RawCurves:
    """An observer of a replay: the raw integers of the actuators, recorded and replayed."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._stride = 1
        self._count = 0
        self._times: list[float] = []
        self._rows: list[tuple[Any, Any]] = []

    def __call__(self, frame: Frame) -> None:
        period = self._replay.player.period
        self._count += 1
        if period is None or self._count % self._stride:
            return
        outputs = self._replay.comparison.outputs
        self._times.append(frame.time)  # copies: the raws of a period are a part of those of its block
        self._rows.append((period.raws[outputs], self._replay.comparison.replayed_raws()[outputs]))
        if len(self._rows) >= max(min(MAX_POINTS, MAX_NUMBERS // (2 * len(outputs) or 1)), 2):
            self._stride *= 2
            del self._rows[::2], self._times[::2]

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """The time of each point in s."""
        return np.array(self._times)

    def different(self) -> list[TwoCurves]:
        """The actuators that were commanded otherwise, those that differ most often first."""
        if not self._rows:
            return []
        outputs = self._replay.comparison.outputs
        recorded, replayed = (np.array([row[side] for row in self._rows]) for side in (0, 1))
        counts = (recorded != replayed).sum(axis=0)
        order = [place for place in np.argsort(-counts, kind="stable").tolist() if counts[place]]
        return [self._curve(outputs[place], recorded[:, place], replayed[:, place]) for place in order]

    def _curve(self, slot: int, recorded: Any, replayed: Any) -> TwoCurves:
        about = self._replay.layout.described.objects[slot]
        wire = next(wire for wire in self._replay.program.wired.wires if wire.path == about.path)
        values = [np.array([wire.value(raw) for raw in each.tolist()]) for each in (recorded, replayed)]
        return TwoCurves(about.path, about.unit, *values)
