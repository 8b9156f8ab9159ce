"""Whatever happens to a file: what it costs is told by every reader, with what is missing; a value is never wrong."""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from helpers import recorded_old
from helpers.damages import Damage, applied, chunks_of, damages, fewest
from helpers.recorded import block_at_random, layout_of
from helpers.tapes import recorded, save
from helpers.tiers import first
from umo import load
from umo.cycle.events import CommandState, Event
from umo.errors import FramesError
from umo.process.frames.run_reader import NumberedEvent
from umo.recording import mcap_reader, mcap_records
from umo.recording import recording as recording_module
from umo.recording.block import Block
from umo.recording.copying import join, repair, thin
from umo.recording.extent import EXTENT
from umo.recording.mcap_records import McapChannel, Schema
from umo.recording.part_names import part_name
from umo.recording.protobuf_channels import ProtobufChannels
from umo.recording.record_settings import RecordSettings
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.recording_parts import RecordingParts
from umo.recording.replay.tape import NotReplayable, Periods
from umo.recording.tables.recording_summary import facts_of

Umo = Callable[..., Result]
LAYOUT = layout_of(3, 2, job={"station": "press"}, wiring="")
END = Event(0.0, "", "the application has ended", asked="end", state=CommandState.DONE)


def blocks(count: int, size: int) -> list[Block]:
    """Blocks of a whole run; the last one has its end."""
    made = []
    for number in range(count):
        block = block_at_random(LAYOUT, size * number, size, number)
        made.append(replace(block, entries_lost=0, entries=block.entries[:0], events=[], commands=[]))
    end = NumberedEvent(0, END._replace(time=float(made[-1].frames["time"][-1])))
    return [*made[:-1], replace(made[-1], events=[end])]


def small(path: Path) -> None:
    file = RecordingFile(path, LAYOUT)
    for block in blocks(6, 3):
        file.add([block])
    file.close()


def large(path: Path) -> None:
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT, 100))
    for block in blocks(5, 900):
        file.add([block])
    file.close()


def never_closed(path: Path) -> None:
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT, 100))
    for block in blocks(8, 40):
        file.add([block])
    shutil.copy(path, path.with_suffix(".open"))
    file.close()
    path.with_suffix(".open").replace(path)


def rotated(path: Path) -> None:
    parts = RecordingParts(path, LAYOUT, settings=RecordSettings(rotate=0.05))
    for block in blocks(9, 30):
        parts.add([block])
    parts.close()
    assert len(parts.paths) > 2


def of_a_flight(path: Path) -> None:
    """As a flight recorder saves it: older parts are thin."""
    parts = RecordingParts(path, LAYOUT, ProtobufChannels(LAYOUT), RecordSettings(rotate=0.05))
    for block in blocks(9, 30):
        parts.add([block])
    parts.close()
    thin(parts.paths[0])
    join(parts.paths, path.with_suffix(".saved"))
    for part in parts.paths:
        part.unlink()
    path.with_suffix(".saved").replace(path)


def of_umo_02(path: Path) -> None:
    recorded_old.write(path, LAYOUT, blocks(6, 30))


FORMS = [small, large, never_closed, rotated, of_a_flight, of_umo_02]


@dataclass
class Base:
    """A sound recording, and each of its frames by number."""

    path: Path
    content: dict[Path, bytes]
    frames: dict[int, bytes]
    chunks: dict[Path, list[tuple[int, int]]]


def rows(found: Any) -> dict[int, bytes]:
    numbers = (found["sequence"].astype(np.int64) // 2 - 1).tolist()
    assert numbers == sorted(set(numbers)), "no frame is there twice, and they are in order"
    return {number: row.tobytes() for number, row in zip(numbers, found, strict=True)}


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Base]:
    made = {}
    for form in FORMS:
        path = tmp_path_factory.mktemp(form.__name__) / "run.mcap"
        form(path)
        with Recording(path) as recording:
            assert recording.complete is (form is not never_closed)
            parts = {part: part.read_bytes() for part in recording.parts}
            chunks = {part: chunks_of(part) for part in parts}
            made[form.__name__] = Base(path, parts, rows(recording.frames()), chunks)
    return made


