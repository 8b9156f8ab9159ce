"""Worker processes of drivers off the cycle: whoever dies, their outputs go to their defaults."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, until_dead
from helpers.waiting import until
from umo.cycle import transfer
from umo.process.run_state import RunState, worker
from umo.process.workers import groups_of
from umo.system.processes import name_of
from umo.wiring import resolve

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="processes of their own need Linux")
DRIVEN = {"motor": 500, "valve": 1}


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(transfer, "SETTLE", 0.01)


def wiring(folder: Path, **options: Any) -> dict[str, Any]:
    text = process_box.wiring(folder / "box", off_cycle=True)
    text["process"] |= options.pop("process", {})
    text["drivers"]["box"] |= {"period": "20 ms", "max_age": "5 s"} | options  # what a busy machine does is not tested
    return text


def running(folder: Path, application: str = "forever", **options: Any) -> Run:
    return Run(wiring(folder, **options), application).until_running()


def worker_of(run: Run) -> int:
    """The pid of its worker process."""

    def found() -> int:
        children = Path(f"/proc/{run.guardian}/task/{run.guardian}/children").read_text().split()
        return next((int(pid) for pid in children if name_of(int(pid)) == "umo worker"), 0)

    return until(found)


def until_driven(cells: Cells) -> None:
    until(lambda: cells.levels == DRIVEN)


def test_the_driver_is_opened_by_the_worker_and_reset_by_it_at_the_end(tmp_path: Path, cells: Cells) -> None:
    run = running(tmp_path)
    until_driven(cells)
    serving = worker_of(run)
    assert serving not in (run.guardian, run.control, run.standby)
    run.channel.send("stop")
    outcome = run.outcome()
    assert (outcome.unsafe, outcome.unreached) == (False, [])
    assert_safe(cells)
    until_dead(serving)


def test_a_worker_does_not_run_on_the_core_of_the_control_process(tmp_path: Path, cells: Cells) -> None:
    cores = os.sched_getaffinity(0)
    if len(cores) < 2:
        pytest.skip("this needs two cores")
    text = wiring(tmp_path) | {"process": {"cpu": max(cores)}}
    run = Run(text, "forever").until_running()
    until_driven(cells)
    assert os.sched_getaffinity(run.control) == {max(cores)}
    assert os.sched_getaffinity(worker_of(run)) == cores - {max(cores)}
    run.channel.send("stop")
    assert run.outcome().unreached == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_another_worker_takes_the_place_of_one_that_was_killed_or_stopped(
    tmp_path: Path, cells: Cells, number: signal.Signals
) -> None:
    run = running(tmp_path)
    until_driven(cells)
    first = worker_of(run)
    os.kill(first, number)
    text = run.message("notice")["text"]
    assert text.startswith("the worker process of driver box was " + ("killed" if number == signal.SIGKILL else "stop"))
    assert worker_of(run) != first
    until_driven(cells)  # the program goes on
    run.channel.send("stop")
    outcome = run.outcome()
    assert (outcome.unsafe, outcome.unreached) == (False, [])
    assert_safe(cells)


@pytest.mark.parametrize(
    "killed",
    [("control",), ("control", "worker"), ("guardian", "control"), ("guardian", "control", "worker")],
    ids=" and ".join,
)
def test_whoever_is_left_brings_its_outputs_to_their_defaults(
    tmp_path: Path, cells: Cells, killed: tuple[str, ...]
) -> None:
    run = running(tmp_path)
    until_driven(cells)
    pids = {"guardian": run.guardian, "control": run.control, "worker": worker_of(run)}
    for who in killed:
        os.kill(pids[who], signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.unsafe, outcome.unreached) == (True, [])
    assert_safe(cells)
    until_dead(pids["worker"])


@pytest.mark.parametrize("stopped", ["", "guardian"])
def test_a_control_process_whose_guardians_and_worker_are_dead_opens_the_device_itself(
    tmp_path: Path, cells: Cells, stopped: str
) -> None:
    run = running(tmp_path, process={"hang_timeout": "1 s"})
    until_driven(cells)
    serving = worker_of(run)
    for pid in (run.guardian, run.control, serving):
        os.kill(pid, signal.SIGSTOP)  # so that nobody is replaced, and nobody reset
    for pid in (run.standby, run.reserve, serving, *([] if stopped else [run.guardian])):
        os.kill(pid, signal.SIGKILL)
    os.kill(run.control, signal.SIGCONT)
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (1, [], True)
    assert "reset by the control process afterwards" in str(outcome.failure)
    assert_safe(cells)


def test_a_worker_that_is_left_alone_resets_its_outputs_and_ends(tmp_path: Path, cells: Cells) -> None:
    run = running(tmp_path)
    until_driven(cells)
    serving = worker_of(run)
    for pid in (run.guardian, run.standby, run.reserve, run.control):
        os.kill(pid, signal.SIGSTOP)
    for pid in (run.guardian, run.standby, run.reserve, run.control):
        os.kill(pid, signal.SIGKILL)
    until_dead(serving)
    run.channel.close()
    run.until_all_ended()
    assert_safe(cells)


def test_drivers_that_share_a_device_have_one_worker(tmp_path: Path) -> None:
    machine, text = process_box.machine(), wiring(tmp_path)
    text["drivers"]["other"] = dict(text["drivers"]["box"])
    text["drivers"]["third"] = text["drivers"]["box"] | {"file": str(tmp_path / "third")}
    text["wire"]["valve"] = {"driver": "other"}
    text["wire"]["switch"] = {"driver": "third"}
    assert sorted(map(sorted, groups_of(resolve(machine, text, {})))) in ([["box", "other"], ["third"]],)


def test_each_worker_has_a_lock_of_its_own() -> None:
    state = RunState(workers=2)
    state.hold(worker(1))
    assert state.gone(0.0, worker(0))
    assert state.gone(0.0)
