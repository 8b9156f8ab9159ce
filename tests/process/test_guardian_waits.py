"""A guardian that waits for another process sends its heartbeats meanwhile, even if that one cannot be killed."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, until_dead
from umo.process import keeper as keeper_module
from umo.process import reset
from umo.process.control_watch import ControlWatch
from umo.process.frame_watcher import FrameWatcher
from umo.process.keeper import Keeper
from umo.process.outcome import Outcome
from umo.process.run_end import RunEnd
from umo.process.run_state import RunState, Who
from umo.process.standby import Standby
from umo.process.workers import Workers, groups_of
from umo.system import calls, processes
from umo.wiring import resolve

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")
MAX_SILENCE = 0.05
"""s between two heartbeats of a guardian that waits; others wait 0.5 s at least."""


class Blocked(processes.Child):
    """A child that was stopped, and that no signal ends: it is blocked in a call of the kernel."""

    ended = is_stopped = False  # type: ignore[assignment]

    def __init__(self) -> None:
        super().__init__(os.getpid())
        self.was_stopped = True

    def send(self, number: int) -> None:
        assert number == signal.SIGKILL


class Guarding:
    """A guardian's parts, with children that are all blocked, and a clock that goes on by waiting."""

    def __init__(self, folder: Path) -> None:
        plan = Mock(machine=process_box.machine())
        wiring = process_box.wiring(folder / "box", off_cycle=True)
        wiring["drivers"]["box"]["period"] = "20 ms"
        plan.wired = resolve(plan.machine, wiring)
        groups = groups_of(plan.wired)
        self.state, self.now, self.silences, self._last = RunState(len(groups)), 100.0, list[float](), 100.0
        self.workers = Workers(plan.machine, plan.wired, groups, self.state, Mock())
        self.keeper = Keeper(folder / "kept", Mock(), self.state, Mock())
        self.keeper._keeps, self.keeper._cells[keeper_module.KeeperMessage.BEGUN] = True, 1
        self.watcher = FrameWatcher("press")
        self.end = RunEnd(plan, Mock(), self.state, Mock(), self.watcher, self.workers, self.keeper)
        self.standby = Standby(self.state, 1.0, Mock(), Mock(), Mock())
        self.control = ControlWatch(os.getpid(), self.state, 0)
        for holder, name in (
            (self.workers._groups[0], "child"),
            (self.keeper, "_child"),
            (self.watcher, "_child"),
            (self.standby, "_child"),
            (self.standby, "_guardian"),
            (self.control, "process"),
            (self.end.resetter, "_reserve"),
        ):
            setattr(holder, name, Blocked())

    def watch(self) -> None:
        self.silences.append(self.now - self._last)
        self._last = self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds

    def gone(self, within: float, who: int = Who.CONTROL) -> bool:
        """Each lock has a living holder."""
        self.now += within
        return False


@pytest.fixture
def guarding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Guarding:
    guarding = Guarding(tmp_path)
    monkeypatch.setattr(guarding.state, "watch", guarding.watch)
    monkeypatch.setattr(guarding.state, "gone", guarding.gone)
    monkeypatch.setattr(guarding.end.resetter, "reset", lambda *given, **more: {})
    monkeypatch.setattr(guarding.watcher, "_attach", lambda: True)
    monkeypatch.setattr(FrameWatcher, "reader", Mock())
    monkeypatch.setattr(calls, "now", lambda: guarding.now)
    monkeypatch.setattr(calls, "sleep", guarding.wait)
    return guarding


WAITS: dict[str, tuple[Callable[[Guarding], Any], float]] = {
    "standby guardian": (lambda guarding: guarding.standby.dismiss(), reset.DEATH_TIMEOUT),
    "guardian before it": (lambda guarding: guarding.standby._make_sure(), reset.DEATH_TIMEOUT),
    "reset process": (lambda guarding: guarding.end.resetter.dismiss(), reset.DEATH_TIMEOUT),
    "reset under way": (lambda guarding: guarding.end._reset(Mock(), Mock()), reset.DEATH_TIMEOUT),
    "worker": (lambda guarding: guarding.workers.dismiss(), reset.DEATH_TIMEOUT),
    "worker of another guardian's": (lambda guarding: guarding.state.end(5, 5.0), reset.DEATH_TIMEOUT),
    "control process": (lambda guarding: guarding.control.ending(), reset.DEATH_TIMEOUT),
    "keeper that was stopped": (lambda guarding: guarding.keeper._end(), reset.DEATH_TIMEOUT / 10),
    "all at the end": (lambda guarding: guarding.end.tell(Outcome()), 20.0),
}


@pytest.mark.parametrize("process", WAITS)
def test_a_guardian_that_waits_for_a_process_that_cannot_be_killed_sends_its_heartbeats(
    guarding: Guarding, process: str
) -> None:
    wait, at_least = WAITS[process]
    began = guarding.now
    wait(guarding)
    guarding.watch()
    assert guarding.now - began >= at_least - 0.1  # it has waited
    assert max(guarding.silences) <= MAX_SILENCE


@pytest.mark.full
def test_a_guardian_that_waits_for_a_process_that_cannot_be_killed_stays_the_guardian(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The standby guardian waits 0.5 s for its heartbeats."""
    monkeypatch.setattr(reset, "DEATH_TIMEOUT", 2.0)
    send, now = processes.Child.send, tmp_path / "now"
    monkeypatch.setattr(processes.Child, "send", lambda child, number: now.exists() or send(child, number))
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "0.5 s"}), "forever").until_running()
    now.touch()
    reserve = run.reserve
    os.kill(reserve, signal.SIGSTOP)
    assert run.message("notice")["text"].startswith("the process that waits to reset the machine was killed or stopped")
    now.unlink()
    os.kill(reserve, signal.SIGKILL)
    until_dead(reserve)
    run.channel.send("stop", signal=signal.SIGTERM)
    outcome = run.outcome()
    assert (outcome.status, outcome.failure, outcome.unreached) == (128 + signal.SIGTERM, None, [])
    assert_safe(Cells(tmp_path / "box"))
