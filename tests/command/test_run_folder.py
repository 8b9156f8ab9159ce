"""`runs/`: what a run leaves behind, also where the disk is full, the run is killed, or somebody is impatient."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import Result

from umo import connect
from umo.cycle.stopping import StopFlag
from umo.cycle.trace import Statistics, Trace, lines
from umo.process.outcome import Outcome
from umo.testing import periods, station
from umo_command.run import plot
from umo_command.run.run_folder import RunSummary, TraceFile, rows

Umo = Callable[..., Result]


def said(result: Result) -> str:
    return " ".join(result.stderr.split())


def folder(tank: Path) -> Path:
    (run,) = (tank.parent / "runs").iterdir()
    return run


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """As on a full disk: no file grows beyond this (setrlimit(2)). Python writes no bytecode meanwhile: it does not
    notice that its file was cut, and later runs of Python could not read it."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(sys, "dont_write_bytecode", True)
            patched.setenv("PYTHONDONTWRITEBYTECODE", "1")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def quick(tank: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run of 10 s on the machine's clock."""
    monkeypatch.setattr(sys, "argv", ["umo"])  # it is in run.json, whose size counts here
    (tank / "application.py").write_text(
        "from umo.control import wait\n\n\nasync def main(m):\n    await wait('10 s')\n    return 5\n"
    )
    return tank


# A folder that cannot be written -----------------------------------------------------------------------


def test_a_result_with_tables_has_a_short_line_for_each() -> None:
    used = {f"soap {number}": {"batches": number, "values": {"amounts": [1.0], "hold": 60.0}} for number in range(7)}
    ((name, text),) = rows("result", {"recipes": used})
    assert name == "recipes"
    assert text.splitlines() == [*(f"soap {number}: batches {number}" for number in range(5)), "and 2 others"]
    assert list(rows("result", {"empty": {}})) == [("empty", "{}")]


def test_runs_that_cannot_be_written_are_seen_before_anything_runs(umo: Umo, quick: Path) -> None:
    (quick.parent / "runs").write_text("a file where the folder should be")
    result = umo("run", "tank")
    assert (result.exit_code, result.stdout) == (4, "")
    assert said(result) == "umo: runs/ cannot be written: it is not a folder; --no-record runs without a record"
    result = umo("run", "tank", "--no-record")
    assert (result.exit_code, result.stderr) == (0, "")


def test_a_full_disk_is_seen_before_anything_runs(umo: Umo, quick: Path) -> None:
    with largest_file(100):
        result = umo("run", "tank")
    assert (result.exit_code, result.stdout) == (4, "")
    assert "runs/ cannot be written: File too large" in said(result)
    assert not (quick.parent / "runs").exists()


def test_a_disk_that_fills_during_the_run_is_told_and_no_cut_trace_stays(umo: Umo, quick: Path) -> None:
    with largest_file(3000):
        result = umo("run", "tank", "--no-plot")
    assert result.exit_code == 4
    assert "trace.csv could not be written: [Errno 27] File too large" in said(result)
    assert {file.name for file in folder(quick).iterdir()} == {"run.json", "summary.json"}
    assert "results: runs/tank-" in result.stdout


def test_the_status_of_a_run_that_fails_is_its_own(umo: Umo, quick: Path) -> None:
    (quick / "application.py").write_text("async def main(m):\n    await m.fill(1.0)\n    1 / 0\n")
    with largest_file(500):
        result = umo("run", "tank", "--no-plot")
    assert result.exit_code == 1


# What a run leaves -------------------------------------------------------------------------------------


def test_a_run_leaves_what_was_run_and_its_trace(umo: Umo, quick: Path) -> None:
    result = umo("run", "tank", "--level", "30", "--no-plot")
    assert result.exit_code == 0
    run = json.loads((folder(quick) / "run.json").read_text())
    assert (run["station"], run["wiring"], run["options"]) == ("tank", "simulated", {"level": 30.0})
    assert {file.name for file in folder(quick).iterdir()} == {"run.json", "summary.json", "trace.csv"}
    assert f"trace: runs/{folder(quick).name}" in result.stdout


def test_a_run_that_did_not_begin_leaves_nothing(umo: Umo, tank: Path) -> None:
    (tank / "plant.py").write_text(
        (tank / "plant.py").read_text() + "\n    def open(self):\n        raise OSError(5)\n"
    )
    assert umo("run", "tank").exit_code == 1
    assert not (tank.parent / "runs").exists()


# The plot ----------------------------------------------------------------------------------------------


def test_ctrl_c_while_the_plot_is_drawn_changes_neither_the_status_nor_leaves_a_cut_file(
    umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(trace: Trace, path: Path, title: str) -> str:
        path.write_text("half of a picture")
        signal.raise_signal(signal.SIGINT)
        return ""

    monkeypatch.setattr(plot, "save_plot", draw)
    result = umo("run", "tank")
    assert result.exit_code == 0
    assert said(result) == (
        "umo: drawing the plot; Ctrl-C skips it, --no-plot always skips it umo: the plot was skipped"
    )
    assert {file.name for file in folder(quick).iterdir()} == {"run.json", "summary.json", "trace.csv"}
    assert "trace: runs/tank-" in result.stdout


@pytest.mark.parametrize(("until", "end"), [("3", "ended at 3 s (--until)"), ("11", "done")])
def test_the_title_of_the_plot_says_how_a_run_without_progress_ended(
    umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch, until: str, end: str
) -> None:
    titles = []
    monkeypatch.setattr(plot, "save_plot", lambda trace, path, title: titles.append(title) or path.write_text(""))
    umo("run", "tank", "--until", until)
    assert titles == [f"umo run tank: {end}"]


def test_no_result_is_cut_in_a_file_and_a_long_one_wraps_on_a_terminal(umo: Umo, quick: Path) -> None:
    words = " ".join(f"reason{number}" for number in range(100))
    (quick / "application.py").write_text(f"async def main(m):\n    return {{'why': '{words}', 'x' * 200: 1}}\n")
    shown = umo("run", "tank", "--no-record").stdout
    assert all(word in shown for word in words.split()) and shown.count("x") >= 200 and "..." not in shown
    result = RunSummary(Statistics(), Outcome(result={"why": words, "long": "y" * 2000}))
    console = Console(width=60, record=True, file=StringIO())
    console.print(result.table("umo run tank", 1000))
    told = console.export_text()
    assert all(word in told for word in words.split()) and told.count("y") == 1001 and told.count("...") == 1


def test_a_second_ctrl_c_while_a_run_ends_removes_no_record(
    umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def impatient(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("umo_command.run.station_run.plain_reports", impatient)
    assert umo("run", "tank").exit_code == 130
    assert [file.name for file in folder(quick).iterdir()] == ["run.json"]


def test_of_a_run_without_a_period_no_plot_is_drawn(umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(self: StopFlag) -> None:
        install(self)
        self.request(signal.SIGINT)

    install = StopFlag.install
    monkeypatch.setattr(StopFlag, "install", stop)
    result = umo("run", "tank")
    assert result.exit_code == 130
    assert "drawing" not in said(result)


def test_ctrl_c_between_run_and_plot_loses_nothing(umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save = Trace.save

    def interrupted(self: Trace, path: Path) -> None:
        signal.raise_signal(signal.SIGINT)
        save(self, path)

    monkeypatch.setattr(Trace, "save", interrupted)
    assert umo("run", "tank", "--no-plot").exit_code == 0
    assert (folder(quick) / "trace.csv").exists()


# The trace as it comes ---------------------------------------------------------------------------------


def traced(tank: Path, path: Path, count: int, rows: int) -> Trace:
    """`count` periods of 50 ms, with a trace of at most so many rows."""
    trace = Trace(rows)
    connection = connect(station(tank).machine(), station(tank).wiring(None))
    with connection as m:
        connection.machine.observers += [trace, TraceFile(trace, path)]
        periods(m, count)
    return trace


@pytest.mark.parametrize("rows", [50, 100_000])
def test_a_trace_that_is_written_as_it_comes_has_rows_of_the_whole_run(tank: Path, tmp_path: Path, rows: int) -> None:
    """Also where the trace was thinned meanwhile: then the rows become rarer."""
    trace = traced(tank, tmp_path / "live.csv", 401, rows)
    written = list(csv.reader((tmp_path / "live.csv").read_text().splitlines()))
    times = [float(row[0]) for row in written[1:]]
    assert written[0] == [*trace.columns, "not_good"]
    assert times == sorted(set(times))
    assert times[0] == pytest.approx(0.05)
    assert times[-1] >= 20.05 - 1.1 - 0.05 * trace.stride  # it is written every second
    kept = [row for row in list(csv.reader(lines(trace)))[1:] if float(row[0]) <= times[-1]]
    assert [row for row in kept if row not in written] == []
    assert len(times) == len(kept) if trace.stride == 1 else len(times) > len(kept)


def test_a_full_disk_while_the_trace_is_written_is_told_once(
    tank: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with largest_file(2000):
        trace = traced(tank, tmp_path / "live.csv", 200, 1000)
    assert not (tmp_path / "live.csv").exists()
    assert capsys.readouterr().err.count("the run continues") == 1
    assert len(trace.rows) == 200


def test_a_folder_that_is_none_any_longer_costs_the_record_and_not_the_run(
    umo: Umo, quick: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing can be written there, and nothing removed, as on a disk that has become read-only."""
    (tmp_path / "file").touch()
    assert len(traced(quick, tmp_path / "file" / "live.csv", 30, 1000).rows) == 30
    assert capsys.readouterr().err.count("the run continues") == 1
    (quick / "application.py").write_text(
        "import pathlib, shutil\n\n\nasync def main(m):\n    (run,) = pathlib.Path('runs').iterdir()\n"
        "    shutil.rmtree(run)\n    run.touch()\n"
    )
    result = umo("run", "tank", "--no-plot")
    assert (result.exit_code, "trace.csv could not be written" in said(result)) == (4, True), said(result)


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_an_observer_that_fails_does_not_end_the_run(umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: TraceFile, frame: object) -> None:
        raise PermissionError(13, "not for you")

    monkeypatch.setattr(TraceFile, "__call__", fail)
    (quick / "application.py").write_text(FOR_EVER)
    result = umo("run", "tank", "--realtime", "--until", "300 ms", "--no-plot")
    assert (result.exit_code, said(result).count("neither shown nor recorded any longer")) == (4, 1), said(result)


@pytest.mark.parametrize("before", [True, False])
def test_a_run_that_is_refused_leaves_runs_as_it_was(umo: Umo, quick: Path, before: bool) -> None:
    runs = quick.parent / "runs"
    if before:
        runs.mkdir()
    (quick / "application.py").write_text("def main(m):\n    raise SystemExit\n")
    assert umo("run", "tank", "--fault", "level exception at 0 s").exit_code != 0
    assert runs.exists() is before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_a_command_that_is_killed_leaves_the_trace_so_far(quick: Path) -> None:
    (quick / "application.py").write_text("from umo.control import wait\n\n\nasync def main(m):\n    await wait(1e6)\n")
    command = [sys.executable, "-c", "from umo_command import main; main()", "run", "tank", "--realtime"]
    run = subprocess.Popen(command, cwd=quick.parent, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        end = time.monotonic() + 60.0
        while not (found := list((quick.parent / "runs").glob("*/trace.csv"))) or len(rows_of(found[0])) < 30:
            assert time.monotonic() < end
            assert run.poll() is None
            time.sleep(0.05)
    finally:
        run.kill()
        run.wait()
    rows = rows_of(found[0])
    assert len({len(row) for row in rows}) == 1
    assert {file.name for file in folder(quick).iterdir()} == {"run.json", "summary.json", "trace.csv"}
    assert json.loads((folder(quick) / "summary.json").read_text())["state"] == "running"


def rows_of(file: Path) -> list[list[str]]:
    return list(csv.reader(file.read_text().splitlines()))


# The time limit ----------------------------------------------------------------------------------------


FOR_EVER = "from umo.control import until\n\n\nasync def main(m):\n    await until(lambda: False)\n"


@pytest.mark.parametrize(("text", "seconds"), [("3", "3 s"), ("200 ms", "0.2 s"), ("0.05 min", "3 s")])
def test_a_run_ends_at_its_time_limit_with_a_status_of_its_own(umo: Umo, quick: Path, text: str, seconds: str) -> None:
    (quick / "application.py").write_text(FOR_EVER)
    result = umo("run", "tank", "--until", text, "--no-record")
    assert result.exit_code == 124
    assert said(result) == f"umo: ended at {seconds} (--until); every actuator is at its default"


def test_a_run_that_is_done_before_its_time_limit_has_succeeded(umo: Umo, quick: Path) -> None:
    assert umo("run", "tank", "--until", "10.1", "--no-record").exit_code == 0


def test_a_record_that_is_not_complete_is_not_hidden_by_the_time_limit(umo: Umo, quick: Path) -> None:
    with largest_file(3000):
        result = umo("run", "tank", "--until", "9", "--no-plot")
    assert "trace.csv could not be written" in said(result)
    assert result.exit_code == 4


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_a_run_in_real_time_ends_at_its_time_limit(umo: Umo, quick: Path) -> None:
    (quick / "application.py").write_text(FOR_EVER)
    result = umo("run", "tank", "--realtime", "--until", "300 ms", "--no-plot")
    assert result.exit_code == 124
    assert "umo: ended at 0.3 s (--until)" in said(result)


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_a_run_without_frames_is_not_recorded(umo: Umo, quick: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (quick / "application.py").write_text(FOR_EVER)
    monkeypatch.setenv("UMO_FRAMES", "/proc/none")
    result = umo("run", "tank", "--realtime", "--until", "300 ms", "--no-plot")
    told = "this run cannot be watched or traced, and keeps no values: the folder for frames cannot be used"
    assert told in said(result)
    assert result.exit_code == 4


@pytest.mark.parametrize("text", ["0", "nan", "soon", "3 mm"])
def test_a_time_limit_that_is_none_is_refused(umo: Umo, quick: Path, text: str) -> None:
    result = umo("run", "tank", "--until", text)
    assert result.exit_code == 2
    assert "umo run: invalid value for '--until': " in result.stderr


@pytest.mark.full
def test_a_run_in_which_nothing_changes_is_told_with_the_place_where_it_waits(umo: Umo, quick: Path) -> None:
    (quick / "application.py").write_text(FOR_EVER)
    result = umo("run", "tank", "--leak", "0", "--until", "20 min", "--no-record")
    assert said(result).count("nothing has changed for 600 s of the machine's time") == 1
    assert "the application waits at tank/application.py:5 in main" in said(result)
    result = umo("run", "tank", "--leak", "0.01", "--until", "20 min", "--no-record")
    assert "nothing has changed" not in said(result)


def test_a_fault_whose_time_did_not_come_is_told_as_one_that_did_not_begin() -> None:
    faults = ["z stuck at 5 s", "z noise at 1 s"]
    result = RunSummary(Statistics(), Outcome(simulated=2.0), realtime=True, injected=faults)
    summary = result.summary()
    assert summary["injected_faults"] == faults
    assert summary["injected_faults_not_begun"] == ["z stuck at 5 s"]
    assert "injected_faults_not_begun" not in result.summary(running=True)
    console = Console(record=True, width=120)
    console.print(result.table("run"))
    text = console.export_text()
    assert "z stuck at 5 s: it did not begin, as the run ended at 2 s" in text
    assert "z noise at 1 s " in text and "2 s in real time" in text


def test_a_run_in_virtual_time_that_ends_before_its_first_period_is_not_told_as_one_in_real_time() -> None:
    console = Console(record=True, width=120)
    console.print(RunSummary(Statistics()).table("run"))
    assert "real time" in (text := console.export_text()) and "in real time" not in text
