"""`umo recording replay`, `assert_replays`: what they say, and their exit status."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.damages import chunks_of
from helpers.tapes import OVEN, changed_conveyor, recorded, save
from helpers.tiers import first
from umo.exit_status import ExitStatus
from umo.recording.recording import Recording
from umo.recording.replay.tape import NotReplayable
from umo.testing import assert_no_error, assert_replays

Umo = Callable[..., Result]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the conveyor, `conveyor.mcap`, and one of a station of one's own, `own.mcap` of `own`."""
    made = tmp_path_factory.mktemp("recordings")
    save(recorded("conveyor"), made / "conveyor.mcap")
    return made


@pytest.fixture
def conveyor(folder: Path) -> Path:
    return folder / "conveyor.mcap"


def test_a_recording_is_identical(umo: Umo, conveyor: Path) -> None:
    result = umo("recording", "replay", str(conveyor))
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("identical: 3,7") and "commanded raw integers" in result.stdout
    assert "end of the recorded run: the application has ended" in result.stdout


def test_a_replay_prints_the_lines_about_alarms_that_the_run_printed(umo: Umo, folder: Path) -> None:
    file = folder / "batch.mcap"
    fault = "reactors.1.level disconnect at 0.5 s"
    ran = umo("run", "batch", "--until", "3 s", "--fault", fault, "--no-record", "--record", str(file))
    replayed = umo("recording", "replay", str(file))
    printed, again = (
        [line.partition("; could not be read")[0] for line in result.stderr.splitlines() if " alarm " in line]
        for result in (ran, replayed)
    )
    assert printed == again == ["   1.500 s  alarm reactors.1.fault: unacknowledged (high): reactors.1 is in fault"]


def test_other_control_code_differs_at_a_period_an_object_and_a_line(umo: Umo, conveyor: Path, tmp_path: Path) -> None:
    copy = changed_conveyor(tmp_path, "tracking.py", "tunable=True)] = 0.05", "tunable=True)] = 0.09")
    result = umo("recording", "replay", str(conveyor), str(copy))
    assert result.exit_code == 1
    assert "first difference in period" in result.stdout
    assert "sorter.diverter: recorded" in result.stdout and "the sequence stood at" in result.stdout


@pytest.mark.full
def test_another_value_is_drawn_in_open_loop(umo: Umo, conveyor: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    plot = tmp_path / "plot.png"
    result = umo("recording", "replay", str(conveyor), "--set", "sorter.push_time=0.09", "--out", str(plot))
    assert result.exit_code == 1
    assert "with sorter.push_time = 0.09: open loop" in result.stdout
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--set", "sorter.push_tim=1"], "did you mean 'sorter.push_time'"),
        (["--set", "sorter.push_time"], "write for example"),
        (["--set", "sorter.push_time=fast"], "push_time"),
        (["--set", "sorter.push_time=0.09", "--out", "plot.foo"], "a plot is a .png"),
        (["nowhere"], "no station 'nowhere'"),
        (["furnace"], "cannot be created: wiring: wire"),
    ],
)
def test_a_mistake_is_told_in_a_line(umo: Umo, conveyor: Path, given: list[str], told: str) -> None:
    result = umo("recording", "replay", str(conveyor), *given)
    assert result.exit_code == 2
    assert told in result.stderr and len(result.stderr.splitlines()) <= 2, result.stderr


