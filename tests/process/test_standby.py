"""Whoever of guardian, control process and standby guardian dies: the machine is reset, recorded and told, once."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any, cast
from unittest.mock import Mock

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, standing, until_dead
from helpers.tiers import first, some
from helpers.waiting import until
from umo.cycle import segments
from umo.process import guardian, run_end, standby
from umo.process.reset import Resetter
from umo.process.run_state import RunState, Who
from umo.process.standby import Standby
from umo.system import processes
from umo.system.device_record import INSPECT

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="processes of their own need Linux")


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(segments, "SETTLE", 0.01)


def running(folder: Path, application: str = "forever", **options: Any) -> Run:
    return Run(process_box.wiring(folder / "box", **options), application).until_running()


ORDERS = [("guardian", "control"), ("control", "guardian")]


@pytest.mark.parametrize("dead", [True, False], ids=["one after the other", "at once"])
@pytest.mark.parametrize("order", ORDERS, ids=["guardian first", "control first"])
def test_guardian_and_control_process_killed_together_leave_one_that_resets(
    tmp_path: Path, cells: Cells, order: tuple[str, str], dead: bool
) -> None:
    run = running(tmp_path)
    for which in order:
        pid = getattr(run, which)
        os.kill(pid, signal.SIGKILL)
        if dead:
            until_dead(pid)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (1, [], True)
    assert outcome.failure is not None
    if order == ORDERS[1]:  # else the control process may have stopped the machine by itself
        assert "guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)
    (ended,) = standing()
    assert ended.state == "stopped"


@pytest.mark.parametrize("group", first(1, ["guardian", "control", "standby"]))
def test_the_group_of_one_process_is_not_that_of_another(tmp_path: Path, cells: Cells, group: str) -> None:
    run = running(tmp_path)
    pids = {run.guardian, run.control, run.standby}
    assert {os.getpgid(pid) for pid in pids} == {os.getsid(pid) for pid in pids} == pids
    os.killpg(getattr(run, group), signal.SIGKILL)
    if group == "standby":
        assert run.message("notice")["text"].startswith("the standby guardian was killed")
        run.channel.send("stop")
    outcome = run.outcome()
    assert outcome.unsafe is (group != "standby")
    assert_safe(cells)


def test_a_standby_guardian_that_died_is_replaced_and_the_next_one_resets(tmp_path: Path, cells: Cells) -> None:
    run = running(tmp_path)
    for number in (signal.SIGKILL, signal.SIGSTOP):
        os.kill(run.standby, number)
        while (message := run.next())["kind"] == "notice":
            run.notices.append(message["text"])
        assert message["kind"] == "standby"
        assert message["pid"] != run.standby
        run.standby = message["pid"]
    assert run.notices == ["the standby guardian was killed or stopped; another one takes its place"]
    for pid in (run.control, run.guardian):
        os.kill(pid, signal.SIGKILL)
    assert "standby guardian" in str(run.outcome().failure)
    assert_safe(cells)


def children(pid: int, name: str) -> list[int]:
    """The children of a process that have this name."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(each) for each in found if processes.name_of(int(each)) == name]


def waiting_to_reset(run: Run) -> list[int]:
    """The child of the guardian that waits to reset the machine."""
    return children(run.guardian, "umo reset")


@pytest.mark.parametrize("number", first(1, [signal.SIGKILL, signal.SIGSTOP]))
def test_a_process_that_waits_to_reset_is_replaced_when_it_is_killed_or_stopped(
    tmp_path: Path, cells: Cells, number: signal.Signals
) -> None:
    run = running(tmp_path)
    until(lambda: waiting_to_reset(run))
    (first,) = waiting_to_reset(run)
    os.kill(first, number)
    told = "the process that waits to reset the machine was killed or stopped; another one takes its place"
    assert run.message("notice")["text"] == told
    until(lambda: [pid for pid in waiting_to_reset(run) if pid != first])
    os.kill(run.control, signal.SIGKILL)
    failure = run.outcome().failure
    assert failure is not None
    assert failure.message.endswith(f"\nthe guardian reset every actuator; {INSPECT}")
    assert_safe(cells)


def test_all_that_can_reset_killed_at_once_are_noticed_at_the_next_start(tmp_path: Path) -> None:
    run = running(tmp_path)
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in (run.guardian, run.standby, run.reserve, run.control):
            os.kill(pid, number)
    run.until_all_ended()
    run.channel.close()
    refused = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert refused.failure is not None
    assert "ended without a report" in refused.failure.message


def test_a_guardian_that_was_stopped_does_not_keep_a_dead_control_process_from_being_reset(
    tmp_path: Path, cells: Cells
) -> None:
    run = running(tmp_path, process={"hang_timeout": "200 ms"})
    os.kill(run.guardian, signal.SIGSTOP)
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "standby guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


