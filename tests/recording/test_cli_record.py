"""`umo run --record`, `umo recording make`: files, settings, and that the run goes on whatever happens to its
recorder."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import Result

from helpers.begun_programs import is_noted_as_ended, programs_begun
from helpers.machines import bench, wired
from helpers.waiting import until
from umo import connect, published
from umo.process.job import Job
from umo.process.start import Started
from umo.recording import flight_folder
from umo.recording.flight_folder import FlightFolder
from umo.recording.record_settings import record_of
from umo.recording.recording import Recording
from umo.testing import Scripted, periods
from umo_command.progress_line import OneLine
from umo_command.run import record_beside
from umo_command.run.record_beside import RecordBeside, RecordOrder

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
Umo = Callable[..., Result]
RUN = ("run", "conveyor", "--until", "0.2", "--no-record")


@pytest.fixture(autouse=True)
def own_folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))


def test_a_run_in_virtual_time_is_recorded_whole(umo: Umo) -> None:
    result = umo(*RUN, "--record", "run.mcap")
    assert result.exit_code == 124 and "recorded: run.mcap (100 periods, " in result.stderr
    with Recording("run.mcap") as recording:
        assert recording.complete and recording.replayable_from is None
        assert len(recording.frames()) == 100 and recording.job["station"] == "conveyor"
        assert recording.job["until"] == 0.2 and "[wire" in recording.job["wiring"]["text"]


def test_a_run_that_fails_is_recorded_to_its_end(umo: Umo) -> None:
    result = umo("run", "ztheta", "--no-record", "--record", "run.mcap", "--fault", "z.encoder disconnect at 1 s")
    assert result.exit_code == 1
    with Recording("run.mcap") as recording:
        assert recording.ended and recording.complete and "z.encoder" in recording.events[-1].event.text


def test_without_a_file_the_recording_is_in_the_folder_of_the_run(umo: Umo) -> None:
    result = umo(*RUN[:-1], "--record", "--no-plot")
    (file,) = Path("runs").glob("conveyor-*/recording.mcap")
    assert f"recorded: {file} " in result.stderr.replace("\n", "")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("--record", "is.mcap"),
            "umo: is.mcap: this file exists already, and a recording never overwrites a file",
        ),
        (("--record", "no/x.mcap"), "umo: no/x.mcap: there is no folder no"),
        (("--last", "fast"), "invalid value for '--last': 'fast' is not a duration"),
        (("--last", "1 ms"), "the command line: record.last: 0.001 is less than 1 s"),
    ],
)
def test_a_mistake_is_told_before_anything_runs(umo: Umo, tmp_path: Path, words: tuple[str, ...], told: str) -> None:
    (tmp_path / "is.mcap").write_text("")
    result = umo(*RUN, *words)
    assert result.exit_code == 2 and told in result.stderr and len(result.stderr.splitlines()) == 1


def test_a_file_that_exists_is_named_without_an_option_that_was_not_typed(umo: Umo, tmp_path: Path) -> None:
    (tmp_path / "is.mcap").write_text("")
    told = umo("recording", "make", "press", "is.mcap").stderr
    assert told == "umo: is.mcap: this file exists already, and a recording never overwrites a file\n"


def test_the_folder_of_a_run_in_the_place_of_its_recording_is_told_what_to_name(umo: Umo) -> None:
    assert umo(*RUN[:-1], "--no-plot").exit_code == 124
    (folder,) = Path("runs").iterdir()
    told = umo("recording", "info", str(folder)).stderr.replace("\n", " ")
    assert f"{folder}: this run has no recording (`umo run --record` makes one)" in told
    (folder / "recording.mcap").write_bytes(b"")
    told = umo("recording", "info", str(folder)).stderr.replace("\n", " ")
    assert f"{folder} is the folder of a run; its recording is {folder}/recording.mcap" in told


def test_a_flight_recorder_keeps_nothing_of_a_run_that_ends_well(umo: Umo) -> None:
    result = umo(*RUN, "--last", "1 min")
    assert result.exit_code == 124 and not list(Path().glob("*.mcap")) and not flight_folder.all_folders()


def test_a_flight_recorder_saves_a_run_that_fails(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.recording.recorder.WRITE_PAUSE", 0.0)  # a second of a virtual run is soon over
    fault = "z.encoder disconnect at 4 s"
    result = umo("run", "ztheta", "--no-record", "--record", "x.mcap", "--last", "1 s", "--fault", fault)
    assert result.exit_code == 1 and "the run has failed; recorded: x.mcap" in result.stderr
    with Recording("x.mcap") as recording:
        full = [block.is_full for block in recording.blocks()]
        times = [float(block.frames["time"][0]) for block in recording.blocks() if block.is_full]
        assert recording.replayable_from is None and not recording.gaps and recording.ended
        assert not full[0] and full[-1] and min(times) > 1.0
    assert not flight_folder.all_folders()


def test_the_wiring_asks_for_a_recording(umo: Umo, tank: Path) -> None:
    wiring = tank / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text() + '\n[record]\nrotate = "10 min"\n')
    assert "recorded" in umo("check", "tank").stdout
    assert "recorded: runs/" in umo("run", "tank", "--until", "0.5", "--no-plot").stderr.replace("\n", "")
    assert "recorded" not in umo("run", "tank", "--until", "0.5", "--no-record").stderr
    wiring.write_text(wiring.read_text() + "rotte = 3\n")
    result = umo("check", "tank")
    assert result.exit_code == 2 and "record.rotte: unknown key (did you mean 'rotate'?)" in result.stderr
    assert umo("run", "tank", "--until", "0.5").exit_code == 2


def limit_files(patch: pytest.MonkeyPatch, room: int) -> None:
    """A disk on which files can have so many bytes at most."""
    write = os.pwrite

    def pwrite(file: int, data: memoryview, at: int) -> int:
        if at >= room:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[: room - at], at)

    patch.setattr(os, "pwrite", pwrite)
    patch.setattr("umo.process.job.source_files", lambda *run: {})  # those of all tests are in this process


def test_a_full_disk_ends_the_record_in_words_and_not_the_run(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    limit_files(monkeypatch, 75_000)  # a busy computer makes larger blocks: one that has it all would be above this
    monkeypatch.setattr("umo.recording.recorder.WRITE_PAUSE", 0.0)
    result = umo("run", "conveyor", "--parts", "60", "--until", "20", "--no-record", "--record", "run.mcap")
    told = result.stderr.replace("\n", " ")
    assert "the recording ends here, and the machine continues: run.mcap: " in told
    assert "No space left on device" in told
    assert "ended at 20 s" in told and result.exit_code == 4
    with Recording("run.mcap") as recording:
        assert not recording.ended and not recording.gaps
        assert f"recorded: run.mcap ({len(recording.frames())} periods" in told and len(recording.frames()) > 100


def test_a_disk_that_is_full_at_once_leaves_no_file_and_says_so(umo: Umo, monkeypatch: pytest.MonkeyPatch) -> None:
    limit_files(monkeypatch, 23_000)  # the description of the machine fits, and no block
    result = umo("run", "conveyor", "--until", "5", "--no-record", "--record", "run.mcap")
    told = result.stderr.replace("\n", " ")
    assert "nothing was recorded: run.mcap has no complete block, and is removed" in told
    assert result.exit_code == 4 and not Path("run.mcap").exists()


@pytest.mark.full
@pytest.mark.parametrize("room", [10_000, 45_000])
def test_what_a_flight_recorder_has_stays_when_its_disk_is_full(
    umo: Umo, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    with monkeypatch.context() as patch:
        limit_files(patch, room)
        patch.setattr("umo.recording.recorder.WRITE_PAUSE", 0.0)
        words = ("--no-record", "--record", "x.mcap", "--last", "1 min")
        told = umo("run", "conveyor", "--until", "5", *words).stderr.replace("\n", " ")
    begun = "the recording ends here, and the machine continues" in told
    assert begun is ("nothing is recorded: x.mcap" not in told) is (room == 45_000)
    assert begun is ("the files of the flight recorder remain; umo recording save conveyor" in told)
    assert len(flight_folder.all_folders()) == begun
    if begun:
        monkeypatch.setattr(FlightFolder, "is_written", False)
        assert "the recorder has ended" in umo("recording", "save", "conveyor", "saved.mcap").stdout
        with Recording("saved.mcap") as recording:
            assert recording.is_whole and len(recording.frames()) > 100


def test_a_failed_run_has_a_black_box_in_its_recording(umo: Umo) -> None:
    umo("run", "ztheta", "--no-record", "--record", "run.mcap", "--fault", "z.encoder disconnect at 1 s")
    with Recording("run.mcap") as recording:
        (box,) = recording.black_boxes
        assert "z.encoder" in box.reason and box.first + box.periods == recording.frames()["sequence"][-1] // 2


def test_garbage_is_told_in_one_line(umo: Umo, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    for words in (("--repair", "x.mcap"), ("--repair", "none.mcap"), ("--save", "none"), (), ("a", "b", "c")):
        result = umo("recording", "make", *words)
        assert result.exit_code in (1, 2) and len(result.stderr.splitlines()) == 1, result.stderr


@pytest.mark.parametrize(
    "table",
    [{"last": True}, {"size": "3"}, {"keep": 7}, {"size": "1 kB"}, {"rate": 0}, {"rate": "x"}, {"rotate": "0 s"}],
)
def test_settings_that_cannot_be_are_refused(table: dict[str, object]) -> None:
    from umo.errors import OptionError

    with pytest.raises(OptionError, match=r"wiring: record\."):
        record_of(table)


# A station that runs already -----------------------------------------------------------------------------


@pytest.fixture
def bench_runs() -> Iterator[Callable[[], None]]:
    """A station of this process; the function runs a period more."""
    m = bench()
    connection = connect(m, wired(m, Scripted()))
    with connection, published(connection, "press", "rig", job={"station": "press"}):
        periods(m, 20)
        yield lambda: periods(m, 1)


class CtrlC:
    """Comes after some pauses of the recorder."""

    def __init__(self, patch: pytest.MonkeyPatch, at_pause: Callable[[], None], pauses: int = 5) -> None:
        self._left, self._at_pause = pauses, at_pause
        patch.setattr("umo_command.recording.making._stop_on_signals", lambda: self)
        patch.setattr("umo_command.recording.making.step_back", lambda: None)

    def is_set(self) -> bool:
        return self._left <= 0

    def wait(self, seconds: float) -> None:
        self._left -= 1
        self._at_pause()


def test_recording_a_running_station_says_what_it_does_and_how_to_end_it(
    umo: Umo, bench_runs: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    CtrlC(monkeypatch, bench_runs)
    result = umo("recording", "make", "press", "run.mcap")
    assert result.exit_code == 0, result.stderr
    assert (
        "recording press (rig) (running for 0 s) in run.mcap, with the 19 ms before this command; Ctrl-C"
        in result.stdout
    )
    assert "recorded: run.mcap (25 periods" in result.stderr.replace("\n", " ")


def test_for_ends_a_recording_and_the_station_continues(
    umo: Umo, bench_runs: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    CtrlC(monkeypatch, bench_runs, 10**9)
    result = umo("recording", "make", "press", "run.mcap", "--for", "1 ms")
    assert result.exit_code == 0, result.stderr
    assert "; --for 1 ms, or Ctrl-C, ends the recording" in result.stdout.replace("\n", " ")
    assert "recorded: run.mcap (" in result.stderr.replace("\n", " ")
    bench_runs()
    refused = umo("recording", "make", "press", "--for", "1 s", "--last", "1 s")
    assert (refused.exit_code, "--last is a flight recorder" in refused.stderr) == (2, True)


def test_a_flight_recorder_beside_a_running_station_leaves_nothing_when_it_is_stopped(
    umo: Umo, bench_runs: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    CtrlC(monkeypatch, bench_runs)
    result = umo("recording", "make", "press", "run.mcap", "--last", "1 min")
    told = result.stdout.replace("\n", " ")
    assert "keeping the last 60 s of press (rig)" in told and "umo recording save press" in told
    assert "ended before the run, and saved nothing" in result.stderr.replace("\n", " ")
    assert result.exit_code == 0 and not list(Path().glob("*.mcap")) and not flight_folder.all_folders()


def test_what_a_recorder_has_done_so_far_is_in_words(
    umo: Umo, bench_runs: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    monkeypatch.setattr("umo_command.recording.making.err", Console(file=io.StringIO(), force_terminal=True))
    monkeypatch.setattr(OneLine, "show", lambda self, seconds, text, share: shown.append(text))
    monkeypatch.setattr("umo.recording.recorder.WRITE_PAUSE", 0.0)
    CtrlC(monkeypatch, bench_runs, 50)
    assert umo("recording", "make", "press", "run.mcap").exit_code == 0
    assert shown[0].startswith("0 periods, 0.0 MB") and "periods, 0." in shown[-1] and len(shown) == 50


# In real time -------------------------------------------------------------------------------------------


def conveyor() -> Job:
    return Job(station="conveyor", options={"realtime": True})


@pytest.mark.slow
def test_a_run_in_real_time_is_recorded_from_period_0_to_its_end(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.mcap"
    with RecordBeside(RecordOrder(file, record_of({}).plain)) as beside, Started(conveyor()) as started:
        until(lambda: (started.poll(), started.frames)[1])
        assert started.frames is not None
        beside.attach(started.frames)
        until(lambda: started.frames is not None and started.frames.head > 300)
        started.ask_to_stop(signal.SIGTERM)
        started.wait()
    assert beside.complete and f"recorded: {file}" in capfd.readouterr().err.replace("\n", "")
    with Recording(file) as recording:
        assert recording.complete and recording.replayable_from is None
        assert recording.events[-1].event.is_end and recording.job["hash_seed"] == "0"


@pytest.mark.slow
@pytest.mark.full
def test_a_recorder_that_is_killed_is_told_and_the_run_goes_on(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file, begun = tmp_path / "run.mcap", programs_begun(monkeypatch)
    with RecordBeside(RecordOrder(file, record_of({}).plain)) as beside, Started(conveyor()) as started:
        until(lambda: (started.poll(), started.frames)[1])
        assert started.frames is not None
        beside.attach(started.frames)
        until(lambda: file.exists() and file.stat().st_size > 60_000)
        begun[0].kill()
        until(lambda: (beside.look(), is_noted_as_ended(begun[0]))[1])
        head = started.frames.head
        until(lambda: started.frames is not None and started.frames.head > head)
        assert "the recorder has ended (signal 9); the machine continues" in capfd.readouterr().err.replace("\n", " ")
    assert not beside.complete and started.outcome is not None and started.outcome.failure is None
    with Recording(file) as recording:
        assert len(recording.frames()) > 100 and recording.replayable_from is None


def test_a_recorder_that_cannot_start_keeps_no_run_from_starting(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = programs_begun(monkeypatch)
    with RecordBeside(RecordOrder(Path("x.mcap"), {}), ["/bin/false"]) as beside:
        until(lambda: (beside.look(), is_noted_as_ended(begun[0]))[1])
    with RecordBeside(RecordOrder(Path("x.mcap"), {}), ["/nowhere"]) as never:
        pass
    told = capfd.readouterr().err.replace("\n", " ")
    assert "the recorder has ended (status 1)" in told and "the recorder cannot be started" in told
    assert not beside.complete and not never.complete


def test_a_recorder_that_does_not_end_after_the_run_is_ended_in_true_words(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(record_beside, "END_TIMEOUT", 0.02)
    monkeypatch.setattr(record_beside, "START_TIMEOUT", 0.02)
    patient = [sys.executable, "-c", "import time; time.sleep(60)"]
    with RecordBeside(RecordOrder(Path("x.mcap"), {}), patient) as beside:
        pass
    told = capfd.readouterr().err.replace("\n", " ")
    assert "the recorder has ended (signal 9); the data that it had not written are lost" in told
    assert "runs on" not in told and not beside.complete


def test_a_full_disk_leaves_no_folder_of_a_flight_recorder(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> int:
        raise OSError(errno.ENOSPC, "full")

    before = set(flight_folder.place().iterdir())
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="full"):
        flight_folder.new("press", 1, os.getpid())
    assert set(flight_folder.place().iterdir()) == before