def faults(base: Base, folder: Path, places: Sequence[Damage]) -> list[str]:
    """What is wrong with how this damage is told; empty: nothing."""
    parts = list(base.content)
    part = parts[int(places[0].at * 7919) % len(parts)]
    for each in parts:
        content = base.content[each]
        (folder / each.name).write_bytes(applied(content, places, base.chunks[each]) if each is part else content)
    found = []
    try:
        with Recording(folder / base.path.name) as recording:
            seen = rows(recording.frames())
            found += [f"frame {number} has another value" for number in seen if base.frames.get(number) != seen[number]]
            if missing := base.frames.keys() - seen.keys():
                found += untold(recording, missing)
            told = bool(recording.damage)
        if len(parts) == 1:
            found += unrepaired(folder / base.path.name, seen, told)
    except (FramesError, NotReplayable) as error:  # it cannot be opened, which is told
        assert "\n" not in str(error)
    return found


def unrepaired(path: Path, seen: dict[int, bytes], told: bool) -> Iterator[str]:
    """What a repair in place loses, of its periods or of what is told of the others."""
    repair(path)
    with Recording(path) as recording:
        if rows(recording.frames()) != seen:
            yield "a repair has lost periods, or has others"
        if not recording.is_whole:
            yield "a repaired file is not whole"
        if told and not recording.damage and not recording.gaps and not recording.complete:
            yield "a repair has hidden the damage"


def untold(recording: Recording, missing: set[int]) -> Iterator[str]:
    """Who does not tell that periods are missing."""
    facts = facts_of(recording)
    if recording.complete:
        yield "Recording.complete"
    if facts["complete"] or not (facts["damage"] or facts["gaps"]) or json.dumps(facts, default=str) == "":
        yield "info"
    if not recording.damage and not recording.gaps:
        yield "export, load"
    lost = sum(gap.count for gap in recording.gaps)
    knows = recording.is_whole and all(EXTENT in file.metadata for file in recording._files)
    if knows and len(recording.parts) == 1 and lost != len(missing):
        yield f"{lost} of {len(missing)} are told as missing"
    if recording.replayable_from is None:
        periods = Periods(recording)
        if sum(1 for _ in periods) and not periods.ended:
            yield "replay"


def check(base: Base, folder: Path, seed: int) -> None:
    places = damages(seed)
    if faults(base, folder, places):
        places = fewest(places, lambda each: bool(faults(base, folder, each)))
        pytest.fail(f"seed {seed}, {base.path.parent.name}: {places}: {faults(base, folder, places)}")


