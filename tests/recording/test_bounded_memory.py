"""Opening a file takes 256 MB at most, whatever it says of its sizes. Each is opened by `umo recording info` in a
process."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import zstandard

from helpers.recorded import block_at_random, layout_of
from helpers.tiers import first
from umo.errors import FramesError
from umo.recording import mcap_records, recording_scan
from umo.recording import recording as recording_module
from umo.recording.block import exact_message
from umo.recording.mcap_records import ChunkIndex, McapChannel, Opcode
from umo.recording.recording import Recording, describe
from umo.recording.recording_file import RecordingFile
from umo.recording.tables.recording_summary import facts_of

LAYOUT = layout_of(2, 1, job={"station": "press"}, wiring="")
MOST = 256 << 20
PROGRAM = """
import resource, sys
from pathlib import Path
from umo_command.recording.files import info
from umo.errors import UmoError
try:
    info(Path(sys.argv[1]), False)
except UmoError as error:
    print("told:", error)
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print("peak", int(peak.split()[1]) * 1024)
"""


def peak(path: Path) -> tuple[int, str]:
    """Bytes of memory that `umo recording info` has taken at most, and what it has said."""
    command = [sys.executable, "-c", PROGRAM, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    *said, last = done.stdout.splitlines()
    return int(last.split()[1]), "\n".join(said)


def begun(description: Mapping[str, str] | None = None) -> bytearray:
    data = bytearray(mcap_records.header("umo"))
    data += mcap_records.metadata("umo", dict(description or describe(LAYOUT)))
    return data + mcap_records.channel(McapChannel(1, "umo/exact", "umo"))


def chunk(content: bytes, size: int | None = None) -> bytes:
    packed = zstandard.ZstdCompressor(level=1).compress(content)
    return mcap_records.chunk(1, 2, len(content) if size is None else size, zlib.crc32(content), packed)


def exact(text: bytes, rest: bytes = b"") -> bytes:
    """A message with this description."""
    return mcap_records.message(1, 1, 1, struct.pack("<I", len(text)) + text + rest)


def head(**about: Any) -> bytes:
    told: dict[str, Any] = {"first": 0, "count": 1, "time": 0.0, "lost": 0, "entries": 0, "entries_lost": 0,
                            "commands": [], "commands_lost": 0, "events": [], "live": {}, "number": 0}  # fmt: skip
    return json.dumps(told | about).encode()


def last(first: int = 1 << 40) -> bytes:
    """A chunk with a sound block, so that all before it is read."""
    return chunk(mcap_records.message(1, 1, 1, exact_message(block_at_random(LAYOUT, first, 1, 0))))


def a_frame_of_gigabytes(path: Path) -> None:
    """1 GB of zeros in 33 kB; the chunk says that it has 1 kB."""
    stream = zstandard.ZstdCompressor(level=1).compressobj(size=1 << 30)
    packed = b"".join(stream.compress(bytes(1 << 24)) for _ in range(64)) + stream.flush()
    for size in (1000, 1 << 30):
        path.write_bytes(begun() + mcap_records.chunk(1, 2, size, 0, packed))


def a_frame_without_a_size(path: Path) -> None:
    stream = zstandard.ZstdCompressor(level=1).compressobj()
    packed = b"".join(stream.compress(bytes(1 << 24)) for _ in range(64)) + stream.flush()
    path.write_bytes(begun() + mcap_records.chunk(1, 2, 1000, 0, packed))


def the_largest_content(path: Path) -> None:
    content = mcap_records.message(9, 1, 1, bytes(60 << 20))
    path.write_bytes(begun() + chunk(content) * 4)


def a_block_of_a_trillion_periods(path: Path) -> None:
    path.write_bytes(begun() + chunk(exact(head(count=10**12))) + chunk(exact(head(first=1 << 61, entries=1 << 40))))


def a_block_as_large_as_allowed(path: Path) -> None:
    count = (60 << 20) // LAYOUT.dtype.itemsize
    path.write_bytes(begun() + chunk(exact(head(count=count), bytes(200 + 8 * count))))


def a_deep_description(path: Path) -> None:
    path.write_bytes(begun() + chunk(exact(b"[" * (8 << 20))) + chunk(exact(b'{"first":' * (1 << 19))))


def a_description_of_many_lists(path: Path) -> None:
    text = head(live={"x": "HERE"}).replace(b'"HERE"', b"[" + b"[]," * 200_000 + b"1]")
    path.write_bytes(
        begun() + b"".join(chunk(exact(text.replace(b'"first": 0', b'"first": %d' % i))) for i in range(20))
    )


def many_events(path: Path) -> None:
    events = [[n, 1.0, "press", "x" * 100, "", 0, 0, "set"] for n in range(20_000)]
    chunks = [chunk(exact(head(first=i, time=float(i), events=events))) for i in range(60)]
    path.write_bytes(begun() + b"".join(chunks) + last())


def many_blocks(path: Path) -> None:
    found = bytearray()
    for number in range(12):
        rows = b"".join(exact(head(first=100_000 * number + each)) for each in range(99_000))
        found += chunk(rows)
    path.write_bytes(begun() + found + last())


def many_messages(path: Path) -> None:
    path.write_bytes(begun() + chunk(exact(b"") * 1_500_000))


def a_huge_schema(path: Path) -> None:
    """Of 4 GB, most of it a hole of the file."""
    with open(path, "wb") as file:
        file.write(begun() + mcap_records.HEAD.pack(Opcode.SCHEMA, 4 << 30))
        file.truncate((4 << 30) + file.tell())


def many_small_descriptions(path: Path) -> None:
    some = b"".join(mcap_records.metadata(f"{number:x}", {}) for number in range(1_500_000))
    path.write_bytes(begun() + some)


def a_mapping_of_many_texts(path: Path) -> None:
    texts = b"".join(mcap_records.string(f"{number:x}") + mcap_records.string("") for number in range(2_000_000))
    body = mcap_records.string("units") + struct.pack("<I", len(texts)) + texts
    path.write_bytes(begun() + mcap_records.record(Opcode.METADATA, body))


def a_description_of_many_values(path: Path) -> None:
    about = describe(LAYOUT)
    about["description"] = about["description"].replace('"objects": [', '"objects": [' + "[]," * 4_000_000, 1)
    path.write_bytes(begun(about))


def an_index_of_many_chunks(path: Path) -> None:
    data, one = begun(), chunk(exact(head()))
    row = mcap_records.chunk_index(ChunkIndex(1, 2, len(data), len(one), {}, 0, 1, 1))
    data += one
    path.write_bytes(bytes(data) + mcap_records.closing(len(data), 0, [(Opcode.CHUNK_INDEX, row * 1_500_000)]))


def an_index_of_chunks_that_are_not_there(path: Path) -> None:
    indexed(path, 999_000)


def many_gaps(path: Path) -> None:
    write_blocks(path, 2_900_000, 99_000, lambda number: head(first=2 * number))


def many_black_boxes(path: Path) -> None:
    box = [0, 1, 0.0, 0.0, "", 0, ""]
    write_blocks(path, 40, 1, lambda number: head(first=number, boxes=[box] * 50_000))


def indexed(path: Path, count: int) -> None:
    """A closed file whose summary has so many chunks more than there are."""
    data, one = begun(), last()
    at, size = len(data), mcap_records.read_chunk(memoryview(one)[9:], len(one) - 9).size
    places = range(at, at + count)
    rows = (mcap_records.chunk_index(ChunkIndex(1, 2, each, len(one), {}, 0, 1, size)) for each in places)
    first = len(mcap_records.header("umo"))
    about = mcap_records.metadata_index(first, len(mcap_records.metadata("umo", describe(LAYOUT))), "umo")
    groups = [(Opcode.CHUNK_INDEX, b"".join(rows)), (Opcode.METADATA_INDEX, about)]
    path.write_bytes(bytes(data) + one + mcap_records.closing(at + len(one), 0, groups))


def write_blocks(path: Path, count: int, together: int, text: Callable[[int], bytes], between: bytes = b"") -> None:
    """A file with so many blocks, some of them in a chunk."""
    with open(path, "wb") as file:
        file.write(begun())
        for number in range(0, count, together):
            numbers = range(number, min(number + together, count))
            file.write(chunk(b"".join(exact(text(each)) for each in numbers)) + between)
        file.write(last())


BOMBS: list[Callable[[Path], None]] = [
    a_frame_of_gigabytes, a_description_of_many_lists, the_largest_content, a_frame_without_a_size, a_huge_schema,
    a_block_of_a_trillion_periods, a_block_as_large_as_allowed, a_deep_description, many_events, many_blocks,
    many_messages, many_small_descriptions, a_mapping_of_many_texts, a_description_of_many_values,
    an_index_of_many_chunks, an_index_of_chunks_that_are_not_there, many_gaps, many_black_boxes,
]  # fmt: skip


@pytest.mark.parametrize("bomb", first(1, BOMBS), ids=lambda bomb: bomb.__name__)
def test_no_file_takes_more_than_256_megabytes_to_open(tmp_path: Path, bomb: Callable[[Path], None]) -> None:
    path = tmp_path / "bomb.mcap"
    bomb(path)
    taken, said = peak(path)
    print(f"{bomb.__name__}: {path.stat().st_size / 1e6:.1f} MB, {taken / 1e6:.0f} MB of memory")
    assert taken <= MOST, said[-500:]
    assert "told:" in said or "not whole" in said


def damaged_places(path: Path, count: int) -> None:
    write_blocks(path, count, 1, lambda number: head(first=number), between=bytes(16))


def repeated_blocks(path: Path, count: int) -> None:
    write_blocks(path, count, 1, lambda number: head())


def missing_chunks(path: Path, count: int) -> None:
    indexed(path, count)


def gaps(path: Path, count: int) -> None:
    write_blocks(path, count, 500, lambda number: head(first=2 * number))


def black_boxes(path: Path, count: int) -> None:
    box = [0, 1, 0.0, 0.0, "", 0, ""]
    write_blocks(path, count // 10, 10, lambda number: head(first=number, boxes=[box] * 10))


def events(path: Path, count: int) -> None:
    event = [0, 1.0, "", "", "", 0, 0, ""]
    write_blocks(path, count // 10, 10, lambda number: head(first=number, events=[event] * 10))


@pytest.mark.parametrize("many", first(3, [missing_chunks, black_boxes, events, damaged_places, repeated_blocks, gaps]))
def test_what_a_file_has_many_of_takes_next_to_no_memory_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, many: Callable[[Path, int], None]
) -> None:
    """Beyond what is told singly: the place of a block or a chunk in an array, or of the summary until it was read."""
    monkeypatch.setattr(recording_module, "MAX_GAPS", 100)
    monkeypatch.setattr(recording_scan, "MAX_KEPT", 100 << 10)
    few, more = 2_000, 4_000
    taken = []
    for count in (few, more):
        many(tmp_path / f"{count}.mcap", count)
        tracemalloc.start()
        try:
            with Recording(tmp_path / f"{count}.mcap") as recording:
                facts_of(recording)
            taken.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert (taken[1] - taken[0]) / (more - few) < 120


@pytest.mark.full
@pytest.mark.parametrize(("objects", "rows"), [(1000, 1000), (10_000, 100)])
def test_a_large_machine_is_opened_within_them(tmp_path: Path, objects: int, rows: int) -> None:
    path = tmp_path / "run.mcap"
    layout = layout_of(objects, 10, job={"station": "press"}, wiring="")
    file = RecordingFile(path, layout)
    numbers: Sequence[int] = range(5)
    for number in numbers:
        file.add([block_at_random(layout, rows * number, rows, number)])
    file.close()
    taken, said = peak(path)
    print(f"{objects} objects: {taken / 1e6:.0f} MB")
    assert taken <= MOST and "whole" in said


@pytest.mark.parametrize("part", ["x", "", "1.5"])
def test_a_malformed_part_is_told(tmp_path: Path, part: str) -> None:
    texts = describe(LAYOUT) | {"part": part}
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes(begun(texts | {"checksum": recording_module._checksum(texts)})) + chunk(exact(head())))
    with pytest.raises(FramesError, match="is damaged"):
        Recording(path)


@pytest.mark.parametrize("changed", [{"first": float("inf")}, {"events": [[1, 2, 3]]}, {"boxes": [[1]]}], ids=str)
def test_a_malformed_block_is_told(tmp_path: Path, changed: dict[str, Any]) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes(begun()) + chunk(exact(head(**changed))))
    with pytest.raises(FramesError, match="is damaged"), Recording(path) as recording:
        facts_of(recording)
