"""Black boxes of a recording: which periods were missed and why, and what a failed run did last."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import Result

import umo as umo_package
from helpers.recorded import block_at_random, decoded, layout_of
from umo.process.frames.blackbox import AFTERMATH, KEPT_PERIODS
from umo.recording.black_boxes import INTERVAL, BlackBoxes
from umo.recording.block import BlackBox, Block
from umo.recording.copying import thin
from umo.recording.protobuf_channels import ProtobufChannels
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.tables.recording_summary import facts_of, lines_of

Umo = Callable[..., Result]
LAYOUT = replace(layout_of(job={"station": "press"}), phases=("timer", "control", "update box"))
LATE = 1500
"""The frame that tells of a missed period: the one before took 4 ms in its control code."""


def blocks_of(count: int, late: Sequence[int] = (LATE,), size: int = 1000) -> list[Block]:
    """Periods of 1 ms."""
    frames = block_at_random(LAYOUT, 0, count, 1).frames
    frames["counted"], frames["wake"], frames["phases"], frames["execution"] = np.arange(count), 1000, 20_000, 60_000
    place = LAYOUT.phases.index("control")
    for row in late:
        frames["missed"][row], frames["phases"][row - 1, place], frames["execution"][row - 1] = 1, 4_000_000, 4_040_000
    return [
        replace(block_at_random(LAYOUT, first, 1, 1), frames=frames[first : first + size], events=[], commands=[])
        for first in range(0, count, size)
    ]


def found(blocks: Sequence[Block], end: str = "") -> list[BlackBox]:
    return [box for block in BlackBoxes(LAYOUT).added(blocks, end) for box in block.boxes]


@pytest.mark.parametrize("size", [100, 1000, 3000])
def test_a_missed_period_has_a_black_box_with_its_cause(size: int) -> None:
    (box,) = found(blocks_of(3000, size=size))
    assert box.reason == "a period was missed" and box.missed == 1
    assert box.text.startswith("1 period missed before 1.500 s (period 1501): control code took 4 ms")
    assert box.first + box.periods == box.time / 0.001 + 1 and box.periods == min(KEPT_PERIODS, box.first + box.periods)
    assert LATE < box.first + box.periods <= LATE + AFTERMATH / 0.001 + 1 and box.start == box.first * 0.001


def test_there_is_one_in_ten_seconds() -> None:
    times = [box.time for box in found(blocks_of(32_000, range(100, 32_000, 50)))]
    assert len(times) == 4 and all(np.diff(times) >= INTERVAL - AFTERMATH)


def test_what_is_before_a_gap_explains_nothing() -> None:
    first, second = blocks_of(2000, (1001,))
    late = replace(second, frames=second.frames[1:])
    box = found([first, late])[0]
    assert box.first == 1001 and "are not in this file" in box.text


def test_a_failed_end_has_one_and_a_run_without_misses_none() -> None:
    assert not found(blocks_of(2500, ()))
    (box,) = found(blocks_of(2500, ()), "z.encoder: no signal")
    assert (box.first, box.periods, box.reason, box.text) == (1500, 1000, "z.encoder: no signal", "")


def recorded(path: Path, end: str = "") -> Path:
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    for block in BlackBoxes(LAYOUT).added(blocks_of(3000), end):
        file.add([block])
    file.close()
    return path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return recorded(tmp_path / "run.mcap")


@pytest.mark.parametrize("is_thin", [False, True])
def test_a_recording_keeps_them_also_where_it_keeps_little(run: Path, is_thin: bool) -> None:
    if is_thin:
        thin(run)
    with Recording(run) as recording:
        assert recording.black_boxes == found(blocks_of(3000))
        facts = facts_of(recording)
        assert facts["black_boxes"][0]["first"] == recording.black_boxes[0].first
        assert json.loads(json.dumps(facts))["black_boxes"][0]["missed"] == 1
        assert dict(lines_of(facts))["black boxes"].startswith(
            "1 (umo show why --file), the last one at 1.55 s: 1 period"
        )


def test_others_read_them_as_a_topic(run: Path) -> None:
    with run.open("rb") as stream:
        ((schema, _, message),) = list(make_reader(stream, validate_crcs=True).iter_messages(["black_boxes"]))
        box: Any = decoded(schema, message.data)
    assert schema.name == "umo.BlackBox" and box.reason == "a period was missed" and "1.500 s" in box.text
    assert message.log_time == 1_700_000_000_000_000_000 + round(box.time * 1e9)


def test_a_dataset_and_parquet_tell_of_them(run: Path, umo: Umo) -> None:
    pytest.importorskip("xarray")
    parquet = pytest.importorskip("pyarrow.parquet")
    assert umo_package.load(run, ["part0.object0"]).attrs["black_boxes"].startswith("1.55 s: 1 period missed")
    assert umo("recording", "export", str(run), "--out", "run.parquet").exit_code == 0
    told = json.loads(parquet.read_schema("run.parquet").metadata[b"umo"])
    assert told["black_boxes"][0]["reason"] == "a period was missed"


def test_umo_why_explains_a_recording(run: Path, tmp_path: Path, umo: Umo) -> None:
    told = umo("show", "why", "--file", str(run)).stdout
    assert "press, at 1.55 s: a period was missed" in told and "1 period missed before 1.500 s" in told
    assert "control, µs" in told
    thin(run)
    assert "1 period missed before 1.500 s" in umo("show", "why", "--file", str(run)).stdout
    empty = tmp_path / "empty.mcap"
    RecordingFile(empty, LAYOUT).close()
    result = umo("show", "why", "--file", str(empty))
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1 and "no period was missed" in result.stderr
