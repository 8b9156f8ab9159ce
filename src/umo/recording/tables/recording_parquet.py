"""Writes a recording in Parquet. The rows are those of a fleet's history (`umo.recording.tables.value_tables`), one for
each value of each frame.

The file contains the table `values`. Its metadata `umo` contain the descriptions of all items with values, as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from umo.recording.block import Block
from umo.recording.recording_file import utc_of
from umo.recording.tables.recorded_values import RecordedValues, TellTime
from umo.recording.tables.value_tables import VALUES, RunValues

ROWS = 1 << 20
"""Approximate number of rows of a row group."""


def write_parquet(values: RecordedValues, file: Path, progress: TellTime) -> int:
    """Write the file, and return the number of periods."""
    about, count, waiting, size = values.layout.about, 0, [], 0
    items = _items(values)
    rows = RunValues(run_name(about), values.layout, items)
    told = {"station": about.get("station"), "wiring": about.get("wiring"), "started": about.get("started")}
    told["objects"] = rows.objects().to_pylist()
    told["black_boxes"] = [box._asdict() for box in values.recording.black_boxes]
    told["black_box_count"] = values.recording.black_box_count
    beside = _Beside(values.recording.blocks(full=False) if items is None else iter(()), len(values.layout.tunables))
    with pq.ParquetWriter(
        file, VALUES.with_metadata({"umo": json.dumps(told, default=str)}), compression="zstd"
    ) as out:
        for frames, _ in values.parts():
            numbers = frames["sequence"].astype(np.int64) // 2 - 1
            utc = utc_of(values.layout, frames) // 1000
            waiting.append(rows.table(frames, utc, numbers, beside.of(frames)))
            size, count = size + len(waiting[-1]), count + len(frames)
            if size >= ROWS:
                _write(out, waiting)
                size = 0
            progress(float(frames["time"][-1]))
        _write(out, waiting)
    return count


def _write(out: Any, waiting: list[pa.Table]) -> None:
    if waiting:
        out.write_table(pa.concat_tables(waiting, promote_options="none").unify_dictionaries())
        waiting.clear()


def run_name(about: dict[str, Any]) -> str:
    """Return a short text that identifies the run."""
    return f"{about.get('pid', 0)}-{about.get('started_monotonic', 0)}"


def _items(values: RecordedValues) -> Sequence[int] | None:
    """Return the places of the chosen items among all items, of which objects and signals are the first. None means all
    items, including states, tunable numbers and the run itself."""
    every = len(values.layout.objects) + len(values.layout.signals)
    return None if len(values.places) == every else values.places


class _Beside:
    """The last known values of a run that are not in its frames: tunable numbers, mode, missed periods. They are stored
    where they change, so blocks whose values are not written must be read too."""

    def __init__(self, blocks: Iterator[Block], tunables: int) -> None:
        """`blocks`: the blocks of the recording, from the first one on; empty if only data in the frames are wanted."""
        self._blocks = blocks
        self._tunables = np.full(tunables, np.nan)
        self._mode, self._missed = -1.0, 0

    def of(self, frames: Any) -> Any:
        """Return a row for each of these frames. The frames must follow those of the last call."""
        beside = np.empty((len(frames), len(self._tunables) + 2))
        missed = self._missed_before(int(frames["sequence"][0]) // 2 - 1)
        beside[:, :-2], beside[:, -2] = self._tunables, self._mode
        beside[:, -1] = missed + np.cumsum(frames["missed"])
        return beside

    def _missed_before(self, first: int) -> int:
        """Return the number of periods that were missed before the frame with this number. The blocks are read up to
        the block of this frame."""
        for block in self._blocks:
            self._note(block.live)
            missed, before = block.frames["missed"], self._missed
            self._missed += int(missed.sum())
            if block.stop > first:
                return before + int(missed[: max(first - block.first, 0)].sum())
        return self._missed

    def _note(self, live: Mapping[str, Any]) -> None:
        if len(told := live.get("tunables") or ()) == len(self._tunables):
            self._tunables = np.array(told, np.float64)
        if (mode := live.get("mode")) is not None:
            self._mode = float(mode)
