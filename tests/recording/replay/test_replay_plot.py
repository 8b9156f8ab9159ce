"""What is kept for the plot of a replay with other settings."""

from __future__ import annotations

import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from umo.recording.replay import what_if
from umo.recording.replay.what_if import RawCurves
from umo_command.recording import replay_run


def curves_of(recorded: Any, replayed: Any, outputs: list[int]) -> RawCurves:
    """Of these raw integers, a row for each period."""
    rows = iter(replayed)
    wires = [SimpleNamespace(path=str(slot), value=float) for slot in range(len(replayed[0]))]
    described = SimpleNamespace(objects=[SimpleNamespace(path=wire.path, unit="V") for wire in wires])
    comparison = SimpleNamespace(outputs=outputs, replayed_raws=lambda: next(rows))
    replay: Any = SimpleNamespace(
        comparison=comparison,
        player=SimpleNamespace(period=None),
        layout=SimpleNamespace(described=described),
        program=SimpleNamespace(wired=SimpleNamespace(wires=wires)),
    )
    curves = RawCurves(replay)
    for number, row in enumerate(recorded):
        replay.player.period = SimpleNamespace(raws=row)
        frame: Any = SimpleNamespace(time=0.1 * number)
        curves(frame)
    return curves


def test_the_blocks_of_a_recording_are_not_held_for_a_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(what_if, "MAX_NUMBERS", 80)
    block = np.arange(400).reshape(100, 4)
    held = weakref.ref(block)
    curves = curves_of(block, block + 1, [1, 3])
    del block
    assert held() is None
    assert all(len(each.times) == len(each.recorded) <= 20 for each in curves.different())
    assert [each.recorded[-1] + 1 == each.replayed[-1] for each in curves.different()] == [True, True]


def test_a_difference_that_is_no_command_is_not_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    block = np.zeros((3, 2), int)
    replay_run._draw(curves_of(block, block.copy(), [0, 1]), tmp_path / "plot.png", {"servo.gain": 2})
    assert "no plot" in capsys.readouterr().err and not list(tmp_path.iterdir())
