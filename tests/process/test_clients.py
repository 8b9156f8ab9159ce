"""What clients of a run under a guardian can do to it: stop it at once, and nothing that costs it anything."""

from __future__ import annotations

import os
import random
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

import umo
from helpers import process_box
from helpers.process_box import Cells as Box
from helpers.runs import Run, assert_safe
from helpers.tiers import first
from helpers.waiting import until
from umo.errors import FramesError
from umo.process.control_process import Control
from umo.process.frames import rings
from umo.process.frames.client_memory import ClientMemory
from umo.process.frames.frame_server import folder
from umo.system import realtime

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture
def box(tmp_path: Path) -> Box:
    return Box(tmp_path / "box")


def test_a_client_stops_a_run_that_waits_for_a_tick_of_ten_minutes(tmp_path: Path, box: Box) -> None:
    wiring = process_box.wiring(tmp_path / "box", process={"hang_timeout": 36_000.0})
    wiring["wire"]["timer"]["period"] = 600.0
    run = Run(wiring, "forever")
    until(rings)
    with umo.attach() as station:
        assert station.mode == "automatic"
        station.stop("ann, a test (pid 1)")
        until(lambda: not station.running)
    outcome = run.outcome()
    assert (outcome.stopped_by, outcome.stopped_who, outcome.failure) == (signal.SIGTERM, "ann, a test (pid 1)", None)
    assert_safe(box)


def test_a_signal_ends_a_wait_of_ten_minutes_too(tmp_path: Path, box: Box) -> None:
    wiring = process_box.wiring(tmp_path / "box", process={"hang_timeout": 36_000.0})
    wiring["wire"]["timer"]["period"] = 600.0
    run = Run(wiring, "forever")
    until(rings)
    run.channel.send("stop", signal=signal.SIGINT)
    outcome = run.outcome()
    assert (outcome.stopped_by, outcome.stopped_who) == (signal.SIGINT, "")
    assert_safe(box)


@pytest.mark.parametrize("number", first(1, [signal.SIGINT, signal.SIGHUP]))
def test_the_signal_stands_with_which_a_run_is_stopped_before_it_connects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """The guardian passes it on with SIGTERM."""
    preparing, noted = tmp_path / "preparing", tmp_path / "noted"
    prepare, take_note = realtime.prepare, Control.take_note

    def prepared(*arguments: Any) -> list[realtime.Refusal]:
        preparing.touch()
        until(noted.exists)
        return prepare(*arguments)

    def taking_note(self: Control, number: int, frame: object) -> None:
        take_note(self, number, frame)
        noted.touch()

    monkeypatch.setattr(realtime, "prepare", prepared)
    monkeypatch.setattr(Control, "take_note", taking_note)
    run = Run(process_box.wiring(tmp_path / "box"), "forever")
    until(preparing.exists)
    run.channel.send("stop", signal=number)
    assert run.outcome().stopped_by == number


def test_a_process_that_control_code_forked_does_not_pass_for_the_run(tmp_path: Path) -> None:
    """It lives on when the control process is killed."""
    told = tmp_path / "told"
    run = Run(process_box.wiring(tmp_path / "box"), "forks_and_waits", options={"told": str(told)}).until_running()
    with umo.attach() as station:
        until(lambda: told.exists() and told.read_text())
        os.kill(run.control, signal.SIGKILL)
        run.outcome()
        running = station.running
    os.kill(int(told.read_text()), signal.SIGKILL)
    assert not running


def test_garbage_in_the_cells_and_hostile_calls_cost_the_run_nothing(tmp_path: Path, box: Box) -> None:
    chance = random.Random(3)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    with umo.attach() as station:
        reader = station.reader
        assert reader.ends is not None
        for hostile in (
            lambda: os.ftruncate(reader.ends.frames, 0),
            lambda: os.pwrite(reader.ends.frames, bytes(64), 0),
            lambda: os.ftruncate(reader.ends.cells, 0),
        ):
            with pytest.raises(PermissionError):
                hostile()
        cells = ClientMemory(reader.ends.cells, reader.layout)
        for _ in range(300):
            at = chance.randrange(len(cells.memory) - 64)
            cells.memory[at : at + 64] = chance.choice([bytes(64), b"\xff" * 64, chance.randbytes(64)])
        cells.memory[:] = chance.randbytes(len(cells.memory))
        head = reader.head
        until(lambda: reader.head > head + 100)
        until(lambda: reader.dropped > 0)
        with station.lease("a test"):  # commands come through again
            pass
        cells.close()
        station.stop("ann")
    outcome = run.outcome()
    assert (outcome.stopped_who, outcome.failure, outcome.unsafe) == ("ann", None, False)
    assert_safe(box)


def test_nothing_of_a_run_whose_processes_are_killed_is_left_behind(tmp_path: Path, box: Box) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    with umo.attach() as station:
        for pid in (run.guardian, run.control):
            os.kill(pid, signal.SIGKILL)
        os.waitpid(run.guardian, 0)
        until(lambda: not station.running)
        assert len(station.reader.read()) > 0  # who has the frames keeps them
        with pytest.raises(FramesError, match="has ended"):
            station.stop()
    until(lambda: rings() == [])
    assert list(folder().iterdir()) == []
    run.channel.close()


def test_a_run_whose_guardian_is_stopped_does_not_hold_up_who_looks(
    tmp_path: Path, box: Box, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "1 h"}), "forever").until_running()
    os.kill(run.guardian, signal.SIGSTOP)
    assert len(rings()) == 1
    with monkeypatch.context() as patch:
        patch.setattr("umo.process.frames.frame_server.STOPPED_TIMEOUT", 0.05)
        with pytest.raises(FramesError, match=rf"guardian of this run is stopped .* \(pid {run.guardian}\)$"):
            umo.attach()
    os.kill(run.guardian, signal.SIGCONT)
    with umo.attach() as station:
        station.stop()
    assert run.outcome().failure is None
