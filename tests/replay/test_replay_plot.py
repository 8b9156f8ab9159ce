"""What is kept for the plot of a replay with other settings."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from umo.cli import replay_run
from umo.replay import what_if
from umo.replay.what_if import RawCurves


def curves_of(recorded: Any, replayed: Any, outputs: list[int]) -> RawCurves:
    """Of these raw integers, a row for each period."""
    rows = iter(replayed)
    comparison = SimpleNamespace(outputs=outputs, replayed_raws=lambda: next(rows))
    replay: Any = SimpleNamespace(comparison=comparison, player=SimpleNamespace(period=None))
    curves = RawCurves(replay)
    for number, row in enumerate(recorded):
        replay.player.period = SimpleNamespace(raws=row)
        frame: Any = SimpleNamespace(time=0.1 * number)
        curves(frame)
    return curves


def test_the_blocks_of_a_recording_are_not_held_for_a_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    block = np.arange(400).reshape(100, 4)
    curves = curves_of(block, block.copy(), [1, 3])
    assert all(not np.shares_memory(row, block) and len(row) == 2 for row, _ in curves._rows)
    monkeypatch.setattr(what_if, "MAX_NUMBERS", 80)
    assert len(curves_of(block, block.copy(), [1, 3])._rows) <= 20


def test_a_difference_that_is_no_command_is_not_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    block = np.zeros((3, 2), int)
    replay_run._draw(curves_of(block, block.copy(), [0, 1]), tmp_path / "plot.png", {"servo.gain": 2})
    assert "no plot" in capsys.readouterr().err and not list(tmp_path.iterdir())
