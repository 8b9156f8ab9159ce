"""However a run in processes ends, its actuators are at their defaults, it is said, and the status is not 0."""

from __future__ import annotations

import errno
import os
import re
import signal
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.process_box import CALLS, Cells
from helpers.runs import Run, assert_safe, standing, until_dead
from helpers.tiers import first, some
from umo.cycle import segments
from umo.process import hang_detection, reset
from umo.system import device_record

AT_ONCE = 6
"""Runs side by side: most of their time they wait."""
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a device may still have under way is over at once."""
    monkeypatch.setattr(segments, "SETTLE", 0.01)


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """For drivers that never answer: the limits that end the waiting, as small as a shared machine allows. What the
    wiring's [process] has of them."""
    monkeypatch.setattr(hang_detection, "STARTING_LIMIT", 0.5)
    monkeypatch.setattr(reset, "CALL_MARGIN", 0.2)
    return {"hang_timeout": "100 ms"}


def test_a_run_that_ends_by_itself_is_reported_with_what_the_application_returned(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert (outcome.status, outcome.failure, outcome.result) == (0, None, "driven")
    assert_safe(cells)
    assert standing() == []


@pytest.mark.full
def test_a_process_that_rises_early_and_sends_at_the_next_tick_ends_as_well(tmp_path: Path, cells: Cells) -> None:
    process = {"busy_wait": "500 us", "outputs": "at next tick"}
    outcome = Run(process_box.wiring(tmp_path / "box", process=process)).outcome()
    assert (outcome.status, outcome.result) == (0, "driven")
    assert_safe(cells)


def calls_of_a_run(folder: Path, process: dict[str, str]) -> int:
    Run(process_box.wiring(folder / "box", process=process)).outcome()
    return Cells(folder / "box").numbers[CALLS]


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("outputs", first(1, ["at once", "at next tick"]))
@pytest.mark.parametrize(
    ("action", "step"),
    [
        ("hang", 9),
        *first(0, [("raise", 9), ("kill", 6), ("raise", 1), ("kill", 1), ("hang", 1), ("spin", 7), ("stop", 7)]),
    ],
)
def test_at_every_call_of_a_driver_the_end_is_safe_and_reported(
    tmp_path: Path, action: str, step: int, outputs: str, request: pytest.FixtureRequest
) -> None:
    if outputs == "at next tick":
        step *= 4
    (tmp_path / "first").mkdir()
    process = {"outputs": outputs}
    calls = calls_of_a_run(tmp_path / "first", process)
    assert calls > 20
    if action not in ("raise", "kill"):
        process |= request.getfixturevalue("impatient")
    waiting = list(range(1, calls + 1, step))
    while waiting:
        together, waiting = waiting[:AT_ONCE], waiting[AT_ONCE:]
        files = {at: tmp_path / f"box-{at}" for at in together}
        runs = {at: Run(process_box.wiring(file, at=at, action=action, process=process)) for at, file in files.items()}
        for at, run in runs.items():
            outcome = run.outcome()
            where = f"{action} at call {at} of {calls}: {outcome}"
            assert Cells(files[at]).levels == {"motor": 0, "valve": 0}, where
            assert outcome.status != 0, where
            assert outcome.failure is not None, where
            assert outcome.unreached == [], where
            assert outcome.unsafe == (action != "raise"), where
            assert bool(device_record.standing(f"file {files[at]}")) == outcome.unsafe, where


@pytest.mark.parametrize(
    ("to", "number"),
    some(
        {("guardian", signal.SIGINT), ("control", signal.SIGTERM)}.__contains__,
        product(["guardian", "control", "starter"], [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]),
    ),
)
def test_a_signal_to_either_process_or_from_the_starter_stops_safely(
    tmp_path: Path, cells: Cells, number: signal.Signals, to: str
) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    if to == "starter":
        run.channel.send("stop", signal=number)
    else:
        os.kill(getattr(run, to), number)
    outcome = run.outcome()
    assert (outcome.status, outcome.stopped_by) == (128 + number, number)
    assert_safe(cells)
    assert standing() == []


def test_an_exception_of_the_application_is_reported_with_its_place(tmp_path: Path, cells: Cells) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), "fail_at").outcome()
    assert outcome.status == 1
    assert outcome.failure is not None
    place = r"tests/helpers/process_box\.py:\d+ in fail_at"
    assert re.fullmatch(
        rf"ValueError: a mistake in the application \(at \d+\.\d+ s, \S*{place}\)", outcome.failure.message
    )
    assert_safe(cells)
    assert standing() == []


@pytest.mark.full
@pytest.mark.slow
def test_a_call_in_c_that_never_returns_and_looks_at_no_signal_is_ended_by_the_guardian(
    tmp_path: Path, cells: Cells
) -> None:
    wiring = process_box.wiring(tmp_path / "box", process={"hang_timeout": "100 ms"})
    outcome = Run(wiring, "never_returns_in_c").outcome()
    assert (outcome.status, outcome.unsafe, outcome.unreached) == (1, True, [])
    assert outcome.failure is not None
    assert "hung: no heartbeat for 100 ms while running" in outcome.failure.message
    assert_safe(cells)


