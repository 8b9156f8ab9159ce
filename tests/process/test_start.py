"""`umo.start`: a machine in processes of its own, held by a program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import umo
from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import until_dead
from helpers.tiers import first
from helpers.waiting import until
from umo.cycle.stage import Stage
from umo.process.frames.search import station_name
from umo.process.job import Job
from umo.process.start import Started
from umo.system.processes import name_of

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))


@pytest.mark.full
def test_a_wiring_of_any_size_starts(tmp_path: Path) -> None:
    wiring = process_box.wiring(tmp_path / "box") | {"parameters": {}}
    wiring["drivers"]["box"] |= {"away": str(tmp_path / ("x" * 200)) + "/" * 600_000}
    with umo.start(process_box.machine, wiring, process_box.drive) as started:
        assert started.wait(60).status == 0


@pytest.fixture
def removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory is no more."""
    folder = tmp_path / "removed"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()


@pytest.mark.full
@pytest.mark.usefixtures("removed")
def test_a_machine_starts_in_a_working_directory_that_was_removed(tmp_path: Path) -> None:
    with umo.start(process_box.machine, process_box.wiring(tmp_path / "box"), process_box.drive) as machine:
        assert machine.wait().unreached == []


@pytest.mark.usefixtures("removed")
def test_a_station_has_its_name_in_a_working_directory_that_was_removed() -> None:
    assert [station_name(text) for text in ("press", "press/", "/srv/press")] == ["press", "press", "press"]


def test_a_handle_has_status_values_frames_and_an_end(tmp_path: Path) -> None:
    wiring = process_box.wiring(tmp_path / "box")
    with umo.start(process_box.machine, wiring, process_box.forever) as machine:
        until(lambda: machine.poll(0) or machine.values)
        assert machine.stage is Stage.RUNNING
        until(lambda: machine.values["motor"] == 5.0)
        assert machine.values["valve"] == "ON"
        assert machine.frames is not None
        first = machine.frames.read()[0]
        assert first["phases"][-1] > 0  # it has sent something: no period is shown that does nothing but wait
        with pytest.raises(TimeoutError):
            machine.wait(timeout=0.0)
        outcome = machine.stop()
    assert (outcome.stopped_by, outcome.failure, outcome.unreached) == (signal.SIGTERM, None, [])
    assert machine.stage is Stage.ENDED
    assert Cells(tmp_path / "box").levels == {"motor": 0, "valve": 0}


def test_the_end_of_the_block_stops_the_machine(tmp_path: Path) -> None:
    """Meanwhile, any thread may ask for the outcome."""
    with umo.start(process_box.machine, process_box.wiring(tmp_path / "box"), process_box.forever) as machine:
        with ThreadPoolExecutor(4) as pool:
            asked = [pool.submit(lambda: [machine.outcome for _ in range(500)]) for _ in range(4)]
            while machine.stage is Stage.STARTING:
                machine.poll(0.1)
            assert all(outcome is None for each in asked for outcome in each.result(30))
        pid = machine.pid
        assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert machine.outcome is not None
    assert machine.outcome.failure is None
    assert Cells(tmp_path / "box").levels == {"motor": 0, "valve": 0}


def test_an_application_that_fails_comes_out_of_wait(tmp_path: Path) -> None:
    with umo.start(process_box.machine, process_box.wiring(tmp_path / "box"), process_box.fail_at) as machine:
        with pytest.raises(umo.RunFailed, match=r"application \(at 0\.\d+ s, \S+ in fail_at\)") as caught:
            machine.wait()
        assert caught.value.outcome.status == 1
        assert "fail_at" in caught.value.outcome.failure.traceback  # type: ignore[union-attr]


def test_a_mistake_of_the_user_comes_out_of_wait() -> None:
    with umo.start("zteta") as machine, pytest.raises(umo.RunFailed, match="did you mean 'ztheta'"):
        machine.wait()
    with umo.start("furnace", leek=1) as machine, pytest.raises(umo.RunFailed, match="--leek: unknown opt") as caught:
        machine.wait()
    assert caught.value.outcome.status == 2


