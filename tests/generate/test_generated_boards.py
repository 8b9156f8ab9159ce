"""A generated controller on emulated boards, beside the machine in Python: doubles are equal to the bit, floats lie
within one raw step. Needs cross compilers and emulators; a test without them is skipped and says which."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.controllers import BOARDS, MACHINES, TRIALS, command_of, run_beside
from helpers.peers.text_devices import CannotRun

PERIODS = 10_000
pytestmark = pytest.mark.full


@pytest.mark.parametrize(("board", "machine"), TRIALS)
def test_ten_thousand_random_periods_on_a_board(board: str, machine: str, tmp_path: Path) -> None:
    kind, tried = BOARDS[board], MACHINES[machine]
    try:
        command = command_of(kind, tried, tmp_path)
    except CannotRun as error:
        pytest.skip(str(error))
    assert run_beside(tried, command, kind.allowed, PERIODS).differ <= PERIODS / 20