def test_an_endless_loop_in_user_code_is_ended_and_its_line_named(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.process.control_watch.WHERE_TIMEOUT", 5.0)  # on a busy computer it has to get a processor
    wiring = process_box.wiring(tmp_path / "box", process={"hang_timeout": "100 ms"})
    outcome = Run(wiring, "loop_at").outcome()
    assert outcome.status == 1
    assert outcome.failure is not None
    assert "hung: no heartbeat for 100 ms while running" in outcome.failure.message
    assert re.search(r"running \(at \d+\.\d+ s, \S*process_box\.py:\d+ in loop_at\)", outcome.failure.message)
    assert_safe(cells)


@pytest.mark.parametrize("number", first(1, [signal.SIGKILL, signal.SIGSTOP, signal.SIGSYS]))
def test_the_guardian_resets_what_a_dead_or_stopped_process_left(
    tmp_path: Path, cells: Cells, number: signal.Signals
) -> None:
    run = Run(process_box.wiring(tmp_path / "box", process={"hang_timeout": "200 ms"}), "forever").until_running()
    os.kill(run.control, number)
    outcome = run.outcome()
    assert outcome.failure is not None
    expected = {
        signal.SIGKILL: "killed (SIGKILL)",
        signal.SIGSTOP: "stopped by a signal",
        signal.SIGSYS: "crashed (SIGSYS)",
    }
    assert expected[number] in outcome.failure.message
    assert "the guardian reset every actuator" in outcome.failure.message
    assert_safe(cells)


def test_the_control_process_stops_itself_when_the_guardian_is_killed(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.guardian, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.status, outcome.unsafe) == (1, True)
    assert outcome.failure is not None
    assert "guardian has ended" in outcome.failure.message
    assert_safe(cells)
    assert len(standing()) == 1


def test_a_starter_that_is_gone_stops_the_machine(tmp_path: Path, cells: Cells) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    run.channel.close()
    status = os.waitpid(run.guardian, 0)[1]
    assert os.WEXITSTATUS(status) == 128 + signal.SIGTERM
    assert_safe(cells)


@pytest.mark.parametrize(
    ("killed", "text"),
    first(
        2,
        [
            ("nobody", "the run has ended; every actuator is at its default"),
            ("guardian", "the guardian has ended; the control process stopped the machine"),
            ("control", "the control process was killed (SIGKILL)"),
        ],
    ),
)
def test_what_survives_its_starter_says_on_stderr_how_the_run_ended(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str], killed: str, text: str
) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    if killed != "nobody":
        os.kill({"control": run.control, "guardian": run.guardian}[killed], signal.SIGKILL)
    run.channel.close()
    run.until_all_ended()
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "umo:" in line]
    assert line.startswith("umo: Machine: the process that started the run has ended; ")
    assert text in line
    assert ("; the guardian reset every actuator" in line) is (killed == "control")
    assert_safe(cells)


@pytest.mark.full
def test_what_was_not_reached_is_said_on_stderr_where_the_starter_is_gone(
    tmp_path: Path, away: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    wiring = process_box.wiring(tmp_path / "box", at=25, action="kill", away=str(away), process={"reset_for": "500 ms"})
    run = Run(wiring, "forever").until_running()
    until_dead(run.control)
    run.channel.close()
    os.waitpid(run.guardian, 0)
    (line,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("umo:")]
    assert "the control process was killed (SIGKILL)" in line
    assert "; not reached: valve and motor: " in line


@pytest.mark.full
def test_a_starter_that_lives_is_left_to_say_how_the_run_ended(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str]
) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.control, signal.SIGKILL)
    assert run.outcome().unsafe
    assert "umo:" not in capfd.readouterr().err


@pytest.mark.full
def test_a_machine_that_was_stopped_unsafely_wants_to_be_acknowledged(tmp_path: Path, cells: Cells) -> None:
    wiring = process_box.wiring(tmp_path / "box")
    run = Run(wiring, "forever").until_running()
    os.kill(run.control, signal.SIGKILL)
    run.outcome()
    (ended,) = standing()
    assert "was killed (SIGKILL)" in str(ended)
    refused = Run(wiring).outcome()
    assert refused.status == 2
    assert refused.failure is not None
    assert "was killed (SIGKILL)" in refused.failure.message
    assert "--acknowledge" in refused.failure.message
    assert cells.levels == {"motor": 0, "valve": 0}
    assert Run(wiring, acknowledge=True).outcome().status == 0
    assert Run(wiring).outcome().status == 0


def test_while_a_machine_runs_it_cannot_be_started_again(tmp_path: Path) -> None:
    wiring = process_box.wiring(tmp_path / "box")
    run = Run(wiring, "forever").until_running()
    second = Run(wiring).outcome()
    assert second.status == 2
    assert second.failure is not None
    assert f"file {tmp_path / 'box'} is held by pid {run.control} of " in second.failure.message
    assert "(Machine), since 20" in second.failure.message
    run.channel.send("stop")
    assert run.outcome().status == 128 + signal.SIGTERM


