"""The rows of a fleet's history: received deltas as rows of the tables of `umo.recording.tables.value_tables`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from umo.clients.fleet.run_words import RunMetadata
from umo.recording.tables.value_tables import GAPS, RunValues, table, utc_of


class TakenDelta(NamedTuple):
    """A received delta that is to be written."""

    number: int
    image: bytes
    """All words of the delta's frame."""
    rest: RunMetadata


class Gap(NamedTuple):
    """A gap: the deltas or events with these numbers are missing."""

    time: int | None
    """The time in us since 1970."""
    of: str
    first: int
    last: int
    why: str


class RunRows(RunValues):
    """The rows of one run of a fleet."""

    def values(self, taken: Sequence[TakenDelta]) -> pa.Table:
        frames = np.frombuffer(b"".join(each.image for each in taken), self._dtype)
        return self.table(frames, utc_of(frames), [each.number for each in taken], self._beside(taken))

    def _beside(self, taken: Sequence[TakenDelta]) -> Any:
        beside = np.full((len(taken), self._tunables + 2), np.nan)
        for row, each in enumerate(taken):
            if len(each.rest.tunables) == 8 * self._tunables:
                beside[row, : self._tunables] = np.frombuffer(each.rest.tunables, "<f8")
            beside[row, self._tunables :] = each.rest.mode, each.rest.missed
        return beside

    def moment(self, image: bytes) -> tuple[int, float]:
        """Return the UTC of a frame in us since 1970, and its time on the machine's clock in s."""
        frame = np.frombuffer(image, self._dtype)
        return int(utc_of(frame)[0]), float(frame["time"][0])

    def period(self, image: bytes) -> int:
        return int(np.frombuffer(image, self._dtype)["number"][0])


def gaps_table(run: str, gaps: Sequence[Gap]) -> pa.Table:
    return table(
        GAPS, [(each.time, run, each.of, each.first, each.last, each.last - each.first + 1, each.why) for each in gaps]
    )
