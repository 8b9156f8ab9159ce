"""Every wait for another process has a limit: here that one is stopped, or says nothing (docs/waits.md)."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe
from helpers.waiting import until
from umo.process import run_state
from umo.process.run_state import RunState, Who
from umo.system import processes

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


# A process that is forked and does not come to hold its lock ------------------------------------------------


def stop_myself() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def work_for_ever() -> None:
    while True:
        pass


@pytest.mark.parametrize(
    ("does", "why"),
    [
        (stop_myself, "a process that was forked was stopped by a signal before it had begun"),
        (signal.pause, "a process that was forked did not begin within 0.1 s"),
        (work_for_ever, "a process that was forked did not begin within 0.1 s"),
    ],
)
def test_a_process_that_does_not_begin_is_ended(monkeypatch: pytest.MonkeyPatch, does: object, why: str) -> None:
    monkeypatch.setattr(run_state, "FORK_TIMEOUT", 0.1 if does is not stop_myself else 60.0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: does())  # type: ignore[operator]
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    with pytest.raises(OSError, match=why):
        RunState().fork(Who.STANDBY)
    assert processes.state(forked[0]) == "X"  # ended, and waited for


def test_a_process_that_goes_on_in_time_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A debugger, or the test of a supervisor, stops processes for a moment."""
    monkeypatch.setattr(run_state, "STOPPED_TIMEOUT", 30.0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: stop_myself())
    forked: list[int] = []
    fork = os.fork
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])

    def let_go_on() -> None:
        until(lambda: forked and processes.is_stopped(forked[0]))
        os.kill(forked[0], signal.SIGCONT)

    helper = threading.Thread(target=let_go_on)
    helper.start()
    pid = RunState().fork(Who.STANDBY)
    if pid == 0:
        os._exit(0)
    helper.join(30.0)
    assert os.waitpid(pid, 0)[1] == 0


def test_a_process_that_has_to_wait_for_a_processor_is_not_taken_for_a_stopped_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_state, "STOPPED_TIMEOUT", 1e-6)
    end, begin = os.pipe()
    monkeypatch.setattr(RunState, "hold", lambda state, who: os.read(end, 1))
    looks: list[float] = []

    def watch(state: RunState) -> None:
        looks.append(1.0)
        if len(looks) == 3:
            os.write(begin, b"!")

    monkeypatch.setattr(RunState, "watch", watch)
    pid = RunState().fork(Who.STANDBY)
    if pid == 0:
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0
    assert len(looks) >= 3  # the guardian has given signs of life meanwhile


def test_nobody_waits_for_a_process_to_begin_when_the_control_process_has_died(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_state, "FORK_TIMEOUT", 60.0)
    state = RunState()
    control = state.fork(Who.CONTROL)
    if control == 0:
        signal.pause()
    state.admit()
    os.kill(control, signal.SIGKILL)
    os.waitpid(control, 0)
    monkeypatch.setattr(RunState, "hold", lambda state, who: signal.pause())
    with pytest.raises(OSError, match="the machine is to be reset"):
        state.fork(Who.STANDBY)


def stop_those_that_begin(monkeypatch: pytest.MonkeyPatch, who: Who, when: Path) -> None:
    """While the file is there, a process of this kind is stopped before it holds its lock."""
    hold = RunState.hold

    def stopped(state: RunState, number: int) -> None:
        if number == who and when.exists():
            stop_myself()
        hold(state, number)

    monkeypatch.setattr(RunState, "hold", stopped)


@pytest.mark.parametrize("who", [Who.CONTROL, Who.STANDBY])
def test_a_run_whose_process_is_stopped_as_it_begins_comes_to_an_end(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch, who: Who
) -> None:
    stop_those_that_begin(monkeypatch, who, tmp_path)
    run = Run(process_box.wiring(tmp_path / "box"))
    outcome = run.outcome()
    if who is Who.CONTROL:
        assert outcome.failure is not None
        assert outcome.failure.message == "a process that was forked was stopped by a signal before it had begun"
    else:
        assert outcome.status == 0
        assert [each for each in run.notices if each.startswith("no standby guardian: a process that was forked was")]
    assert_safe(cells)


def test_a_standby_guardian_stopped_as_it_begins_does_not_keep_the_guardian_from_resetting(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    when = tmp_path / "now"
    stop_those_that_begin(monkeypatch, Who.STANDBY, when)
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    when.touch()
    os.kill(run.standby, signal.SIGKILL)
    assert run.message("notice")["text"].startswith("the standby guardian was killed or stopped")
    assert run.message("notice")["text"].startswith("no standby guardian: a process that was forked was stopped")
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)
