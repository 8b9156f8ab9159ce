"""Worker processes of drivers off the cycle: whoever dies, their outputs go to their defaults."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, until_dead
from helpers.tiers import first
from helpers.waiting import until
from umo.cycle import segments
from umo.cycle.stage import Stage
from umo.drivers.off_cycle.shared_memory import Cell
from umo.process.hang_detection import LOOK_INTERVAL
from umo.process.run_state import RunState, worker
from umo.process.workers import FIRST_PAUSE, MAX_PAUSE, STABLE_TIME, Workers, groups_of
from umo.system import calls
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
    monkeypatch.setattr(segments, "SETTLE", 0.01)


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


@pytest.mark.full
def test_a_worker_does_not_run_on_the_core_of_the_control_process(tmp_path: Path, cells: Cells) -> None:
    cores = os.sched_getaffinity(0)
    if len(cores) < 2:
        pytest.skip("this needs two cores")
    text = wiring(tmp_path) | {"process": {"cpu": max(cores)}}
    run = Run(text, "forever").until_running()
    until_driven(cells)
    assert os.sched_getaffinity(run.control) in ({max(cores)}, cores)  # all of them, where somebody else had its core
    assert os.sched_getaffinity(worker_of(run)) == cores - {max(cores)}
    run.channel.send("stop")
    assert run.outcome().unreached == []


@pytest.mark.parametrize("number", first(1, [signal.SIGKILL, signal.SIGSTOP]))
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
    "killed", first(1, ["control, worker", "guardian, control, worker", "control", "guardian, control"])
)
def test_whoever_is_left_brings_its_outputs_to_their_defaults(tmp_path: Path, cells: Cells, killed: str) -> None:
    run = running(tmp_path)
    until_driven(cells)
    pids = {"guardian": run.guardian, "control": run.control, "worker": worker_of(run)}
    for who in killed.split(", "):
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


class Deaths:
    """The workers of a machine as their guardian keeps them, with processes and a clock that are only thought of."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        machine = process_box.machine()
        wired = resolve(machine, wiring(folder), {})
        self.state, self.now, self.said = RunState(1), 100.0, list[str]()
        self.workers = Workers(machine, wired, groups_of(wired), self.state, self.said.append)
        (self.group,) = self.workers._groups
        self.forked: list[tuple[float, float]] = []
        """When each was forked, s, and for how long it keeps its outputs at their defaults."""
        monkeypatch.setattr(calls, "now", lambda: self.now)
        monkeypatch.setattr(self.workers, "_fork", self._fork)
        self._fork(self.group, False)
        self.state.enter(Stage.RUNNING)
        self.initialize()

    def _fork(self, group: Any, replaces: bool) -> None:
        group.begin()
        group.child = SimpleNamespace(ended=False, was_stopped=False, status=signal.SIGKILL)
        self.forked.append((self.now, group.hold))

    def initialize(self) -> None:
        cells = self.group.proxies[0].exchange.cells
        cells[Cell.GENERATION] += 1
        cells[Cell.INITIALIZED] = cells[Cell.GENERATION]

    def die(self, lived: float) -> float:
        """The worker dies; s until the next one is forked."""
        self.now += lived
        assert self.group.child is not None
        self.group.child.ended = True  # type: ignore[misc]
        count, died = len(self.forked), self.now
        self.workers.look()
        while len(self.forked) == count:
            self.now += LOOK_INTERVAL
            self.workers.look()
        return self.now - died


def test_the_outputs_of_a_worker_that_died_go_to_their_defaults_at_once_however_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pause before they are driven again is spent there."""
    deaths = Deaths(tmp_path, monkeypatch)
    for _ in range(10):
        assert deaths.die(1.0) == 0.0
        deaths.initialize()
    assert [hold for _, hold in deaths.forked[1:]] == [0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0]
    assert deaths.said[-1].endswith(
        "was killed (SIGKILL); its outputs are set to their defaults, where they stay for 5 s"
    )
    assert deaths.die(STABLE_TIME + 1.0) == 0.0
    assert deaths.forked[-1][1] == 0.0


def test_a_worker_that_dies_before_it_has_reset_is_replaced_after_half_a_second_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a driver that crashes when it is opened does."""
    deaths = Deaths(tmp_path, monkeypatch)
    assert deaths.die(1.0) == 0.0
    waited = [deaths.die(0.01) for _ in range(8)]
    assert waited == sorted(waited)
    assert waited[0] < 0.1
    assert max(waited) <= MAX_PAUSE + LOOK_INTERVAL


@pytest.mark.parametrize("call", ["open", "initialize"])
@pytest.mark.parametrize("calls", [1, 2])
def test_a_worker_that_dies_in_a_call_before_it_has_reset_is_replaced_after_half_a_second_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, calls: int
) -> None:
    """Whichever call of the driver it is, and however many have succeeded before."""

    class Death(BaseException):
        pass

    deaths, left = Deaths(tmp_path, monkeypatch), [0]

    def die(*arguments: object) -> None:
        left[0] -= 1
        if left[0] <= 0:
            raise Death

    server = deaths.group.proxies[0].server
    for name in ("open", "initialize"):
        monkeypatch.setattr(server.driver, name, die if name == call else lambda *arguments: None)
    assert deaths.die(1.0) == 0.0
    waited = []
    for _ in range(6):
        server.opened, left[0] = False, 1 if call == "open" else calls
        with pytest.raises(Death):
            server.begin_anew({"motor": 0, "valve": 0}, None)
        waited.append(deaths.die(0.01))
    assert waited == sorted(waited)
    assert waited[0] >= FIRST_PAUSE
    assert MAX_PAUSE <= waited[-1] <= MAX_PAUSE + LOOK_INTERVAL


def test_nobody_takes_the_place_of_a_worker_before_it_is_dead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocked in a call of the kernel it still has its device."""
    deaths, sent = Deaths(tmp_path, monkeypatch), list[int]()
    child: Any = deaths.group.child
    child.was_stopped, child.send = True, sent.append
    for _ in range(1000):
        deaths.now += LOOK_INTERVAL
        deaths.workers.look()
    assert (len(deaths.forked), sent) == (1, [signal.SIGKILL])
    assert set(deaths.said) == {
        "the worker process of driver box cannot be killed: it is blocked in a call of the kernel"
    }
    child.ended = True
    deaths.workers.look()
    assert len(deaths.forked) == 2
    assert "was stopped by a signal" in deaths.said[-1]


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
    state.release(worker(1))  # its memory ends with this test
