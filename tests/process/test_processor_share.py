"""Stations share the cores of a computer: none starves another, and who was starved is told from who hung."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run
from umo.process import processor_share as share_module
from umo.process.hang_detection import LOOK_INTERVAL
from umo.process.outcome import Outcome
from umo.process.processor_share import OVERLONG, ProcessorShare
from umo.system import calls, processes, realtime
from umo.system.processes import ProcessHandle
from umo.system.realtime import CorePlace


def may_use_fifo() -> bool:
    """Whether a process may use SCHED_FIFO here, on two cores or more."""
    asked = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(81)); os.sched_getaffinity(0).pop()"
    return (
        sys.platform.startswith("linux")
        and len(os.sched_getaffinity(0)) > 1
        and subprocess.run([sys.executable, "-c", asked], capture_output=True, check=False).returncode == 0
    )


needs_fifo = pytest.mark.skipif(not may_use_fifo(), reason="needs SCHED_FIFO and two cores")


# Places on cores ----------------------------------------------------------------------------------------


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., CorePlace]]:
    """Takes places of this test alone, on three cores: other stations run on this computer."""
    monkeypatch.setattr(realtime, "CORE_SOCKET_NAME", f"umo test {tmp_path}"[-60:])
    monkeypatch.setattr(realtime, "isolated_cores", list)
    monkeypatch.setattr(realtime.os, "sched_getaffinity", lambda pid: {0, 1, 2})
    taken: list[CorePlace] = []

    def take(cpu: int | None = None) -> CorePlace:
        taken.append(CorePlace(cpu))
        return taken[-1]

    yield take
    for each in taken:
        each.release()


def test_each_station_takes_the_core_with_the_fewest_others_the_last_one_first(place) -> None:
    places = [place() for _ in range(5)]
    assert [each.core for each in places] == [2, 1, 0, 2, 1]
    places[1].release()
    assert place().core == 1
    assert place(cpu=0).core == 0


def test_an_isolated_core_is_taken_first(place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(realtime, "isolated_cores", lambda: [1])
    assert [place().core for _ in range(2)] == [1, 2]


def test_where_there_is_one_core_or_no_place_no_core_is_kept(place, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(3 * realtime.MAX_PLACES):
        assert place().core is not None
    assert place().core is None
    monkeypatch.setattr(realtime.os, "sched_getaffinity", lambda pid: {0})
    assert place().core is None


# One control process and its guardian ---------------------------------------------------------------------


SPIN = """
import os, sys
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
print(flush=True)
while sys.argv[3] == "spin" or sys.stdin.read(1):
    pass
"""


@pytest.fixture
def spinning() -> Iterator[Callable[[int, int, str], subprocess.Popen[bytes]]]:
    """Processes under SCHED_FIFO on a core, at a priority, that spin or wait."""
    started: list[subprocess.Popen[bytes]] = []

    def start(core: int, priority: int, what: str) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-c", SPIN, str(core), str(priority), what]
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        started.append(process)
        assert process.stdout is not None
        process.stdout.readline()
        while what == "wait" and processes.state(process.pid) != "S":  # others may have its core
            select.select([], [], [], LOOK_INTERVAL)
        return process

    before = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))  # as a guardian, above them
    yield start
    os.sched_setscheduler(0, *before)
    for process in started:
        process.kill()
        process.communicate()


def look_until(share: ProcessorShare, reached: Callable[[], bool], most: int = 500) -> None:
    """Looks of a guardian, until something is so."""
    for _ in range(most):
        if reached():
            return
        share.look()
        select.select([], [], [], LOOK_INTERVAL)
    raise AssertionError("not within many looks")


@needs_fifo
def test_a_control_process_that_works_for_long_gives_way_until_its_next_heartbeat(spinning) -> None:
    pid = spinning(max(os.sched_getaffinity(0)), 10, "spin").pid
    share = ProcessorShare(ProcessHandle(pid), None, lambda text: None)
    look_until(share, lambda: os.sched_getscheduler(pid) == os.SCHED_OTHER)
    share.begin()
    assert os.sched_getparam(pid).sched_priority == 10


@needs_fifo
def test_a_control_process_that_is_kept_from_running_may_run_on_every_core_and_is_told_by_whom(spinning) -> None:
    core = max(os.sched_getaffinity(0))
    for _ in range(5):  # other tests run at a real-time priority, too, and may have been the ones
        told = list[str]()
        waiting = spinning(core, 10, "wait")
        other = spinning(core, 11, "spin")
        share = ProcessorShare(ProcessHandle(waiting.pid), core, told.append)
        assert waiting.stdin is not None
        waiting.stdin.write(b"go on" * 1000)
        waiting.stdin.flush()
        look_until(share, lambda told=told: bool(told))
        if f"(pid {other.pid}) had it" in told[0]:
            break
        waiting.kill()
        other.kill()
    assert f"(pid {other.pid}) had it; from now on it runs on every core" in told[0]
    assert share.by_whom.endswith(f"(pid {other.pid}) had core {core}")
    assert share.kept_waiting > 0.04
    assert len(os.sched_getaffinity(waiting.pid)) > 1


def test_that_a_core_was_not_to_be_had_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However often the control process is kept waiting when it runs on every core."""
    told, now = list[str](), count(step=OVERLONG)
    monkeypatch.setattr(calls, "now", lambda: next(now))
    monkeypatch.setattr(share_module, "state", lambda pid: "R")
    monkeypatch.setattr(share_module, "running_on", lambda cores, but: 1)
    monkeypatch.setattr(os, "sched_setaffinity", lambda pid, cores: None)
    share = ProcessorShare(ProcessHandle(os.getpid()), 0, told.append)
    for waiting in range(2, 5):
        share.begin()
        for _ in range(2 * waiting):
            share.look()
        assert share.kept_waiting > OVERLONG
    assert len(told) == 1


@needs_fifo
def test_a_process_that_hangs_alone_on_its_core_was_not_kept_waiting(spinning) -> None:
    core = max(os.sched_getaffinity(0))
    pid = spinning(core, 10, "wait").pid  # no time passes for it, as on a core whose clock does not tick
    share = ProcessorShare(ProcessHandle(pid), core, lambda text: None)
    for _ in range(5):
        share.look()
        select.select([], [], [], LOOK_INTERVAL)
    assert share.kept_waiting == 0.0


def test_the_title_of_a_process_is_harmless_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "name_of", lambda pid: "\x1b[2Jx")
    assert "\x1b" not in processes.title_of(os.getpid())


# Three stations -----------------------------------------------------------------------------------------


@needs_fifo
@pytest.mark.full
def test_two_stations_that_loop_for_ever_do_not_end_a_third(tmp_path: Path) -> None:
    def start(name: str, application: str) -> Run:
        wiring = process_box.wiring(tmp_path / name, process={"hang_timeout": "400 ms"})
        return Run(wiring, application, options={"period": 200} if application == "loop_at" else {}).until_running()

    third = start("third", "forever")
    ended: list[Outcome] = [run.outcome() for run in [start("first", "loop_at"), start("second", "loop_at")]]
    for outcome in ended:
        assert "hung: no heartbeat for 400 ms while running" in str(outcome.failure)
        assert outcome.unreached == []
    assert Cells(tmp_path / "third").levels == {"motor": 500, "valve": 1}
    third.channel.send("stop")
    outcome = third.outcome()
    assert (outcome.failure, outcome.stopped_by) == (None, signal.SIGTERM)
