"""The record of a run that goes on for months: bounded files, a summary while it runs, old runs removed when asked."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import Result

from helpers.tiers import first
from umo.cycle.frame import Signal
from umo.cycle.stage import Progress
from umo.cycle.trace import Statistics, Trace
from umo.process.frames import blackbox
from umo.process.outcome import Failed, Outcome
from umo.system.processes import identity
from umo_command.run import long_runs
from umo_command.run.long_runs import RunningSummary, TraceParts, prune, recorded
from umo_command.run.run_folder import RunSummary, TraceFile

Umo = Callable[..., Result]
PERIOD = 0.1
MB = 10**6


class Frames:
    """Frames of a machine without objects and with three signals, such as observers see them."""

    def __init__(self) -> None:
        self.number = 0
        self.frame = SimpleNamespace(
            items=[],
            values=[],
            quality=np.zeros(0, np.uint8),
            missed=0,
            execution=1e-4,
            progress=Progress("running"),
            signals=[],
        )
        self.frame.signals = [Signal(f"tank.level{number}", "mm", None, "level") for number in range(3)]
        self.frame.signal_values = [1.0, 2.0, 3.0]

    def next(self) -> SimpleNamespace:
        self.number += 1
        self.frame.time = self.number * PERIOD
        self.frame.signal_values[0] = self.number % 1000 / 7
        return self.frame


def size_of(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.iterdir())


def times_in(folder: Path) -> list[float]:
    rows = [
        row
        for part in sorted(folder.glob("trace-*.csv"))
        for row in list(csv.reader(part.read_text().splitlines()))[1:]
    ]
    return [float(row[0]) for row in rows]


# A trace of every period -------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.parametrize("periods", first(1, [60_000, 6_048_000]))
def test_the_files_of_a_week_stay_bounded_and_the_memory_flat(tmp_path: Path, periods: int) -> None:
    """6,048,000 periods of 100 ms are a week. The parts hold the last periods, each once."""
    frames, trace, result = Frames(), Trace(1000), RunSummary(Statistics(1000))
    parts = TraceParts(tmp_path, MB)
    observers = [result.statistics, trace, parts]
    live = tmp_path / "live"
    live.mkdir()
    observers += [TraceFile(trace, live / "trace.csv"), RunningSummary(result, live / "summary.json")]
    largest, memory = 0, []
    for number in range(periods):
        frame = frames.next()
        for observer in observers:
            observer(frame)  # type: ignore[operator]
        if number % (periods // 20) == 0:
            largest = max(largest, size_of(tmp_path))
            memory.append(_memory())
    parts.write()
    assert largest <= MB + 4096  # of the folder's own entry
    assert len(list(tmp_path.glob("trace-*.csv"))) <= long_runs.PARTS + 1
    times = times_in(tmp_path)
    assert all(after - before == pytest.approx(PERIOD) for before, after in pairwise(times))
    assert times[-1] == pytest.approx(periods * PERIOD)
    assert (live / "trace.csv").stat().st_size < 100_000 + 30_000 * (trace.stride.bit_length())
    assert memory[-1] - memory[5] < 2_000_000
    assert json.loads((live / "summary.json").read_text())["state"] == "running"


def _memory() -> int:
    """The most bytes that this process has had so far."""
    resource = pytest.importorskip("resource")
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def test_the_parts_together_hold_what_was_written_until_the_limit_is_reached(tmp_path: Path) -> None:
    frames, parts = Frames(), TraceParts(tmp_path, MB)
    for _ in range(5000):
        parts(frames.next())  # type: ignore[arg-type]
    parts.write()
    assert times_in(tmp_path) == pytest.approx([PERIOD * (number + 1) for number in range(5000)])
    heads = {part.read_text().partition("\n")[0] for part in tmp_path.glob("trace-*.csv")}
    assert len(heads) == 1
    assert len(list(tmp_path.glob("trace-*.csv"))) == 2 + size_of(tmp_path) // (MB // 10) - 1


def test_more_periods_a_second_than_wait_at_most_are_written_sooner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(long_runs, "PENDING_ROWS", 4)
    frames, parts = Frames(), TraceParts(tmp_path, MB)
    for _ in range(50):
        parts(frames.next())  # type: ignore[arg-type]
    parts.write()
    assert len(times_in(tmp_path)) == 50


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of files as on Linux")
def test_a_full_disk_leaves_whole_rows_and_a_gap_and_is_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    resource = pytest.importorskip("resource")
    frames, parts = Frames(), TraceParts(tmp_path, MB)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for number in range(600):
        if number in (200, 400):
            limit = 5000 if number == 200 else before[0]
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        parts(frames.next())  # type: ignore[arg-type]
    parts.write()
    times = times_in(tmp_path)
    assert not parts.complete
    assert capsys.readouterr().err.count("its trace has a gap") == 1
    assert sum(after - before > 2 * PERIOD for before, after in pairwise(times)) == 1
    assert times[-1] == pytest.approx(60.0)


def test_a_folder_that_is_gone_costs_the_trace_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames, parts = Frames(), TraceParts(tmp_path / "none", MB)
    for _ in range(100):
        parts(frames.next())  # type: ignore[arg-type]
    assert not parts.complete
    assert capsys.readouterr().err.count("cannot be written") == 1


def test_a_run_with_a_limit_keeps_every_period_and_the_whole_trace(umo: Umo, tank: Path) -> None:
    assert umo("run", "tank", "--keep", "1 MB", "--no-plot").exit_code == 0
    (folder,) = (tank.parent / "runs").iterdir()
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["state"], summary["status"]) == ("ended", 0)
    assert len(times_in(folder)) == summary["periods"]
    assert (folder / "trace.csv").exists()


def test_a_trace_with_a_gap_has_the_status_of_an_incomplete_record(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TraceParts, "_append", lambda self, rows: setattr(self, "complete", False))
    result = umo("run", "tank", "--keep", "1 MB", "--no-plot")
    assert result.exit_code == 4


@pytest.mark.parametrize("text", ["1", "1 MiB", "-1 MB", "0.5 MB", "nan MB", "1 MB x", ""])
def test_a_size_that_is_none_is_refused(umo: Umo, tank: Path, text: str) -> None:
    result = umo("run", "tank", "--keep", text)
    assert result.exit_code == 2
    assert "--keep" in result.stderr
    assert not (tank.parent / "runs").exists()


def test_a_limit_of_a_record_that_is_not_wanted_is_refused(umo: Umo, tank: Path) -> None:
    result = umo("run", "tank", "--no-record", "--keep", "1 MB")
    assert (result.exit_code, "leave out --no-record" in result.stderr) == (2, True)


# The summary while it runs -----------------------------------------------------------------------------


def test_the_summary_of_a_run_that_goes_on_is_written_once_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    save = RunSummary.save
    monkeypatch.setattr(
        RunSummary,
        "save",
        lambda self, path, **given: (written.append(self.outcome.simulated), save(self, path, **given)),
    )
    frames, running = Frames(), RunningSummary(RunSummary(Statistics(10)), tmp_path / "summary.json")
    for _ in range(1500):
        running(frames.next())  # type: ignore[arg-type]
    assert written == pytest.approx([0.1, 60.1, 120.1])
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["state"], summary["status"], summary["progress"]["text"]) == ("running", None, "running")


def test_a_summary_that_cannot_be_written_is_told_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames, running = Frames(), RunningSummary(RunSummary(Statistics(10)), tmp_path / "none" / "summary.json")
    for _ in range(1500):
        running(frames.next())  # type: ignore[arg-type]
    assert capsys.readouterr().err.count("cannot be written") == 1


# The runs that are kept --------------------------------------------------------------------------------


def ended() -> int:
    """The pid of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Five runs of two stations: one killed, one that goes on, one damaged."""
    monkeypatch.chdir(tmp_path)
    gone = ended()
    for number, (station, pid, summary) in enumerate(
        [
            ("tank", os.getpid(), {"state": "running", "status": None}),
            ("tank", gone, {"state": "running", "status": None}),
            ("tank", gone, {"status": 3, "failure": "the level does not rise (at 3 s)"}),
            ("press", gone, {"status": 0}),
            ("tank", gone, {"status": 143, "failure": "", "stopped_by": "ann, umo do STATION stop (pid 3)"}),
        ]
    ):
        folder = tmp_path / "runs" / f"{station}-20260101-00000{number}"
        folder.mkdir(parents=True)
        (folder / "run.json").write_text(json.dumps({"station": station, "pid": pid}))
        (folder / "summary.json").write_text(json.dumps(summary))
    (tmp_path / "runs" / "other").mkdir()
    (tmp_path / "runs" / "other" / "run.json").write_text("{")
    return tmp_path / "runs"


def test_the_oldest_runs_are_removed_but_for_one_that_goes_on(runs: Path) -> None:
    assert [run.state for run in recorded("tank")] == ["running", "killed", "ended", "ended"]
    assert [path.name for path in prune(1, "tank")] == ["tank-20260101-000001", "tank-20260101-000002"]
    left = {path.name for path in runs.iterdir()}
    assert left == {"tank-20260101-000000", "tank-20260101-000004", "press-20260101-000003", "other"}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="what tells processes apart is Linux's")
def test_a_killed_run_whose_number_another_process_has_got_is_removed(runs: Path) -> None:
    process = identity(os.getpid())
    for number, own in ((5, process), (6, f"another boot {process}")):
        folder = runs / f"tank-20260101-00000{number}"
        folder.mkdir()
        (folder / "run.json").write_text(json.dumps({"station": "tank", "pid": os.getpid(), "process": own}))
    assert [run.state for run in recorded("tank")][-2:] == ["running", "killed"]
    prune(0, "tank")
    assert {path.name for path in runs.glob("tank-*")} == {"tank-20260101-000000", "tank-20260101-000005"}


def test_a_run_says_which_process_it_is(umo: Umo, tank: Path) -> None:
    assert umo("run", "tank", "--no-plot", "--until", "1").exit_code == 124
    (folder,) = (tank.parent / "runs").iterdir()
    about = json.loads((folder / "run.json").read_text())
    assert (about["pid"], about["process"]) == (os.getpid(), identity(os.getpid()))


def test_what_is_no_run_is_never_removed_nor_what_a_link_names(runs: Path, tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "run.json").write_text(json.dumps({"station": "tank", "pid": 0}))
    (runs / "tank-link").symlink_to(tmp_path / "precious")
    prune(0)
    assert (tmp_path / "precious" / "run.json").exists()
    assert {path.name for path in runs.iterdir()} == {"tank-20260101-000000", "other", "tank-link"}


def test_umo_runs_lists_and_prunes(umo: Umo, runs: Path) -> None:
    shown = umo("recording", "runs", "tank").stdout
    assert "tank-20260101-000002" in shown
    assert "ended, status 3" in shown
    assert "the level does not rise (at 3 s)" in shown
    assert "stopped by ann, umo do STATION stop (pid 3)" in shown
    assert "press" not in shown
    assert "removed: 2 runs" in umo("recording", "runs", "--keep-runs", "1").stdout
    assert umo("recording", "runs", "nobody").stdout == "there is no run of nobody in runs/\n"
    assert umo("recording", "runs", "prss").stdout == "there is no run of prss in runs/ (did you mean 'press'?)\n"


def test_a_run_that_its_time_limit_has_ended_names_the_option(umo: Umo, tank: Path) -> None:
    assert umo("run", "tank", "--no-plot", "--until", "1").exit_code == 124
    assert "status 124" in (listed := umo("recording", "runs").stdout) and "--until" in listed
    assert "ended with status 124: --until" in umo("show", "why", "tank").stdout


def test_a_run_removes_the_oldest_of_its_station_when_asked(umo: Umo, tank: Path) -> None:
    for _ in range(3):
        assert umo("run", "tank", "--no-plot", "--until", "1", "--keep-runs", "2").exit_code == 124
    assert len(list((tank.parent / "runs").iterdir())) == 2


def test_a_folder_that_cannot_be_pruned_keeps_no_machine_from_running(
    umo: Umo, tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(keep: int, station: str) -> None:
        raise PermissionError(13, "not for you")

    monkeypatch.setattr("umo_command.run.station_run.prune", fail)
    assert umo("run", "tank", "--no-plot", "--until", "1", "--keep-runs", "2").exit_code == 124


def test_a_disk_with_less_room_than_the_trace_may_take_is_told_before_the_run(umo: Umo, tank: Path) -> None:
    result = umo("run", "tank", "--no-plot", "--until", "1", "--keep", "900000000 GB")
    assert result.exit_code == 124
    assert "--keep: runs/ has " in result.stderr


def test_black_boxes_that_were_never_finished_do_not_pile_up(tmp_path: Path) -> None:
    old, new = tmp_path / ".tank-1.box.4711", tmp_path / ".tank-2.box.4712"
    for file in (old, new):
        file.touch()
    os.utime(old, (0, 0))
    blackbox.thin(tmp_path)
    assert list(tmp_path.iterdir()) == [new]


@pytest.mark.parametrize("stopped", [None, 15])
def test_a_record_that_is_not_whole_has_its_status_after_a_stop_too(stopped: int | None) -> None:
    outcome = Outcome(stopped_by=stopped, unkept="no space")
    assert outcome.status == 4
    assert Outcome(stopped_by=15).status == 143
    assert Outcome(failure=Failed("Error", "x", 1), unkept="no space").status == 1