KILL, STOP = signal.SIGKILL, signal.SIGSTOP
ORDERS_OF_DEATH = [
    *permutations([("guardian", STOP), ("standby", KILL), ("control", KILL)]),
    *permutations([("guardian", KILL), ("standby", KILL), ("control", KILL)]),
    *permutations([("guardian", KILL), ("standby", STOP), ("control", KILL)]),
    *permutations([("guardian", STOP), ("standby", STOP), ("control", STOP)]),
    *permutations([("guardian", STOP), ("standby", KILL), ("control", STOP)]),
    *permutations([("guardian", KILL), ("standby", KILL)]),
]
STRUCK = [[f"{which} {number.name}" for which, number in order] for order in ORDERS_OF_DEATH]

IN_REAL_TIME = [STRUCK[ORDERS_OF_DEATH.index((("guardian", n), ("standby", n), ("control", n)))] for n in (KILL, STOP)]
"""Of the others test_schedules.py has one in virtual time (`ROWS`)."""


def strike(run: Run, struck: Sequence[str]) -> None:
    for each in struck:
        which, number = each.split()
        os.kill(getattr(run, which), signal.Signals[number])


@pytest.mark.slow
@pytest.mark.parametrize("struck", some(IN_REAL_TIME.__contains__, STRUCK), ids=", ".join)
def test_the_process_that_waits_to_reset_follows_both_guardians(
    tmp_path: Path, cells: Cells, struck: Sequence[str]
) -> None:
    """However control process, guardian and standby guardian are killed or stopped."""
    run = running(tmp_path, process={"hang_timeout": "200 ms"})
    strike(run, struck)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (1, [], True)
    run.until_all_ended()
    assert_safe(cells)
    (ended,) = standing()
    assert ended.state == "stopped"


def test_a_process_that_waits_to_reset_ends_with_a_run_that_is_told(tmp_path: Path, cells: Cells) -> None:
    run = running(tmp_path)
    os.kill(run.guardian, signal.SIGKILL)  # the standby guardian ends the run
    assert run.outcome().unreached == []
    run.until_all_ended()
    assert_safe(cells)


def test_nothing_is_reset_where_nothing_was_driven(tmp_path: Path, cells: Cells) -> None:
    """All guardians die before the control process may begin."""
    state = RunState()
    follower = Standby(state, 0.5, lambda: pytest.fail("it took over"), cast(Any, None), lambda text: None)
    assert follower.follow_both()


def test_guardian_and_control_process_stopped_together_are_ended_and_reset(tmp_path: Path, cells: Cells) -> None:
    run = running(tmp_path, process={"hang_timeout": "200 ms"})
    for pid in (run.guardian, run.control):
        os.kill(pid, signal.SIGSTOP)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert "hung: no heartbeat for 200 ms while running (it was stopped by a signal)" in outcome.failure.message
    assert "standby guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


@pytest.mark.parametrize(
    ("steps", "status", "unreached"), first(1, [(["settle", "step_in"], 3, ["valve", "motor"]), (["tell"], 0, [])])
)
def test_a_guardian_that_fails_without_anyone_to_follow_it_tells_no_more_than_it_knows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: list[str], status: int, unreached: list[str]
) -> None:
    monkeypatch.setattr(Standby, "appoint", lambda standby: None)
    monkeypatch.setattr(Resetter, "stand_by", lambda resetter: None)
    for step in steps:
        monkeypatch.setattr(run_end.RunEnd, step, Mock(side_effect=MemoryError))
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert (outcome.status, outcome.unreached) == (status, unreached)


def test_a_guardian_killed_while_it_resets_is_followed_by_the_standby_guardian(
    tmp_path: Path, cells: Cells, away: Path
) -> None:
    """Its child that resets dies with it."""
    run = running(tmp_path, at=25, action="kill", away=str(away))
    assert "not reached yet" in run.message("notice")["text"]
    os.kill(run.guardian, signal.SIGKILL)
    run.message("standby")  # who takes over
    assert "not reached yet" in run.message("notice")["text"]
    away.unlink()
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)


@pytest.mark.full
def test_a_guardian_that_is_stopped_while_it_resets_is_followed_by_the_next_process_that_waits(
    tmp_path: Path, cells: Cells, away: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one before has begun to reset, and the standby guardian is dead."""
    monkeypatch.setattr(standby, "CONCLUDING_LIMIT", 0.3)
    monkeypatch.setattr(standby, "RESERVE_GRACE", 0.2)
    run = running(tmp_path, at=25, action="kill", away=str(away))
    assert "not reached yet" in run.message("notice")["text"]
    os.kill(run.guardian, signal.SIGSTOP)
    os.kill(run.standby, signal.SIGKILL)
    away.unlink()
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert "standby guardian reset every actuator" in str(outcome.failure)
    assert_safe(cells)


def test_a_guardian_that_is_killed_as_it_lets_a_process_reset_is_followed_by_that_one(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the next one waits; and the standby guardian is stopped."""
    stand_by = Resetter.stand_by

    def lethal(self: Resetter, first: bool = True) -> None:
        if not first:
            os.kill(os.getpid(), signal.SIGKILL)
        stand_by(self)

    with monkeypatch.context() as patch:
        patch.setattr(Resetter, "stand_by", lethal)
        patch.setattr(Standby, "look", lambda self: None)  # it does not replace the one that is stopped
        run = running(tmp_path, process={"hang_timeout": "200 ms"})
    os.kill(run.standby, signal.SIGSTOP)
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)