@pytest.fixture
def away(tmp_path: Path) -> Iterator[Path]:
    file = tmp_path / "away"
    file.touch()
    yield file
    file.unlink(missing_ok=True)


def test_a_device_that_stays_away_is_named_with_status_3(tmp_path: Path, cells: Cells, away: Path) -> None:
    wiring = process_box.wiring(tmp_path / "box", at=25, action="kill", away=str(away), process={"reset_for": "50 ms"})
    outcome = Run(wiring, "forever").outcome()
    assert outcome.status == 3
    assert sorted(outcome.unreached) == ["motor", "valve"]
    assert outcome.failure is not None
    what = f"driver box (file {tmp_path / 'box'}) could not be opened: no route to the device"
    assert f"not reached: valve and motor: {what}" in outcome.failure.message
    (device_record,) = standing()
    assert "not reached: valve, motor" in str(device_record)


@pytest.mark.full
def test_a_device_that_comes_back_is_reset_after_all(tmp_path: Path, cells: Cells, away: Path) -> None:
    run = Run(process_box.wiring(tmp_path / "box", at=25, action="kill", away=str(away)), "forever").until_running()
    message = run.next()
    assert message["kind"] == "notice"
    assert "retrying for up to 10 s: valve and motor: driver box (file " in message["text"]
    assert "could not be opened: no route to the device" in message["text"]
    assert cells.levels["motor"] != 0
    away.unlink()
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached) == (1, [])
    assert_safe(cells)


def test_outputs_that_the_control_process_could_not_reach_are_tried_by_the_guardian(
    tmp_path: Path, cells: Cells, away: Path
) -> None:
    run = Run(process_box.wiring(tmp_path / "box", at=25, action="raise", away=str(away)), "forever").until_running()
    kinds = []
    while "notice" not in kinds:
        message = run.next()
        kinds.append(message["kind"])
    away.unlink()
    outcome = run.outcome()
    assert (outcome.status, outcome.unreached, outcome.unsafe) == (1, [], True)
    assert_safe(cells)
    (ended,) = standing()  # a device that was away is looked at before it is driven again
    assert ended.state == "stopped"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"machine": "helpers.process_box:nothing"}, "cannot be imported"),
        ({"machine": "helpers.process_box:OUTPUTS"}, "is not a function"),
        ({"station": "zteta", "machine": None}, "did you mean 'ztheta'"),
        ({"wiring": {"wire": {}}}, "errors in the wiring"),
        ({"options": {"nonsense": 1}}, "--nonsense"),
    ],
)
def test_a_mistake_of_the_user_is_status_2(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    wiring = change.pop("wiring", process_box.wiring(tmp_path / "box"))
    outcome = Run(wiring, **change).outcome()
    assert outcome.failure is not None
    assert re.search(said, outcome.failure.message), outcome.failure.message
    assert outcome.status == 2


def test_a_start_that_cannot_be_written_down_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    outcome = Run(process_box.wiring(tmp_path / "box")).outcome()
    assert outcome.status == 1
    assert outcome.failure is not None
    assert "could not be recorded" in outcome.failure.message
    assert "No space left" in outcome.failure.message
    assert not (tmp_path / "box").exists()


def test_the_control_process_has_one_thread_and_no_collector(tmp_path: Path) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    status = Path(f"/proc/{run.control}/status").read_text()
    assert status.partition("Threads:")[2].split()[0] == "1"
    run.channel.send("stop")
    run.outcome()


@pytest.mark.parametrize("number", [signal.SIGRTMIN + 6])
@pytest.mark.full
def test_a_signal_without_a_name_is_told_by_its_number(tmp_path: Path, cells: Cells, number: int) -> None:
    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    os.kill(run.control, number)
    outcome = run.outcome()
    assert outcome.failure is not None
    assert f"the control process crashed (signal {int(number)})" in outcome.failure.message
    assert_safe(cells)


def test_a_process_that_a_driver_forked_while_connecting_goes_no_further(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str]
) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box", type="helpers.process_box:Forks")).outcome()
    assert outcome.status == 0
    assert "control code forked process" in capfd.readouterr().err
    assert_safe(cells)


@pytest.mark.parametrize(("application", "status"), first(1, [("forks", 1), ("forks_for_work", 7)]))
def test_a_process_that_control_code_forked_drives_nothing(
    tmp_path: Path, cells: Cells, capfd: pytest.CaptureFixture[str], application: str, status: int
) -> None:
    outcome = Run(process_box.wiring(tmp_path / "box"), application).outcome()
    assert (outcome.status, outcome.result) == (0, status)
    assert ("control code forked process" in capfd.readouterr().err) is (status == 1)
    assert_safe(cells)


@pytest.mark.full
def test_short_of_memory_the_kernel_takes_the_control_process_before_a_guardian(tmp_path: Path, cells: Cells) -> None:
    def score(pid: int) -> int:
        return int(Path(f"/proc/{pid}/oom_score_adj").read_text())

    run = Run(process_box.wiring(tmp_path / "box"), "forever").until_running()
    assert score(run.control) > max(score(run.guardian), score(run.standby))
    run.channel.send("stop")
    run.outcome()
