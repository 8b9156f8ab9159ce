"""The file: blocks come back bit by bit, and it is whole after each write."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.recorded import block_at_random, layout_of
from umo.errors import FramesError
from umo.recording.block import Block, block_of, columns_message, exact_message
from umo.recording.copying import join, thin
from umo.recording.recording import LostFrames, Recording
from umo.recording.recording_file import RecordingFile


def same(one: Block, other: Block) -> bool:
    plain = one.commands, one.lost, one.entries_lost, one.commands_lost, one.events, dict(one.live), one.is_full
    others = other.commands, other.lost, other.entries_lost, other.commands_lost, other.events, dict(other.live)
    return (
        plain == (*others, other.is_full)
        and one.frames.tobytes() == other.frames.tobytes()
        and one.entries.tobytes() == other.entries.tobytes()
    )


SIZES = st.tuples(st.integers(0, 1 << 60), st.integers(1, 40), st.integers(0, 9), st.integers(0, 5), st.integers(0))


@given(SIZES, st.booleans())
def test_a_block_comes_back_bit_by_bit(sizes: tuple[int, ...], wild: bool) -> None:
    first, count, objects, signals, seed = sizes
    layout = layout_of(objects, signals)
    block = block_at_random(layout, first, count, seed, wild=wild)
    assert same(block_of(layout, exact_message(block), columns_message(block, layout)), block)


@given(st.integers(0, 1 << 30), st.floats(1e-9, 1e9), st.floats(-1e6, 1e6))
def test_values_that_follow_from_raws_come_back_bit_by_bit(seed: int, resolution: float, offset: float) -> None:
    layout = layout_of(4)
    for entry in layout.objects[:3]:
        entry.update(resolution=resolution, zero_offset=offset)
    block = block_at_random(layout, 0, 20, seed)
    block.frames["values"][:, :2] = block.frames["raws"][:, :2] * resolution + offset
    block.frames["values"][3, 1] = np.nan
    message = columns_message(block, layout)
    assert b'"following":[0]' in message
    assert same(block_of(layout, exact_message(block), message), block)


def test_what_replay_needs_comes_back_without_the_rest() -> None:
    layout = layout_of()
    block = block_at_random(layout, 5, 30, 1)
    found = block_of(layout, exact_message(block), None)
    assert not found.is_full and np.isnan(found.frames["values"]).all()
    assert (found.frames["raws"] == block.frames["raws"]).all() and found.first == 5


@given(st.binary(max_size=200), st.integers(0, 400))
def test_a_damaged_block_is_an_error_in_words(garbage: bytes, at: int) -> None:
    layout = layout_of()
    message = exact_message(block_at_random(layout, 0, 3, 1))
    for data in (garbage, message[:at] if at < len(message) else b""):
        with pytest.raises(FramesError):
            block_of(layout, data, None)


def test_a_file_gives_its_blocks_frames_events_and_commands(tmp_path: Path) -> None:
    layout = layout_of()
    blocks = [block_at_random(layout, 100 * i, 100, i) for i in range(5)]
    path = tmp_path / "run.mcap"
    file = RecordingFile(path, layout)
    for block in blocks:
        file.add([block])
    file.close()
    with Recording(path) as recording:
        assert all(map(same, recording.blocks(), blocks)) and recording.layout == layout
        assert len(list(recording.blocks())) == 5 and recording.is_whole and not recording.gaps
        assert recording.frames(0.15, 0.32)["number"].tolist() == list(range(151, 321))
        assert len(recording.events) == 5 and len(recording.commands) == 10
        assert recording.frames().tobytes() == b"".join(block.frames.tobytes() for block in blocks)


def test_missing_frames_are_gaps(tmp_path: Path) -> None:
    layout = layout_of(job={"station": "press"})
    file = RecordingFile(tmp_path / "run.mcap", layout)
    late = replace(block_at_random(layout, 30, 5, 2), lost=7)
    file.add([block_at_random(layout, 8, 15, 1), late])
    file.close()
    with Recording(tmp_path / "run.mcap") as recording:
        assert recording.gaps == [LostFrames(23, 7)] and not recording.complete
        assert [block.lost for block in recording.blocks()] == [0, 7]
        assert recording.replayable_from is not None and "period 8" in recording.replayable_from


def test_another_file_is_an_error_in_one_line(tmp_path: Path) -> None:
    for content in (b"", b"umoframe", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(100)):
        (tmp_path / "x.mcap").write_bytes(content)
        with pytest.raises(FramesError) as error:
            Recording(tmp_path / "x.mcap")
        assert "\n" not in str(error.value)
    with pytest.raises(FramesError, match="No such file"):
        Recording(tmp_path / "none.mcap")


def test_nobody_else_reads_a_file_which_has_commands_with_their_keys(tmp_path: Path) -> None:
    mask = os.umask(0)
    try:
        file = RecordingFile(tmp_path / "run.mcap", layout_of())
        file.add([block_at_random(layout_of(), 0, 3, 1)])
        file.close()
        join([tmp_path / "run.mcap"], tmp_path / "joined.mcap")
        thin(tmp_path / "run.mcap")
    finally:
        os.umask(mask)
    assert {each.stat().st_mode & 0o777 for each in tmp_path.iterdir()} == {0o600}
