"""Replays of the stations that ship: seeds, wirings, injected faults, processes that run in real time."""

from __future__ import annotations

from typing import Any

import pytest

from helpers.tapes import recorded
from tools import fault_matrix as matrix
from umo.errors import OptionError
from umo.recording.replay.replaying import replay

pytest.importorskip("mujoco")

RUNS: list[tuple[str, dict[str, Any]]] = [
    ("conveyor", {}),
    ("conveyor", {"fault": ["sorter.exit noise 1 %"], "fault_seed": 7}),
    ("batch", {}),
    ("furnace", {}),
    ("ztheta", {"parts": 1, "seed": 1}),
    ("ztheta", {"wiring": "second_generation", "parts": 1}),
    ("conveyor", {"wiring": "hertz"}),
    *(("ztheta", {"seed": seed}) for seed in range(3)),
    *(("conveyor", {"seed": seed}) for seed in range(3)),
    *(("batch", {"seed": seed}) for seed in range(3)),
    ("furnace", {"zones": 1000}),
]


@pytest.mark.full  # test_replay_command.py has the conveyor in make test
@pytest.mark.parametrize(("station", "options"), RUNS, ids=str)
def test_a_replay_of_a_station_is_identical(station: str, options: dict[str, Any]) -> None:
    tape = recorded(station, **options)
    result = replay(tape)
    assert result.identical, str(result)
    assert result.periods == len(tape.frames) > 1000


@pytest.mark.full
@pytest.mark.parametrize("station", ["ztheta", "furnace", "conveyor", "batch"])
def test_a_replay_of_a_station_under_every_fault_is_identical(station: str) -> None:
    trial = matrix.TRIALS[station]
    options = trial.machine | trial.options
    different = []
    for cell in matrix.cells(station):
        tape = recorded(station, fault=[cell.fault], **options)
        if tape.recorded and not (result := replay(tape)).identical:
            different.append(f"{cell.fault}: {result}")
    assert different == []


@pytest.mark.full
def test_other_values_are_tried_in_open_loop_beyond_the_first_difference() -> None:
    tape = recorded("conveyor")
    result = replay(tape, settings={"sorter.push_time": 0.09})
    assert result.difference is not None and result.periods == len(tape.frames)


@pytest.mark.full
def test_a_number_that_there_is_not_is_told_with_the_nearest() -> None:
    with pytest.raises(OptionError, match="no such number"):
        replay(recorded("conveyor"), settings={"sorter.sped": 1.0})
