"""Experiments on running stations. An experiment is made under the lease; its samples come from the frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from typing import Any

import numpy as np

from umo.commissioning.tuning.law_facts import LawFacts
from umo.commissioning.tuning.measured_response import MeasuredResponse
from umo.commissioning.tuning.running_station import RunningStation
from umo.errors import RangeError, UmoError
from umo.objects.presentation.value_text import measure
from umo.objects.quality import Quality
from umo.operation.commands.verbs import CALL, LET_GO
from umo.recording.scope.history import ThinnedHistory

MOST_ROWS = 200_000
"""The largest number of samples that are kept. If there are more, every second one is dropped."""
MOVES = 2
"""The number of moves, each there and back."""
BEFORE = 20
"""Number of steps of the law that are kept before the excitation."""


class CollectedSamples:
    """Output and measurement of a law in each frame of a running station, from now on. `show` is called after each
    look."""

    def __init__(self, station: RunningStation, facts: LawFacts, show: Callable[[], object]) -> None:
        self._show = show
        self._reader = station.reader.again()
        self._reader.read()  # what was before is none of it
        paths = [each.path for each in self._reader.layout.described.traced]
        self._places = [paths.index(each) for each in facts.columns]
        self._history = ThinnedHistory(len(self._places), MOST_ROWS)

    def look(self) -> None:
        """Take the frames since the last look."""
        self._history.add_frames(self._reader.read(), self._places)
        self._show()

    def response(self, start: float = -np.inf, stop: float = np.inf) -> MeasuredResponse:
        """Return the response between these times, s. Raises RangeError if there are too few samples."""
        return MeasuredResponse.of_history(self._history, range(len(self._places)), start, stop)

    def close(self) -> None:
        self._reader.close()


def facts_of(station: RunningStation, place: str, sensor: str = "", actuator: str = "") -> LawFacts:
    """Return the facts of the law at this path. This needs the lease. Raises PathError if there is no law."""
    told = station.carry_out(CALL, f"{place}.law")
    layout = station.reader.layout
    return LawFacts.of(told, sensor, actuator).described(layout.described.traced)


def experiment(
    station: RunningStation,
    place: str,
    facts: LawFacts,
    arguments: Mapping[str, Any],
    show: Callable[[], object] = lambda: None,
) -> tuple[MeasuredResponse, dict[str, Any]]:
    """Make the experiment under the lease, wait for its end, and return its response and its result. Raises the errors
    of the experiment (`umo.control.experiment`)."""
    path = f"{place}.experiment"
    with closing(CollectedSamples(station, facts, show)) as samples:
        ended = station.carry_out(CALL, path, arguments, samples.look)
        with suppress(UmoError):  # it has ended by itself
            station.carry_out(LET_GO, path)
        samples.look()
        return samples.response(ended["from"] - BEFORE * facts.dt, ended["to"]), ended


def moves(
    station: RunningStation, facts: LawFacts, distance: float, show: Callable[[], object] = lambda: None
) -> MeasuredResponse:
    """Move an axis by this distance and back, twice, under the lease. Raises RangeError if the move would leave the
    range of the axis or if the axis is not referenced, and the errors of `move_to`."""
    axis = facts.law.rpartition(".")[0]
    if station[facts.sensor].quality is Quality.UNREFERENCED:
        raise RangeError(f"{axis} is not referenced: {_how_to_home(station, axis)} first")
    start = float(station[facts.sensor].read())
    low, high = next(each for each in station.reader.layout.described.objects if each.path == facts.sensor).bounds
    inside = [each for each in (start + distance, start - distance) if low <= each <= high]
    if not inside:
        at, by = measure(start, facts.units[0]), measure(distance, facts.units[0])
        raise RangeError(f"{axis} stands at {at}: a move by {by} would leave its range")
    with closing(CollectedSamples(station, facts, show)) as samples:
        for position in (inside[0], start) * MOVES:
            station.carry_out(CALL, f"{axis}.move_to", {"position": position}, samples.look)
        samples.look()
        return samples.response()


def _how_to_home(station: RunningStation, axis: str) -> str:
    """Return the command that homes the machine; for a machine without such an action, the axis."""
    actions = [each["path"] for each in station.reader.layout.actions]
    path = "home" if "home" in actions else f"{axis}.home"
    return f"`umo do {station.reader.about['station']} call {path}`"