@pytest.mark.parametrize("seeds", first(1, [range(5), *(range(i, i + 96) for i in range(5, 1000, 96))]), ids=str)
@pytest.mark.parametrize("form", [form.__name__ for form in FORMS])
def test_damage_that_costs_a_period_is_told_and_no_value_is_wrong(
    bases: dict[str, Base], tmp_path: Path, form: str, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        check(bases[form], tmp_path, seed)


def test_bytes_all_over_a_small_file_may_flip(bases: dict[str, Base], tmp_path: Path) -> None:
    base = bases["small"]
    size = len(base.content[base.path])
    for at in range(0, size, 211):
        assert not faults(base, tmp_path, [Damage("bit", (at + 0.5) / size, 0.0, at)]), at


@pytest.mark.full
def test_each_byte_of_each_file_may_flip(bases: dict[str, Base], tmp_path: Path) -> None:
    for name in ("small", "never_closed", "of_umo_02"):
        size = len(bases[name].content[bases[name].path])
        for at in range(size):
            assert not faults(bases[name], tmp_path, [Damage("bit", (at + 0.5) / size, 0.0, at // 3)]), (name, at)


def metadata() -> bytes:
    return mcap_records.metadata("umo", {"first": "0", "stop": "3"})[9:]


LENGTHS: dict[str, tuple[bytes, Callable[[memoryview], Any], tuple[int, ...]]] = {
    "metadata": (metadata(), mcap_records.read_metadata, (0, 7, 11, 20, 25)),
    "schema": (mcap_records.schema(Schema(1, "a", "b", b"data"))[9:], mcap_records.read_schema, (2, 7, 12)),
    "channel": (
        mcap_records.channel(McapChannel(1, "a", "b", 1, {"c": "d"}))[9:], mcap_records.read_channel, (4, 9, 14, 18),
    ),
    "statistics": (
        mcap_records.statistics({1: 5}, schemas=1, channels=1, metadata=1, chunks=1, first=1, last=2)[9:],
        mcap_records.read_counts, (42,),
    ),
    "metadata index": (mcap_records.metadata_index(8, 20, "umo")[9:], mcap_records.read_metadata_index, (16,)),
}  # fmt: skip
"""A record, what reads it, and where lengths stand in it."""


@pytest.mark.parametrize("kind", LENGTHS)
@pytest.mark.parametrize("more", [1, 100, 0xFFFF_0000])
def test_a_length_that_is_greater_than_what_it_is_in_is_an_error(kind: str, more: int) -> None:
    body, reads, places = LENGTHS[kind]
    reads(memoryview(body))
    for at in places:
        changed = bytearray(body)
        changed[at : at + 4] = (int.from_bytes(body[at : at + 4], "little") + more).to_bytes(4, "little")
        with pytest.raises((ValueError, struct.error)):
            reads(memoryview(changed))


@pytest.mark.parametrize("change", [1, -1, 200])
def test_a_file_whose_periods_have_a_wrong_length_says_so(tmp_path: Path, change: int) -> None:
    small(path := tmp_path / "run.mcap")
    data = bytearray(path.read_bytes())
    at = data.index(b"umo/periods") + len(EXTENT)  # the length of the texts
    data[at : at + 4] = (int.from_bytes(data[at : at + 4], "little") + change).to_bytes(4, "little")
    path.write_bytes(data)
    with Recording(path) as recording:
        assert any("the metadata 'umo/periods' are damaged: " in text for text in recording.damage)
        assert not recording.complete


# Planted faults of the reader --------------------------------------------------------------------------


def _without_checksums(patch: pytest.MonkeyPatch) -> None:
    def chunk(self: Any, at: int) -> bytes:
        head = self.head(at)
        return mcap_reader.content_of(head, self._at(at + 9 + head.begin, head.length))

    patch.setattr(mcap_reader.McapReader, "chunk", chunk)


def _without_extent(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(recording_module, "_extent_of", lambda file: None)
    patch.setattr(mcap_reader.McapReader, "counts", property(lambda self: {}, lambda self, value: None), raising=False)


def _without_order(patch: pytest.MonkeyPatch) -> None:
    def blocks(self: Any, start: Any = None, stop: Any = None, *, full: bool = True) -> Iterator[Block]:
        for place in self._chunks:
            for exact, columns in self._pairs(place):
                yield recording_module.block_of(self.layout, exact, columns if full else None)

    patch.setattr(recording_module, "in_order", lambda file: file.chunks)
    patch.setattr(Recording, "blocks", blocks)


def _without_the_checksum_of_the_description(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(recording_module, "_checksum", lambda texts: texts.get("checksum", ""))


def _without_notes(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Recording, "damage", [])


PLANTED = [
    _without_checksums, _without_extent, _without_order, _without_the_checksum_of_the_description, _without_notes,
]  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("plant", PLANTED, ids=lambda plant: plant.__name__)
def test_a_fault_of_the_reader_would_be_found(
    bases: dict[str, Base], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plant: Callable[[pytest.MonkeyPatch], None]
) -> None:
    """The thousand damages would find each of these faults of the reader."""
    plant(monkeypatch)
    caught = 0
    for form in bases:
        for seed in range(170):
            try:
                caught += bool(faults(bases[form], tmp_path, damages(seed)))
            except Exception:  # what was read makes no sense
                caught += 1
    print(f"{plant.__name__}: {caught} of {170 * len(bases)} damages show it")
    assert caught


# The commands ------------------------------------------------------------------------------------------


def one_bit(content: bytes, chunk: tuple[int, int]) -> bytes:
    data = bytearray(content)
    data[chunk[0] + (chunk[1] - chunk[0]) // 3] ^= 1
    return bytes(data)


def test_each_command_says_that_a_chunk_is_damaged(umo: Umo, bases: dict[str, Base], tmp_path: Path) -> None:
    base, path = bases["large"], tmp_path / "run.mcap"
    path.write_bytes(one_bit(base.content[base.path], base.chunks[base.path][-1]))
    info = umo("recording", "info", str(path)).stdout
    assert "lost       900 in 1 gap" in info and "not whole" in info and "at byte" in info, info
    told = umo("recording", "export", str(path), "--out", str(tmp_path / "run.npz"))
    assert "900 periods are missing in the recording" in told.stderr and "at byte" in told.stderr, told.output
    assert "900 periods are missing" in umo("recording", "repair", str(path)).stdout
    with Recording(path) as recording:
        assert recording.is_whole and recording.gaps and not recording.complete


@pytest.mark.full
@pytest.mark.parametrize("number", [-1, 0, 1])
def test_a_replay_and_a_dataset_say_that_a_chunk_is_damaged(umo: Umo, tmp_path: Path, number: int) -> None:
    path = save(recorded("conveyor", parts=1), tmp_path / "run.mcap")
    path.write_bytes(one_bit(path.read_bytes(), chunks_of(path)[number]))
    replayed = umo("recording", "replay", str(path))
    assert "lost" in replayed.stdout or "damaged" in replayed.output, replayed.output
    assert "at byte" in load(path).attrs["damage"] and load(path).attrs["periods_lost"] > 0


def test_a_repaired_file_still_says_what_it_lost(bases: dict[str, Base], tmp_path: Path) -> None:
    base, path = bases["large"], tmp_path / "run.mcap"
    content = bytearray(base.content[base.path])
    begin, end = base.chunks[base.path][-1]
    content[(begin + end) // 2] ^= 1
    path.write_bytes(content)
    assert repair(path) and not repair(path)
    with Recording(path) as recording:
        assert [(gap.first, gap.count) for gap in recording.gaps] == [(3600, 900)] and not recording.complete
        assert "900 of its 4,500 periods are missing" in recording.damage[0]


@pytest.mark.parametrize("number", [0, 2, -1])
def test_a_repaired_file_that_was_not_closed_still_says_what_was_damaged(
    bases: dict[str, Base], tmp_path: Path, number: int
) -> None:
    base, path = bases["never_closed"], tmp_path / "run.mcap"
    path.write_bytes(one_bit(base.content[base.path], base.chunks[base.path][number]))
    with Recording(path) as recording:
        seen = rows(recording.frames())
        assert len(seen) == len(base.frames) - 40
    assert repair(path) and not repair(path)
    with Recording(path) as recording:
        assert rows(recording.frames()) == seen and recording.is_whole and not recording.complete
        assert any("a chunk is damaged, " in text for text in recording.damage), recording.damage
        assert bool(recording.damaged_end) is (number == -1)


def test_a_repair_keeps_periods_that_lie_in_another_order(bases: dict[str, Base], tmp_path: Path) -> None:
    base, path = bases["never_closed"], tmp_path / "run.mcap"
    content, chunks = base.content[base.path], base.chunks[base.path]
    (a, b), (c, d) = chunks[0], chunks[1]
    path.write_bytes(content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:])
    assert repair(path)
    with Recording(path) as recording:
        assert rows(recording.frames()) == base.frames and recording.complete and not recording.damage


def test_a_repair_keeps_a_chunk_whose_times_are_damaged(bases: dict[str, Base], tmp_path: Path) -> None:
    """The times in the head of a chunk have no checksum; its content is sound."""
    base, path = bases["never_closed"], tmp_path / "run.mcap"
    content = bytearray(base.content[base.path])
    content[base.chunks[base.path][3][0] + 10] ^= 1
    path.write_bytes(content)
    assert repair(path)
    with Recording(path) as recording:
        assert rows(recording.frames()) == base.frames


def test_a_repaired_part_is_the_same_part(bases: dict[str, Base], tmp_path: Path) -> None:
    base = bases["rotated"]
    for part, content in base.content.items():
        (tmp_path / part.name).write_bytes(content)
    for part in list(base.content)[:2]:
        path = tmp_path / part.name
        path.write_bytes(one_bit(base.content[part], (base.chunks[part][-1][1] - 3, base.chunks[part][-1][1] - 2)))
        with Recording(path) as recording:
            before = rows(recording.frames())
        assert repair(path)
        with Recording(path) as recording:
            assert rows(recording.frames()) == before
        with Recording(path, later=False) as recording:
            assert len(rows(recording.frames())) < len(before)
    (tmp_path / list(base.content)[-1].name).unlink()
    for part in list(base.content)[1:-1]:
        (tmp_path / part.name).unlink()
    with Recording(tmp_path / base.path.name) as recording:
        assert f"the file that follows {base.path.name} is missing" in recording.damage


def test_a_part_that_is_missing_or_cannot_be_read_is_told(bases: dict[str, Base], tmp_path: Path) -> None:
    base, path = bases["rotated"], tmp_path / "run.mcap"
    parts = list(base.content)
    for lost in (2, len(parts)):
        for content in (None, b"", b"another file", base.content[parts[lost - 1]][300:]):
            for part in parts:
                (tmp_path / part.name).write_bytes(base.content[part])
            gone = part_name(path, lost)
            if content is None:
                gone.unlink()
            else:
                gone.write_bytes(content)
            with Recording(path) as recording:
                assert not recording.complete and recording.damage, (lost, content)
                periods = Periods(recording)
                assert sum(1 for _ in periods) < len(base.frames) and periods.ended


# Chunks ------------------------------------------------------------------------------------------------


def test_a_chunk_has_one_second_of_the_run_at_most(tmp_path: Path) -> None:
    """However many of them come in one write, as in virtual time."""
    path = tmp_path / "run.mcap"
    whole = block_at_random(LAYOUT, 0, 5_500, 1)
    file = RecordingFile(path, LAYOUT, ProtobufChannels(LAYOUT))
    file.add([replace(whole, entries_lost=0, entries=whole.entries[:0])])
    file.close()
    with Recording(path) as recording:
        assert recording.chunks == 6 and recording.frames().tobytes() == whole.frames.tobytes()
        for number in range(recording.chunks):
            times = np.concatenate([block.frames["time"] for block in recording.chunk(number)])
            assert len(times) <= 1000 and times[-1] - times[0] < 1.0


def test_a_chunk_has_one_megabyte_at_most(tmp_path: Path) -> None:
    layout = layout_of(400, 1)
    path = tmp_path / "run.mcap"
    file = RecordingFile(path, layout)
    random = np.random.default_rng(1)
    written = []
    for number in range(2):
        block = block_at_random(layout, 600 * number, 600, number)
        block.frames["values"] = random.normal(size=block.frames["values"].shape)
        written.append(replace(block, entries_lost=0, entries=block.entries[:0]))
        file.add([written[-1]])
    file.close()
    assert len(chunks_of(path)) > 3
    assert max(end - begin for begin, end in chunks_of(path)) < (1 << 20) + 1000
    with Recording(path) as recording:
        assert recording.frames().tobytes() == b"".join(block.frames.tobytes() for block in written)


def test_a_block_that_is_split_keeps_what_belongs_to_its_frames() -> None:
    tape = recorded("conveyor", stop=0.5)
    block = tape.recorded[0]
    parts, rest = [], block
    while len(rest.frames) > 70:
        part, rest = rest.split(70)
        parts.append(part)
    parts.append(rest)
    assert b"".join(part.frames.tobytes() for part in parts) == block.frames.tobytes()
    assert b"".join(part.entries.tobytes() for part in parts) == block.entries.tobytes()
    for number, part in enumerate(parts):
        for row in range(len(part.frames)):
            own, of_all = part.journal(row), block.journal(70 * number + row)
            assert own is not None and of_all is not None and own.tobytes() == of_all.tobytes()


def test_the_checksum_of_the_data_is_that_of_the_file(bases: dict[str, Base]) -> None:
    base = bases["small"]
    file = mcap_reader.McapReader(base.path)
    content = base.content[base.path]
    assert zlib.crc32(content[: file._data_end]) == int.from_bytes(content[file._data_end + 9 :][:4], "little")
    assert part_name(base.path, 1) == base.path and file.is_sound
    file.close()