@pytest.mark.parametrize("given", [["--at", "1 s"], ["--break", "period > 5"]])
def test_the_debugger_is_refused_in_a_line_where_there_are_no_forks(
    umo: Umo, conveyor: Path, given: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.recording.replay.snapshots.POSSIBLE", False)
    result = umo("recording", "replay", str(conveyor), *given)
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1, result.stderr
    assert "need Linux" in result.stderr


@pytest.mark.parametrize("content", [b"", b"nothing", b"\x89MCAP0\r\n", os.urandom(3000)])
def test_a_file_that_is_no_recording_is_told_in_a_line(umo: Umo, tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "some.mcap"
    file.write_bytes(content)
    result = umo("recording", "replay", str(file))
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1, result.stderr
    assert umo("recording", "replay", str(tmp_path / "none.mcap")).exit_code == 2


def test_a_recording_that_was_begun_late_is_refused(umo: Umo, tmp_path: Path) -> None:
    tape = recorded("conveyor")
    tape.recorded = tape.recorded[1:]
    result = umo("recording", "replay", str(save(tape, tmp_path / "late.mcap")))
    assert result.exit_code == 2 and "period 500" in result.stderr


def test_one_line_in_pytest(conveyor: Path, tmp_path: Path) -> None:
    assert_replays(conveyor)
    copy = changed_conveyor(tmp_path, "tracking.py", "tunable=True)] = 0.05", "tunable=True)] = 0.09")
    with pytest.raises(AssertionError, match=r"sorter\.diverter"):
        assert_replays(conveyor, copy)
    with pytest.raises(NotReplayable, match=r"none\.mcap"):
        assert_replays(tmp_path / "none.mcap")


def with_a_bit(content: bytes, chunk: tuple[int, int]) -> bytes:
    begin, end = chunk
    data = bytearray(content)
    data[begin + (end - begin) // 3] ^= 1
    return bytes(data)


DAMAGES: dict[str, Callable[[bytes, list[tuple[int, int]]], bytes]] = {
    "a bit of the last chunk": lambda content, chunks: with_a_bit(content, chunks[-1]),
    "cut after a chunk": lambda content, chunks: content[: chunks[0][1]],
    "a bit of the second chunk": lambda content, chunks: with_a_bit(content, chunks[1]),
}


@pytest.mark.full
@pytest.mark.parametrize("damage", first(1, list(DAMAGES)))
def test_what_is_missing_in_a_recording_is_not_identical(umo: Umo, tmp_path: Path, damage: str) -> None:
    """A test that compares nothing must not pass: the periods that are missing were not compared."""
    file = save(recorded("conveyor", parts=1, stop=2.5), tmp_path / "run.mcap")
    assert_replays(file)
    assert_no_error(file)
    file.write_bytes(DAMAGES[damage](file.read_bytes(), chunks_of(file)))
    for check in (assert_replays, assert_no_error):
        with pytest.raises(
            AssertionError,
            match=r"identical as far as the recording goes: .*\nthe replay ended here: "
            r"",
        ):
            check(file)
        check(file, damaged=True)
    told = umo("recording", "replay", str(file))
    assert told.exit_code == ExitStatus.NOT_RECORDED and told.stdout.startswith(
        "identical as far as the recording goes: "
    )
    refused = umo("recording", "shrink", str(file), "--for", "1")
    assert refused.exit_code == 2 and (
        "as far as the recording goes (" in refused.stderr or "are lost" in refused.stderr
    )


@pytest.mark.parametrize(
    "seed", ["٣", "4294967296", "9" * 5000, "-1", "1e3"], ids=["arabic", "large", "long", "negative", "float"]
)
def test_an_order_of_hashes_that_python_does_not_take_is_refused(umo: Umo, tmp_path: Path, seed: str) -> None:
    tape = recorded("conveyor", stop=0.01)
    tape.layout.about["initial"]["hash_seed"] = seed
    refused = umo("recording", "replay", str(save(tape, tmp_path / "run.mcap")))
    assert refused.exit_code == 2 and "the hash seed" in refused.stderr and len(refused.stderr.splitlines()) == 1


def test_a_replay_in_a_process_of_its_own_imports_nothing_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape = recorded("conveyor", stop=0.01)
    tape.layout.about["initial"]["hash_seed"] = "7"
    file = save(tape, tmp_path / "run.mcap")
    monkeypatch.setattr(sys, "path", [each for each in sys.path if each])
    monkeypatch.chdir(tmp_path)
    for module in ("umo", "typing", "pathlib"):
        (tmp_path / f"{module}.py").write_text("open('touched', 'w')\nraise SystemExit(1)\n")
    assert_replays(file)
    assert not (tmp_path / "touched").exists()


HASHED = """
from umo.control import next_period
async def main(m):
    for name in set("abcdefghijklmnop"):
        m.heater.write(ord(name) / 20.0)
        await next_period()
"""


@pytest.mark.full
def test_the_order_of_hashes_is_that_of_the_recording(tmp_path: Path) -> None:
    """In another process, also for pytest."""
    environ = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [Path(__file__).parents[1], *sys.path]))}
    program = "import sys; from replay.test_replay_command import record_hashed; record_hashed(*sys.argv[1:])"
    for seed in ("3", "4"):
        file = tmp_path / f"{seed}.mcap"
        command = [sys.executable, "-c", program, str(tmp_path), str(file)]
        subprocess.run(command, check=True, cwd=tmp_path, env=environ | {"PYTHONHASHSEED": seed})
        assert_replays(file, tmp_path / "hashed")
        command = [sys.executable, "-m", "umo_command", "recording", "replay", str(file), str(tmp_path / "hashed")]
        done = subprocess.run(command, env=environ | {"PYTHONHASHSEED": "5"}, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.full
@pytest.mark.parametrize("outside", [None, "3"])
def test_a_recorded_run_in_virtual_time_has_a_fixed_order_of_hashes(outside: str | None, tmp_path: Path) -> None:
    """That of a run in real time, unless another one is set; it is replayed whatever the caller has."""
    station, file = hashed_station(tmp_path), tmp_path / "run.mcap"
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONHASHSEED"}
    umo = [sys.executable, "-m", "umo_command"]
    command = [*umo, "run", str(station), "--no-plot", "--record", str(file)]
    seed = {} if outside is None else {"PYTHONHASHSEED": outside}
    done = subprocess.run(command, cwd=tmp_path, env=environ | seed, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    with Recording(file) as recording:
        assert recording.about["initial"]["hash_seed"] == (outside or "0")
    assert len(list(tmp_path.glob("runs/*"))) == 1
    for other in ({}, {"PYTHONHASHSEED": "5"}):
        replayed = [*umo, "recording", "replay", str(file), str(station)]
        done = subprocess.run(replayed, cwd=tmp_path, env=environ | other, capture_output=True, text=True)
        assert done.returncode == 0 and "identical" in done.stdout, done.stdout + done.stderr


def record_hashed(folder: str, file: str) -> None:
    save(recorded(str(hashed_station(Path(folder)))), Path(file))


def hashed_station(folder: Path) -> Path:
    """A station whose application depends on the order of hashes."""
    station = folder / "hashed"
    if not station.exists():
        station.mkdir()
        (station / "objects.py").write_text(OVEN)
        (station / "application.py").write_text(HASHED)
    return station
