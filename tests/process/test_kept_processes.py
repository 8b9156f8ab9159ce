"""Kept values over the end of a run, whatever ends it: processes of their own, killed at some moment."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from helpers import process_box
from helpers.process_box import Cells
from helpers.runs import Run, assert_safe, until_dead
from helpers.tiers import first
from umo.exit_status import ExitStatus
from umo.process import keeper as keeper_module
from umo.process import kept_file
from umo.process.kept_file import KeptValues

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")


@pytest.fixture
def cells(tmp_path: Path) -> Cells:
    return Cells(tmp_path / "box")


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """The keeper looks often."""
    monkeypatch.setattr(keeper_module, "INTERVAL", 0.005)


def start(tmp_path: Path, application: str = "forever", **more: Any) -> Run:
    return Run(process_box.wiring(tmp_path / "box"), application, "helpers.keeping", **more)


def file() -> Path:
    return kept_file.path_of("Counting", "")


def kept() -> KeptValues:
    values = kept_file.read(file())
    assert values is not None
    return values


def assert_one_moment(values: KeptValues) -> int:
    """All of one period; the count."""
    found = {path: entry["value"] for path, entry in values.numbers.items()}
    count = found["count"]
    mode = "FAST" if count % 2 else "SLOW"
    assert found == {"count": count, "double": 2.0 * count, "odd": count % 2 == 1, "mode": mode}
    return int(count)


def until_kept(run: Run) -> None:
    """Until something was written."""
    run.until_running()
    while not file().exists():
        os.sched_yield()


def keepers() -> list[int]:
    """The processes that keep values, on this computer, for this test."""
    lock = kept_file.lock_of(file()).stat().st_ino
    lines = Path("/proc/locks").read_text().splitlines()
    return [int(line.split()[4]) for line in lines if line.split()[5].endswith(f":{lock}")]


def test_what_is_kept_is_there_in_the_next_run(tmp_path: Path, cells: Cells) -> None:
    assert start(tmp_path, "count").outcome().result == 0
    first = assert_one_moment(kept())
    assert first >= 20
    assert start(tmp_path, "count").outcome().result == first
    assert assert_one_moment(kept()) > first


@pytest.mark.full
def test_a_file_that_was_copied_from_another_computer_is_taken(tmp_path: Path, cells: Cells) -> None:
    start(tmp_path, "count").outcome()
    first = assert_one_moment(kept())
    kept_file.lock_of(file()).unlink()
    assert start(tmp_path, "count").outcome().result == first


@pytest.mark.full
def test_a_fresh_run_starts_with_its_defaults_and_leaves_the_old_file_under_another_name(
    tmp_path: Path, cells: Cells
) -> None:
    start(tmp_path, "count").outcome()
    before = file().read_bytes()
    run = start(tmp_path, "count", fresh=True)
    assert run.outcome().result == 0
    assert "starts without the kept values" in run.notices[0]
    assert [path.read_bytes() for path in file().parent.glob("*.aside-*")] == [before]


KILLED = ["control", "guardian control", "guardian", "control guardian", "guardian standby control"]


@pytest.mark.parametrize("names", first(1, KILLED))
def test_after_kills_the_file_has_one_moment_of_the_run_which_the_next_one_takes(
    tmp_path: Path, cells: Cells, names: str
) -> None:
    run = start(tmp_path)
    until_kept(run)
    seen = assert_one_moment(kept())
    for name in names.split():
        os.kill(getattr(run, name), signal.SIGKILL)
    run.until_all_ended()
    run.channel.close()
    while keepers():  # it outlives them all
        os.sched_yield()
    last = assert_one_moment(kept())
    assert last >= seen
    assert start(tmp_path, "count", acknowledge=True).outcome().result == last


def test_a_keeper_that_was_killed_is_replaced_and_the_last_values_are_written(tmp_path: Path, cells: Cells) -> None:
    run = start(tmp_path)
    until_kept(run)
    seen = assert_one_moment(kept())
    (pid,) = keepers()
    os.kill(pid, signal.SIGKILL)
    until_dead(pid)
    while run.message("notice")["text"] != (
        "the process that keeps values was killed or stopped; another one takes its place"
    ):
        pass
    while (later := assert_one_moment(kept())) <= seen:  # the other one has begun
        os.sched_yield()
    run.channel.send("stop", signal=signal.SIGTERM)
    outcome = run.outcome()
    assert (outcome.status, outcome.unkept) == (128 + signal.SIGTERM, "")
    assert assert_one_moment(kept()) >= later


@pytest.mark.full
def test_a_keeper_that_is_killed_as_the_run_ends_is_replaced(tmp_path: Path, cells: Cells) -> None:
    run = start(tmp_path)
    until_kept(run)
    (pid,) = keepers()
    os.kill(pid, signal.SIGKILL)
    os.kill(run.control, signal.SIGKILL)
    assert run.outcome().unkept == ""
    assert_one_moment(kept())


@pytest.mark.full
def test_where_nothing_can_be_written_the_run_goes_on_and_its_end_says_so(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    start(tmp_path, "count").outcome()
    before = file().read_bytes()

    def full(path: Path, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(keeper_module.Writer.__init__, "__defaults__", (full,))
    run = start(tmp_path, "count")
    outcome = run.outcome()
    assert outcome.status == ExitStatus.NOT_RECORDED
    assert outcome.failure is None
    assert outcome.unkept.startswith("the last kept values were not written: kept values cannot be written: No space")
    assert file().read_bytes() == before


@pytest.mark.full
def test_a_torn_file_costs_its_values_and_stays_under_another_name(tmp_path: Path, cells: Cells) -> None:
    start(tmp_path, "count").outcome()
    torn = file().read_bytes()[:-20]
    file().write_bytes(torn)
    run = start(tmp_path, "count")
    assert run.outcome().result == 0
    assert any("are lost: the file is incomplete" in text for text in run.notices)
    assert [path.read_bytes() for path in file().parent.glob("*.aside-*")] == [torn]
    assert_one_moment(kept())


def test_a_machine_that_keeps_nothing_has_no_keeper_and_no_file(tmp_path: Path, cells: Cells) -> None:
    assert Run(process_box.wiring(tmp_path / "box")).outcome().status == 0
    assert not file().parent.exists()


@pytest.mark.full
def test_a_keeper_that_was_stopped_by_a_signal_is_replaced_at_the_end(tmp_path: Path, cells: Cells) -> None:
    run = start(tmp_path)
    until_kept(run)
    (pid,) = keepers()
    os.kill(pid, signal.SIGSTOP)
    os.kill(run.control, signal.SIGKILL)
    assert run.outcome().unkept == ""
    until_dead(pid)
    assert_one_moment(kept())


@pytest.mark.full
def test_a_second_run_of_one_name_takes_the_values_but_keeps_none(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.process.kept_values.LOCK_TIMEOUT", 0.0)
    first = start(tmp_path)
    until_kept(first)
    Cells(tmp_path / "other")  # a device of its own
    second = Run(process_box.wiring(tmp_path / "other"), "count", "helpers.keeping")
    outcome = second.outcome()
    assert outcome.result > 0
    assert "another run of this station with this wiring keeps its values" in second.notices[0]
    assert (outcome.status, "another run" in outcome.unkept) == (ExitStatus.NOT_RECORDED, True)
    first.channel.send("stop", signal=signal.SIGTERM)
    assert first.outcome().unkept == ""
    assert_one_moment(kept())


@pytest.mark.full
def test_a_disk_that_hangs_delays_the_end_of_a_run_for_a_bounded_time_and_no_reset(
    tmp_path: Path, cells: Cells, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang(path: Path, data: bytes) -> None:
        while True:
            signal.pause()

    monkeypatch.setattr(keeper_module, "LAST_TIMEOUT", 0.1)
    monkeypatch.setattr(keeper_module.Writer.__init__, "__defaults__", (hang,))
    run = start(tmp_path).until_running()
    while not kept_file.lock_of(file()).exists():  # the keeper writes
        os.sched_yield()
    os.kill(run.control, signal.SIGKILL)
    outcome = run.outcome()
    assert (outcome.unreached, outcome.unsafe) == ([], True)
    assert "did not end in time" in outcome.unkept
    assert_safe(cells)
    assert not file().exists()
