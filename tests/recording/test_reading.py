"""Recordings read: `umo.load`, `umo recording info`, `umo recording export`, `umo recording plot`. Each gives the
numbers that the frames have."""

from __future__ import annotations

import csv
import json
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

import umo as umo_package
from tests.helpers.recorded import block_at_random, layout_of
from umo.commissioning.tuning.recorded_response import recorded_response
from umo.cycle.events import CommandState, Event
from umo.errors import FramesError, OptionError, PathError, RangeError
from umo.objects.quality import told_not_good
from umo.process.frames.run_reader import NumberedEvent
from umo.recording import copying
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.replay.closed_loop import Trial
from umo.recording.scope.history import samples
from umo.recording.tables.recorded_values import RecordedValues
from umo.recording.tables.recording_export import export
from umo.recording.tables.recording_summary import facts_of, lines_of
from umo_command.console import err
from umo_command.progress_line import OneLine
from umo_command.recording import files as recordings
from umo_command.recording import replay_shrink

Umo = Callable[..., Result]
PATHS = ["part0.object0", "part1.object1", "part0.object2", "part0.signal0", "part0.signal1"]


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """500 frames in 5 blocks, of which 7 are missing after the second; the last block has only what replay needs."""
    layout, path = layout_of(job={"station": "press"}), tmp_path / "run.mcap"
    file = RecordingFile(path, layout)
    for number, first in enumerate((0, 100, 207, 307, 407)):
        block = replace(block_at_random(layout, first, 100, number), events=[], commands_lost=0, entries_lost=0)
        block.frames["quality"][::10, 0] = 4
        if number == 4:
            block = replace(block, is_full=False, events=[NumberedEvent(0, END)])
        file.add([block])
    file.close()
    return path


END = Event(0.506, "", "the application has ended", state=CommandState.DONE, asked="end")


def numbers(path: Path, *only: str, **span: float) -> tuple[np.ndarray, np.ndarray]:
    """The times and the values that the frames have."""
    with Recording(path) as recording:
        parts = [block.frames for block in recording.blocks() if block.is_full]
        frames = np.concatenate(parts)
        frames = frames[(frames["time"] >= span.get("start", 0)) & (frames["time"] < span.get("stop", 9))]
        return frames["time"], samples(frames)[:, [PATHS.index(each) for each in only or PATHS]]


def written(source: Path, target: Path, *only: str, **span: float) -> int:
    with Recording(source) as recording:
        return export(RecordedValues(recording, only, **span), target, lambda time: None)


def test_csv_has_the_numbers_of_the_frames(recorded: Path, tmp_path: Path) -> None:
    target = tmp_path / "run.csv"
    assert written(recorded, target, "part0", start=0.05, stop=0.25) == 193
    head, *rows = csv.reader(target.read_text().splitlines())
    only = [path for path in PATHS if path.startswith("part0")]
    assert head[4:] == ["part0.object0[mm]", "part0.object2[mm]", "part0.signal0[s]", "part0.signal1[s]", "not_good"]
    times, values = numbers(recorded, *only, start=0.05, stop=0.25)
    assert [float(row[0]) for row in rows] == pytest.approx(times.tolist())
    assert np.array_equal(np.array([row[4:-1] for row in rows], float), values, equal_nan=True)
    with Recording(recorded) as recording:
        qualities = np.concatenate([block.frames["quality"] for block in recording.blocks()])[50:243, :2]
    assert [row[-1] == "" for row in rows] == [not each.any() for each in qualities]
    assert {row[-1] for row in rows} >= {"", "part0.object0=BAD"}
    assert all(row[1].startswith("2023-11-14T") and row[1].endswith("Z") for row in rows)


def test_a_number_that_is_no_quality_is_told_as_bad() -> None:
    told = told_not_good(["level", "flow"], np.array([[0, 3], [250, 5], [0, 0]], np.uint8))
    assert list(told) == ["flow=STALE", "level=BAD flow=BAD", ""]


