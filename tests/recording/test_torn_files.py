"""Files that were cut, torn, or met a full disk: ours opens them, and makes them whole for others."""

from __future__ import annotations

import errno
import os
import random
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader

from helpers.recorded import block_at_random, layout_of
from helpers.tiers import first
from umo.errors import FramesError
from umo.recording import mcap_reader
from umo.recording.copying import repair
from umo.recording.mcap_reader import McapReader
from umo.recording.mcap_records import Opcode
from umo.recording.protobuf_channels import ProtobufChannels
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.tables.recording_summary import facts_of

LAYOUT = layout_of(2, 1)


def written(path: Path, blocks: int = 4) -> list[int]:
    """A small file; its size after each block."""
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    sizes = []
    for number in range(blocks):
        file.add([block_at_random(LAYOUT, 3 * number, 3, number)])
        sizes.append(file.size)
    file.close()
    return sizes


def others_read(path: Path) -> int:
    """Periods that the reader of mcap.dev finds by the index."""
    with open(path, "rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages(["machine"]))


def test_each_write_is_there_at_once_and_for_others_when_the_file_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    for number in range(5):
        file.add([block_at_random(LAYOUT, 3 * number, 3, number)])
        with Recording(path) as recording:
            assert not recording.is_whole and "was not closed" in recording.damage[-1]
            assert len(recording.frames()) == 3 * number + 3
    file.close()
    assert others_read(path) == 15
    with Recording(path) as recording:
        assert recording.is_whole and not recording.damage


def test_a_file_that_is_opened_in_the_middle_of_a_write_has_what_was_there_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, put = tmp_path / "run.mcap", os.pwrite
    file = RecordingFile(path, LAYOUT)
    for number in range(60):
        file.add([block_at_random(LAYOUT, 3 * number, 3, number)])
    seen = []

    def write_and_look(to: int, view: memoryview, at: int) -> int:
        put(to, bytes(view)[:200], at)
        with Recording(path) as recording:
            seen.append(len(recording.frames()))
        return put(to, view, at)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", write_and_look)
        file.add([block_at_random(LAYOUT, 180, 3, 60)])
    assert seen == [180]
    file.close()


def test_little_more_is_written_than_the_file_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On flash memory each byte that is written counts."""
    put, written = os.pwrite, [0]

    def counted(to: int, view: memoryview, at: int) -> int:
        written[0] += len(view)
        return put(to, view, at)

    monkeypatch.setattr(os, "pwrite", counted)
    path = tmp_path / "run.mcap"
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    for number in range(150):
        file.add([block_at_random(LAYOUT, 10 * number, 10, number)])
    file.close()
    assert path.stat().st_size <= written[0] <= 1.1 * path.stat().st_size


@pytest.mark.parametrize(("part", "step"), first(1, [(0, 421), *((part, 40) for part in range(40))]))
def test_a_file_that_was_cut_anywhere_is_read_as_far_as_it_goes(tmp_path: Path, part: int, step: int) -> None:
    whole, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    written(whole)
    content, file = whole.read_bytes(), McapReader(whole)
    ends = [at + len(file.raw(at)) for at in file.chunks]
    for at in range(part, len(content), step):
        cut.write_bytes(content[:at])
        try:
            with Recording(cut) as recording:
                count = len(recording.frames())
                assert not recording.is_whole
        except FramesError as error:
            assert "\n" not in str(error) and at < file.chunks[0]
            continue
        assert count == 3 * sum(end <= at for end in ends)
        repair(cut)
        assert others_read(cut) == count
        with Recording(cut) as recording:
            assert recording.is_whole and len(recording.frames()) == count
    file.close()


@pytest.mark.parametrize("seed", first(3, range(200)))
def test_a_chunk_that_was_torn_costs_none_before_it(tmp_path: Path, seed: int) -> None:
    path, luck = tmp_path / "run.mcap", random.Random(seed)
    written(path, 3)
    before = McapReader(path)
    last, end = before.chunks[-1], before.chunks[-1] + len(before.raw(before.chunks[-1]))
    before.close()
    content = bytearray(path.read_bytes()[:end])
    at = luck.randrange(last + 60, end - 40)
    content[at : at + luck.randrange(1, 200)] = b""
    path.write_bytes(content)
    with Recording(path) as recording:
        assert len(recording.frames()) == 6
    assert repair(path) and others_read(path) == 6


def test_a_whole_file_is_not_repaired(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    written(path)
    content = path.read_bytes()
    assert not repair(path) and path.read_bytes() == content


def test_a_bit_in_the_length_of_a_message_index_costs_no_chunk(tmp_path: Path) -> None:
    """Of a file that is not closed: what follows is not taken for a part of the index."""
    path = tmp_path / "run.mcap"
    end = written(path, 6)[-1]
    file = McapReader(path)
    at = file.chunks[1] + len(file.raw(file.chunks[1]))
    file.close()
    content = path.read_bytes()[:end]
    assert content[at] == Opcode.MESSAGE_INDEX
    for bit in range(20):
        changed = bytearray(content)
        changed[at + 1 + bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with Recording(path) as recording:
            assert recording.periods == 18, bit


def test_a_sector_that_cannot_be_read_costs_its_chunk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, get = tmp_path / "run.mcap", os.pread
    written(path)
    file = McapReader(path)
    bad = file.chunks[1] + len(file.raw(file.chunks[1])) // 2
    file.close()

    def pread(number: int, length: int, at: int) -> bytes:
        if at <= bad < at + length:
            raise OSError(errno.EIO, "Input/output error")
        return get(number, length, at)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pread", pread)
        with Recording(path) as recording:
            assert len(recording.frames()) == 9 and "it cannot be read: Input/output error" in recording.damage[0]
        assert repair(path)
    assert others_read(path) == 9


# A full disk --------------------------------------------------------------------------------------------


def unreadable(patch: pytest.MonkeyPatch, at: int, size: int) -> None:
    """Bytes of which none can be read: as with Linux a read ends before them, and one that begins in them fails."""
    whole = os.pread

    def pread(file: int, length: int, place: int) -> bytes:
        if at <= place < at + size:
            raise OSError(errno.EIO, "Input/output error")
        return whole(file, min(length, at - place) if place < at else length, place)

    patch.setattr(os, "pread", pread)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("sector", first(4, [0, 1, 40, 8, *range(2, 100)]))
def test_a_sector_that_cannot_be_read_is_told_wherever_it_lies_and_what_is_behind_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sector: int, closed: bool
) -> None:
    path = tmp_path / "run.mcap"
    sizes = written(path, 8)
    if not closed:
        os.truncate(path, sizes[-1])
    monkeypatch.setattr(mcap_reader, "SECTOR", 64)
    unreadable(monkeypatch, 64 * sector, 64)
    try:
        with Recording(path) as recording:
            told, periods = "\n".join(recording.damage), len(recording.frames())
            facts_of(recording)
    except FramesError as error:
        assert re.search(r"at byte [\d,]+:? .*cannot be read", str(error)), "it is its beginning or its description"
        assert 64 * sector < sizes[0]
    else:
        assert periods >= 24 - 2 * 3
        assert periods == 24 or "cannot be read" in told
        assert told or 64 * sector > path.stat().st_size


@contextmanager
def room(patch: pytest.MonkeyPatch, size: int) -> Iterator[None]:
    """A disk on which files can have so many bytes at most, in the block."""
    write = os.pwrite

    def pwrite(file: int, data: memoryview, at: int) -> int:
        if at >= size:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[: size - at], at)

    with patch.context() as patched:
        patched.setattr(os, "pwrite", pwrite)
        yield


@pytest.mark.parametrize(("part", "step"), first(1, [(0, 211), *((part, 97) for part in range(20))]))
def test_a_full_disk_costs_nothing_that_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int, step: int
) -> None:
    sizes = written(tmp_path / "like.mcap", 2)
    closed = (tmp_path / "like.mcap").stat().st_size
    for size in range(100 + part, closed + 1, step):
        path = tmp_path / f"{size}.mcap"
        done = -1
        with room(monkeypatch, size):
            try:
                file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
            except OSError:
                assert not path.exists()
                continue
            try:
                for done in range(2):
                    file.add([block_at_random(LAYOUT, 3 * done, 3, done)])
                done = 2
            except OSError as error:
                assert error.errno == errno.ENOSPC
            closes = True
            try:
                file.close()
            except OSError as error:
                assert error.errno == errno.ENOSPC
                closes = False
        with Recording(path) as recording:
            assert recording.is_whole is closes and len(recording.frames()) == 3 * max(done, 0)
            assert path.stat().st_size <= size and done == sum(each <= size for each in sizes)
        assert repair(path) is not closes and others_read(path) == 3 * max(done, 0)
        path.unlink()


# Kills --------------------------------------------------------------------------------------------------


def write_without_pause(path: Path) -> None:
    """In a child, until it is killed: a write after the other, so that most kills fall into one."""
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    number = 0
    while True:
        file.add([block_at_random(LAYOUT, 50 * number, 50, number % 7)])
        number += 1


def killed(path: Path, after: int) -> None:
    """A file of a process that was killed when it had about so many bytes."""
    child = os.fork()
    if child == 0:
        try:
            write_without_pause(path)
        finally:
            os._exit(1)
    while not path.exists() or path.stat().st_size < after:
        assert os.waitpid(child, os.WNOHANG) == (0, 0)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


@pytest.mark.parametrize("kills", first(1, [2, 198]))
def test_a_recorder_that_is_killed_leaves_a_file_that_opens(tmp_path: Path, kills: int) -> None:
    for number in range(kills):
        path = tmp_path / "run.mcap"
        path.unlink(missing_ok=True)
        killed(path, 20_000 + 7_919 * (number % 23))
        with Recording(path) as recording:
            assert not recording.is_whole and not recording.complete
            frames = recording.frames()
        assert frames["number"].tolist() == list(range(1, len(frames) + 1)) and len(frames) > 50
        repair(path)
        assert others_read(path) == len(frames)