@pytest.fixture
def away(tmp_path: Path) -> Path:
    file = tmp_path / "away"
    file.touch()
    return file


@pytest.mark.full
@pytest.mark.parametrize("step", first(1, ["record", "tell", "end"]))
@pytest.mark.parametrize(("application", "status"), first(1, [("drive", 0), ("fail_at", 1)]))
def test_a_guardian_killed_when_all_was_reset_changes_nothing_of_the_end(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch, step: str, application: str, status: int
) -> None:
    def lethal(call: Callable[..., object]) -> Callable[..., object]:
        def instead(*arguments: object, **named: object) -> object:
            if processes.name_of(os.getpid()) == "umo guardian":
                os.kill(os.getpid(), signal.SIGKILL)
            return call(*arguments, **named)

        return instead

    monkeypatch.setattr(
        *{
            "record": (guardian.DeviceClaim, "finish", lethal(guardian.DeviceClaim.finish)),
            "tell": (guardian.FrameWatcher, "finish", lethal(guardian.FrameWatcher.finish)),
            "end": (run_end, "tell_final_message", lethal(run_end.tell_final_message)),
        }[step]
    )
    outcome = Run(process_box.wiring(tmp_path / "box"), application).outcome()
    assert (outcome.status, outcome.unsafe, outcome.unreached) == (status, False, [])
    assert standing() == []


@pytest.mark.full
def test_a_guardian_that_cannot_fork_a_standby_guardian_says_so_and_goes_on(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    fork = RunState.fork

    def refused(self: RunState, who: Who) -> int:
        if who is Who.STANDBY:
            raise BlockingIOError(11, "Resource temporarily unavailable")
        return fork(self, who)

    monkeypatch.setattr(RunState, "fork", refused)
    run = Run(process_box.wiring(tmp_path / "box"), "forever")
    assert run.message("notice")["text"].startswith("no standby guardian: ")
    run.control = run.message("running")["pid"]
    os.kill(run.control, signal.SIGKILL)
    assert run.outcome().unsafe
    assert_safe(cells)


def test_a_standby_guardian_says_on_stderr_how_the_run_ended_where_nobody_else_is_left(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str]
) -> None:
    run = running(tmp_path)
    os.kill(run.guardian, signal.SIGSTOP)  # so it does not say it itself
    for pid in (run.control, run.guardian):
        os.kill(pid, signal.SIGKILL)
    run.channel.close()
    run.until_all_ended()
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "umo:" in line]
    assert line.startswith(
        "umo: Machine: the process that started the run has ended; the guardian was lost; the control process "
    )
    assert "; the standby guardian reset every actuator; inspect the machine" in line
    assert_safe(cells)


def end_all_guardians(run: Run) -> None:
    os.kill(run.guardian, signal.SIGSTOP)  # so it forks no other ones
    for pid in (run.standby, run.reserve, run.guardian):
        os.kill(pid, signal.SIGKILL)
    for pid in (run.standby, run.reserve, run.guardian):
        until_dead(pid)


def test_a_control_process_without_any_guardian_tries_as_a_guardian_would(
    tmp_path: Path, cells: Cells, away: Path
) -> None:
    """Its device answers nobody at first."""
    run = running(tmp_path, away=str(away))
    os.kill(run.control, signal.SIGSTOP)
    cells.numbers[process_box.STRUCK] = 1
    end_all_guardians(run)
    cells.numbers[process_box.REFUSED] = 0
    os.kill(run.control, signal.SIGCONT)
    until(lambda: cells.numbers[process_box.REFUSED] not in (0, run.control))  # by a child that resets
    away.unlink()
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (1, [], True)
    assert "reset by the control process afterwards" in str(outcome.failure)
    assert_safe(cells)


def test_a_control_process_without_any_guardian_says_and_records_how_it_ended(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str]
) -> None:
    run = running(tmp_path)
    end_all_guardians(run)
    run.channel.close()
    run.until_all_ended()
    assert "the guardian has ended; the control process stopped the machine" in capfd.readouterr().err
    assert [ended.state for ended in standing()] == ["stopped"]
    assert_safe(cells)
