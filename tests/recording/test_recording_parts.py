"""Recordings of several files, with what is missing or damaged of them."""

from __future__ import annotations

import errno
import os
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from helpers.recorded import block_at_random, layout_of
from umo.errors import OptionError
from umo.recording.copying import join
from umo.recording.mcap_reader import McapReader
from umo.recording.part_names import part_name
from umo.recording.record_settings import RecordSettings, record_of
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.recording_parts import RecordingParts
from umo_command.run.record_beside import order_of

LAYOUT = layout_of(2, 1)


def written(path: Path, blocks: int, part: int = 1, first: int = 0) -> None:
    """A file with blocks of three frames."""
    file = RecordingFile(path, LAYOUT, part=part)
    for number in range(first, first + blocks):
        file.add([replace(block_at_random(LAYOUT, 3 * number, 3, number), entries_lost=0)])
    file.close()


def damage(path: Path, number: int) -> None:
    """Change a byte in the middle of a chunk."""
    file, content = McapReader(path), bytearray(path.read_bytes())
    content[file.chunks[number] + 60 + file.head(file.chunks[number]).length // 2] ^= 255
    file.close()
    path.write_bytes(content)


@pytest.mark.parametrize("damaged", range(9))
def test_a_damaged_chunk_costs_no_others_wherever_one_begins_to_read(tmp_path: Path, damaged: int) -> None:
    path = tmp_path / "run.mcap"
    written(path, 9)
    damage(path, damaged)
    with Recording(path) as recording:
        whole = recording.frames()["time"]
        assert len(whole) == 24
        for number in range(28):
            start = 0.001 * number - 0.0005
            assert recording.frames(start)["time"].tolist() == whole[whole >= start].tolist()


def test_a_part_that_was_cut_in_its_first_write_hides_none_of_the_others(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written(path, 2)
    written(part_name(path, 2), 2, 2, 2)
    part_name(path, 3).write_bytes(b"")
    with Recording(path) as recording:
        assert len(recording.frames()) == 12 and not recording.complete
    join([path, part_name(path, 2), part_name(path, 3)], tmp_path / "joined.mcap")
    with Recording(tmp_path / "joined.mcap") as recording:
        assert len(recording.frames()) == 12


def test_a_recording_may_have_the_name_of_a_part(tmp_path: Path) -> None:
    path = tmp_path / "trial.2.mcap"
    parts = RecordingParts(path, LAYOUT, settings=RecordSettings(rotate=0.002))
    for number in range(4):
        parts.add([block_at_random(LAYOUT, 3 * number, 3, number)])
    parts.close()
    assert len(parts.paths) > 1
    written(tmp_path / "trial.3.mcap", 1)
    with Recording(path) as recording:
        assert recording.parts == parts.paths and len(recording.frames()) == 12
    with Recording(parts.paths[1]) as recording:
        assert recording.parts == parts.paths[1:]


def test_a_rotation_that_finds_no_room_leaves_the_files_of_others_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number of a descriptor that was closed is that of the next file that anybody opens."""
    path = tmp_path / "run.mcap"
    parts = RecordingParts(path, LAYOUT, settings=RecordSettings(rotate=0.002))
    for number in range(2):
        parts.add([block_at_random(LAYOUT, 3 * number, 3, number)])
    put = os.pwrite
    closed = path.stat().st_ino

    def pwrite(file: int, data: memoryview, at: int) -> int:
        if os.fstat(file).st_ino == closed:
            raise OSError(errno.ENOSPC, "No space left on device")
        return put(file, data, at)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", pwrite)
        with pytest.raises(OSError, match="No space"):
            parts.add([block_at_random(LAYOUT, 6, 3, 2)])
        assert all(each in parts.paths for each in tmp_path.iterdir()) and len(parts.paths) == 2
    numbers = [open(tmp_path / f"other.{number}", "w+b") for number in range(4)]  # noqa: SIM115
    parts.close()
    parts.close()
    for other in numbers:
        other.write(b"mine")
        other.close()
        assert Path(other.name).read_bytes() == b"mine"
    with Recording(path) as recording:
        assert recording.periods == 6 and any("was not closed" in text for text in recording.damage)
        assert recording.parts == parts.paths
    with closing(McapReader(parts.paths[1])) as file:
        assert file.is_whole


def test_a_file_in_the_place_of_the_second_part_is_refused_before_the_run(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    part_name(path, 2).write_bytes(b"another recording")
    with pytest.raises(OptionError, match=r"run\.2\.mcap, the name of the second file, exists already"):
        order_of(path, {}, None, path)


@pytest.mark.parametrize("size", ["9" * 400 + " GB", "1 TB", "-1 MB", "99 kB", 5, None])
def test_what_is_no_size_of_a_file_is_told(size: object) -> None:
    table = {"size": size} if size is not None else {"keep": float("nan")}
    with pytest.raises(OptionError, match=r"is not a size|is less than 100 kB"):
        record_of(table)
