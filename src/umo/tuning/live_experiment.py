"""Experiments on stations that run: the experiment under the lease, and its samples from the frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from umo.errors import RangeError, UmoError
from umo.frames.reader import Frames
from umo.objects import Quality
from umo.objects.scaling import FloatArray
from umo.presentation.value_text import measure
from umo.remote import RemoteStation
from umo.remote.remote_objects import release_action
from umo.tuning.law_facts import LawFacts
from umo.tuning.measured_response import MeasuredResponse

MOST_ROWS = 200_000
"""Samples that are kept: of more, every second one is dropped."""
MOVES = 2
"""Moves there and back."""
BEFORE = 20
"""Steps of the law that are kept before the excitation."""


@dataclass
class CollectedSamples:
    """Time, output and measurement of each frame of a running station."""

    station: RemoteStation
    facts: LawFacts
    _parts: list[FloatArray] = field(default_factory=list)
    _count: int = 0
    _stride: int = 1

    def __post_init__(self) -> None:
        reader = self.station.reader
        self._reader = reader.again()
        self._reader.read()  # what was before is none of it
        layout = reader.layout
        self._objects = len(layout.objects)
        paths = [str(each["path"]) for each in (*layout.objects, *layout.signals)]
        self._places = [paths.index(each) for each in self.facts.columns]

    def look(self) -> None:
        """Take the frames since the last look."""
        frames = self._reader.read()
        if not len(frames):
            return
        values = np.column_stack([self._column(frames, place) for place in self._places])
        kept = frames["number"] % self._stride == 0
        self._parts.append(np.column_stack([frames["time"], values])[kept])
        self._count += int(np.count_nonzero(kept))
        if self._count > MOST_ROWS:
            self._stride *= 2
            self._parts = [np.concatenate(self._parts)[::2]]
            self._count = len(self._parts[0])

    def response(self, start: float = -np.inf, stop: float = np.inf) -> MeasuredResponse:
        """Between these times, s. RangeError if there are too few samples."""
        rows = np.concatenate([np.zeros((0, 1 + len(self._places))), *self._parts])
        rows = rows[(rows[:, 0] >= start) & (rows[:, 0] <= stop)]
        return MeasuredResponse.of_rows(rows)

    def _column(self, frames: Frames, place: int) -> FloatArray:
        """An object, where it is bad NaN; or a signal."""
        if place >= self._objects:
            return frames["signals"][:, place - self._objects]
        return np.where(frames["quality"][:, place] >= Quality.BAD, np.nan, frames["values"][:, place])

    def close(self) -> None:
        self._reader.close()


def facts_of(station: RemoteStation, place: str, sensor: str = "", actuator: str = "") -> LawFacts:
    """What the law at this path is made of. It needs the lease. PathError if there is no law."""
    told = station.ask("call", f"{place}.law", arguments={})
    layout = station.reader.layout
    return LawFacts.of(told, sensor, actuator).described((*layout.described.objects, *layout.described.signals))


def experiment(
    station: RemoteStation,
    place: str,
    facts: LawFacts,
    arguments: Mapping[str, Any],
    show: Callable[[], object] = lambda: None,
) -> tuple[MeasuredResponse, dict[str, Any]]:
    """Make the experiment under the lease, and wait for its end: its response, and what it returned. The errors are
    those of the experiment (`umo.control.experiment`)."""
    path, samples = f"{place}.experiment", CollectedSamples(station, facts)
    try:

        def look() -> None:
            samples.look()
            show()

        with station.holding(path):
            ended = station.ask("call", path, arguments=dict(arguments), while_running=look)
        with suppress(UmoError):  # it has ended by itself
            release_action(station, path)
        samples.look()
        return samples.response(ended["from"] - BEFORE * facts.dt, ended["to"]), ended
    finally:
        samples.close()


def moves(
    station: RemoteStation, facts: LawFacts, distance: float, show: Callable[[], object] = lambda: None
) -> MeasuredResponse:
    """Move an axis by this distance and back, twice, under the lease. RangeError if it does not fit in the range of the
    axis; the other errors are those of `move_to`."""
    axis, samples = facts.law.rpartition(".")[0], CollectedSamples(station, facts)
    start = float(station[facts.sensor].read())
    low, high = next(each for each in station.reader.layout.described.objects if each.path == facts.sensor).bounds
    inside = [each for each in (start + distance, start - distance) if low <= each <= high]
    if not inside:
        at, by = measure(start, facts.units[0]), measure(distance, facts.units[0])
        raise RangeError(f"{axis} stands at {at}: a move by {by} leaves its range")

    def look() -> None:
        samples.look()
        show()

    try:
        for position in (inside[0], start) * MOVES:
            station.ask("call", f"{axis}.move_to", arguments={"position": position}, while_running=look)
        samples.look()
        return samples.response()
    finally:
        samples.close()