def test_good_values_are_those_of_good_quality(recorded: Path) -> None:
    with Recording(recorded) as recording:
        values = RecordedValues(recording, ["part0.object2", "part0.signal0", "part0.object0"])
        for frames, _ in values.parts():
            good, every = values.good(frames), values.of(frames)
            assert np.array_equal(np.isnan(good), np.isnan(every) | (_qualities(frames, values) != 0))


def _qualities(frames: np.ndarray, values: RecordedValues) -> np.ndarray:
    none = np.zeros(len(frames), np.uint8)
    return np.column_stack([frames["quality"][:, each] if each in values.objects else none for each in values.places])


def test_npz_has_the_numbers_of_the_frames(recorded: Path, tmp_path: Path) -> None:
    assert written(recorded, tmp_path / "run.npz") == 400
    found = np.load(tmp_path / "run.npz")
    times, values = numbers(recorded)
    assert np.array_equal(found["time"], times) and found["utc"].dtype == "datetime64[ns]"
    assert np.array_equal(np.column_stack([found[path] for path in PATHS]), values, equal_nan=True)
    assert set(found["part0.object0.quality"][::10]) == {4} and "part0.signal0.quality" not in found


def test_parquet_has_the_schema_of_a_fleet_and_the_numbers_of_the_frames(recorded: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    from umo.recording.tables.value_tables import VALUES

    assert written(recorded, tmp_path / "run.parquet") == 400
    table = parquet.read_table(tmp_path / "run.parquet")
    assert table.schema.equals(VALUES)
    rows = [row for row in table.to_pylist() if row["path"] == "part1.object1"]
    _, values = numbers(recorded, "part1.object1")
    assert [row["value"] for row in rows] == values[:, 0].tolist()
    assert [row["delta"] for row in rows] == [*range(200), *range(207, 407)]
    assert {row["path"] for row in table.to_pylist()} >= {*PATHS, "run:missed"}


def test_a_pattern_exports_only_what_it_names(recorded: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    written(recorded, tmp_path / "run.parquet", "part1")
    assert set(parquet.read_table(tmp_path / "run.parquet")["path"].to_pylist()) == {"part1.object1"}


def test_a_dataset_has_units_ranges_states_and_quality(recorded: Path) -> None:
    pytest.importorskip("xarray")
    found = umo_package.load(recorded)
    times, values = numbers(recorded)
    assert np.array_equal(found["time"], times) and found["utc"].dtype == "datetime64[ns]"
    assert np.array_equal(np.column_stack([found[path] for path in PATHS]), values, equal_nan=True)
    assert found["part1.object1"].attrs["units"] == "mm"
    assert found["part0.object0.quality"].attrs["flag_meanings"].split()[4] == "BAD"
    assert found.attrs["periods_lost"] == 7 and found.attrs["periods_without_values"] == 100
    assert next(iter(umo_package.load(recorded, ["part1"], 0.1, 0.2).data_vars)) == "part1.object1"


def test_without_xarray_load_says_what_to_install(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(OptionError, match=r'needs xarray: pip install "\.\[analysis\]" in the clone of umo'):
        umo_package.load(recorded)


def test_mistakes_are_named_and_leave_no_file(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(PathError, match="there is no object or signal 'part9'"):
        written(recorded, tmp_path / "run.csv", "part9")
    with pytest.raises(RangeError, match="later"):
        written(recorded, tmp_path / "run.csv", start=2.0, stop=1.0)
    with pytest.raises(OptionError, match=r"\.parquet, \.csv, \.npz"):
        written(recorded, tmp_path / "run.xls")
    with pytest.raises(FramesError, match=r"none/run\.csv could not be written: no such file"):
        written(recorded, tmp_path / "none" / "run.csv")
    assert [each.name for each in tmp_path.iterdir()] == ["run.mcap"]


def test_a_work_that_is_interrupted_leaves_the_file_of_before(recorded: Path, tmp_path: Path) -> None:
    def interrupt(time: float) -> None:
        raise KeyboardInterrupt

    for name in ("run.csv", "run.npz"):
        (tmp_path / name).write_text("before")
        with Recording(recorded) as recording, pytest.raises(KeyboardInterrupt):
            export(RecordedValues(recording), tmp_path / name, interrupt)
        assert (tmp_path / name).read_text() == "before"
    assert len(list(tmp_path.iterdir())) == 3


def test_the_facts_say_what_is_missing_and_whether_it_can_be_replayed(recorded: Path) -> None:
    with Recording(recorded) as recording:
        facts = facts_of(recording)
    assert (facts["periods"], facts["lost"], facts["gaps"], facts["commands"]) == (500, 7, [[200, 7]], 10)
    assert facts["whole"] and not facts["complete"] and facts["replayable"]
    lines = dict(lines_of(facts))
    assert lines["lost"] == "7 in 1 gap" and lines["replay"] == "from period 0 on"
    assert lines["end"] == "the application has ended (done, at 0.506 s)"


@pytest.mark.full
def test_umo_info_export_and_plot_tell_what_they_did(umo: Umo, recorded: Path) -> None:
    pytest.importorskip("matplotlib")
    assert json.loads(umo("recording", "info", str(recorded), "--json").stdout)["station"] == "press"
    assert "500 of 1 ms" in umo("recording", "info", str(recorded)).stdout
    result = umo("recording", "export", str(recorded), "--out", "run.csv", "--to", "0.1")
    assert result.exit_code == 0 and "run.csv: 100 periods" in result.stdout
    result = umo("recording", "plot", str(recorded), "part0", "--out", "part.png")
    assert result.exit_code == 0 and Path("part.png").read_bytes().startswith(b"\x89PNG")
    assert "100 periods are not shown" in result.stderr


def test_a_file_in_the_place_of_a_path_is_told_the_option_for_it(umo: Umo, recorded: Path) -> None:
    told = umo("recording", "export", str(recorded), "out.csv", "--out", "run.csv").stderr
    assert "out.csv is not a path of the machine; to write a file, give --out out.csv" in told


@pytest.mark.parametrize(("verb", "target"), [("export", "run.csv"), ("export", "run.npz"), ("plot", "run.png")])
def test_a_span_without_values_is_refused_before_anything_is_written(
    umo: Umo, recorded: Path, verb: str, target: str
) -> None:
    if verb == "plot":
        pytest.importorskip("matplotlib")
    Path(target).write_text("good")
    for span in (("--from", "1", "--to", "5"), ("--from", "0.45")):  # after the end; only what replay needs
        result = umo("recording", verb, str(recorded), *span, "--out", target)
        assert result.exit_code == 2 and Path(target).read_text() == "good"
        assert "run.mcap has no values at these times; its periods are from 0 s to 0.506 s" in result.stderr


def test_what_is_no_recording_is_told_in_one_line(umo: Umo, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    for words in (
        ("recording", "info", "x.mcap"),
        ("recording", "info", "."),
        ("recording", "export", "x.mcap", "--out", "x.csv"),
        ("recording", "plot", "none.mcap"),
    ):
        result = umo(*words)
        assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1 and "Errno" not in result.stderr


@pytest.mark.parametrize("start", [None, 0.205])
def test_what_was_told_before_the_values_that_are_written_counts(tmp_path: Path, start: float | None) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    tunable = {"path": "servo.gain", "unit": "", "minimum": 0.0, "maximum": 1.0}
    layout = replace(layout_of(), tunables=(tunable,))
    file = RecordingFile(tmp_path / "run.mcap", layout)
    for number in range(3):  # the first one has only what replay needs, as in a flight recorder
        block = replace(block_at_random(layout, 100 * number, 100, number), live={}, is_full=number > 0)
        block.frames["missed"][50] = 2
        file.add([replace(block, live={"mode": 1, "tunables": [0.25]}) if not number else block])
    file.close()
    target = tmp_path / "run.parquet"
    with Recording(tmp_path / "run.mcap") as recording:
        values = RecordedValues(recording, (), start)
        export(values, target, lambda time: None)
    found: dict[str, list[float]] = {}
    for row in parquet.read_table(target).to_pylist():
        found.setdefault(row["path"], []).append(row["value"])
    missed = np.cumsum(np.tile(np.arange(100) == 50, 3) * 2)[205 if start else 100 :]
    assert found["run:missed"] == missed.tolist()
    assert set(found["tunable:servo.gain"]) == {0.25} and set(found["run:mode"]) == {1.0}


def peak(work: Callable[[], object]) -> int:
    """Bytes that are held at once while something works."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.full
def test_the_memory_for_a_few_columns_does_not_grow_with_all_objects(
    umo: Umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xarray")
    layout, path = layout_of(500), tmp_path / "run.mcap"
    file = RecordingFile(path, layout)
    for number in range(80):
        file.add([replace(block_at_random(layout, 50 * number, 50, number), entries_lost=0)])
    file.close()
    frames = 4000 * layout.dtype.itemsize
    monkeypatch.setattr(copying, "BATCH_BYTES", 1 << 20)
    assert peak(lambda: umo_package.load(path, ["part0.object0"])) < frames / 4
    assert peak(lambda: recorded_response(path, ["part0.object0", "part1.object1"])) < frames / 4
    assert peak(lambda: umo("recording", "repair", str(path))) < frames / 4
    assert peak(lambda: copying.thin(path)) < frames / 4
    with Recording(path) as recording:
        assert recording.periods == 4000 and recording.span == (0.0, pytest.approx(3.999))


def test_a_plot_of_a_part_has_all_its_periods(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings, "MAX_ROWS", 100)
    for start, stop, rows in ((0.01, 0.06, 50), (None, None, 80)):
        with Recording(recorded) as recording:
            values = recordings._values(recording, recordings.ValueSelection((), start, stop))
            drawn = recordings._drawn(values, OneLine(err))
        assert len(drawn.rows) == rows


def test_a_plot_of_many_objects_has_fewer_periods(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings, "MAX_NUMBERS", 400)
    with Recording(recorded) as recording:
        drawn = recordings._drawn(RecordedValues(recording), OneLine(err))
    assert drawn.rows.size <= 400


def test_to_0_is_nothing_and_not_everything(umo: Umo, recorded: Path) -> None:
    for nothing in ("0", "0 s", "0s", "0.0"):
        result = umo("recording", "export", str(recorded), "--out", "run.csv", "--to", nothing)
        assert "run.mcap has no values at these times" in result.stderr


def test_the_span_without_a_timer_is_that_of_its_periods(tmp_path: Path) -> None:
    layout = layout_of(period=None)
    file = RecordingFile(tmp_path / "run.mcap", layout)
    file.add([block_at_random(layout, 0, 100, 1)])
    file.close()
    with Recording(tmp_path / "run.mcap") as recording:
        assert dict(lines_of(facts_of(recording)))["length"] == "99 ms: 0 s to 0.099 s"


def test_objects_may_have_the_names_of_what_each_period_has(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    layout = replace(layout_of(3, 0), signals=({"path": "number", "unit": "s"},))
    for entry, path in zip(layout.objects, ("time", "utc", "missed"), strict=True):
        entry["path"] = path
    file = RecordingFile(tmp_path / "run.mcap", layout)
    file.add([block := block_at_random(layout, 0, 5, 1)])
    file.close()
    values = samples(block.frames)[:, 0].tolist()
    found = umo_package.load(tmp_path / "run.mcap")
    assert found["time.value"].values.tolist() == pytest.approx(values, nan_ok=True)
    assert found["time"].values.tolist() == block.frames["time"].tolist()
    written(tmp_path / "run.mcap", tmp_path / "run.npz")
    arrays = np.load(tmp_path / "run.npz")
    assert arrays["time.value"].tolist() == pytest.approx(values, nan_ok=True)
    assert len(set(arrays.files)) == len(arrays.files) and arrays["number"].tolist() == [1, 2, 3, 4, 5]


def test_options_are_told_as_they_are_given(recorded: Path) -> None:
    with Recording(recorded) as recording:
        facts = facts_of(recording) | {"options": {"dry_run": True, "safe": False, "fault": ["a b", "c"], "size": 2.0}}
    told = "--dry-run --no-safe --fault 'a b' --fault c --size 2.0"
    assert dict(lines_of(facts))["options"] == told
    trial = Trial("conveyor", options=facts["options"])
    assert replay_shrink._command(trial) == f"umo run conveyor {told}"