def test_functions_that_another_process_cannot_import_are_refused_at_once() -> None:
    with pytest.raises(umo.errors.DeclarationError, match="cannot import"):
        umo.start(lambda: process_box.machine())
    with pytest.raises(umo.errors.DeclarationError, match="plain data"):
        umo.start(process_box.machine, {"drivers": {"box": process_box.Box(file="x")}})


PROGRAM = """
import os, sys, umo
from helpers import process_box
from pathlib import Path

def declare():
    return process_box.machine()

if __name__ == "__main__":
    machine = umo.start(declare, process_box.wiring(Path(sys.argv[1]) / "box"), process_box.forever)
    while not machine.values:
        machine.poll(0.1)
    print(machine.pid, machine.guardian, flush=True)
    os.kill(os.getpid(), 9)
"""


def test_a_program_that_is_killed_takes_its_machine_along_safely(tmp_path: Path) -> None:
    """And its functions may stand in the script itself."""
    script = tmp_path / "program.py"
    script.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    program = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert program.stdout is not None
    pids = [int(word) for word in program.stdout.readline().split()]
    program.wait()
    program.stdout.close()
    for pid in pids:
        until_dead(pid)
    assert Cells(tmp_path / "box").levels == {"motor": 0, "valve": 0}


@pytest.mark.parametrize(
    "killed",
    first(1, map(pytest.param, [("guardian", "pid"), (), ("standby", "pid")])),
    ids=lambda words: (*words, "none")[0],
)
def test_processes_that_were_stopped_or_killed_are_named_and_go_on_to_be_stopped(
    tmp_path: Path, killed: tuple[str, ...]
) -> None:
    """A guardian misses its standby guardian at once, so it is the first to be stopped."""
    with umo.start(process_box.machine, process_box.wiring(tmp_path / "box"), process_box.forever) as machine:
        while not (machine.pid and machine.standby and machine.values):
            machine.poll(0.1)
        pids = {name: getattr(machine, name) for name in ("guardian", "standby", "reserve", "pid")}
        stopped = {name: pid for name, pid in pids.items() if name not in killed}
        for pid in pids.values():
            os.kill(pid, signal.SIGSTOP)
        for name in killed:
            os.kill(pids[name], signal.SIGKILL)
        cause = "nothing can stop the machine: stopped by a signal: "
        while not (found := [each for each in machine.notices if each.startswith(cause)]):
            machine.poll(0.1)
        (notice,) = found
        assert f"kill -CONT {' '.join(map(str, stopped.values()))}" in notice
        outcome = machine.stop()
    assert outcome.unreached == []
    assert Cells(tmp_path / "box").levels == {"motor": 0, "valve": 0}


def test_a_stopped_process_that_the_starter_does_not_know_is_not_waited_for_without_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules[Started.__module__], "UNKNOWN_TIMEOUT", 0.05)
    box, wiring = "helpers.process_box", process_box.wiring(tmp_path / "box", off_cycle=True)
    wiring["drivers"]["box"] |= {"period": "20 ms", "max_age": "5 s"}
    job = Job(machine=f"{box}:machine", application=f"{box}:forever", wiring=wiring)
    with pytest.raises(umo.RunFailed) as failed, Started(job) as machine:
        until(lambda: machine.stage is Stage.RUNNING)
        children = Path(f"/proc/{machine.guardian}/task/{machine.guardian}/children").read_text().split()
        worker = next(int(pid) for pid in children if name_of(int(pid)) == "umo worker")
        known = [pid for pid in (machine.pid, machine.reserve, machine.standby, machine.guardian) if pid is not None]
        for pid in (worker, *known):
            os.kill(pid, signal.SIGSTOP)
        for pid in known:
            os.kill(pid, signal.SIGKILL)
        machine.wait(50)
    os.kill(worker, signal.SIGKILL)
    assert (failed.value.outcome.status, failed.value.outcome.unsafe) == (3, True)


@pytest.mark.parametrize("known", ["standby", "reserve", "pid"])
def test_a_guardian_that_has_forked_whoever_resets_or_drives_counts_as_under_way(known: str) -> None:
    started = Started.__new__(Started)
    started.standby, started.reserve, started.pid = 0, 0, None
    assert not started._is_under_way
    setattr(started, known, 4711)
    assert started._is_under_way
