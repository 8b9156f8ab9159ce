"""A recording: the facts of a run, its exact frames, its events and the commands of its clients."""

from __future__ import annotations

import json
import zlib
from array import array
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from umo.errors import FramesError, text_of
from umo.process.frames.layout import Layout
from umo.process.frames.run_reader import Frames, NumberedEvent
from umo.recording.block import BlackBox, Block, TakenCommand, block_of, checked_text, headed
from umo.recording.chunk_order import COLUMNS, EXACT, REPEATED, damaged, in_order
from umo.recording.extent import DAMAGE, EXTENT, FOLLOWED, Extent, not_closed
from umo.recording.mcap_reader import McapReader
from umo.recording.part_names import later_parts
from umo.recording.recording_scan import BlockHead, FileScan, RecordingScan
from umo.text import in_brackets

FORMAT = "2"
"""Version of the messages of umo in a file. Files of version 1 (umo 0.2) can be read. Their description has no
checksum, and these files do not state which periods they contain."""
OLD_FORMAT = "1"
METADATA = "umo"
"""Name of the metadata record that describes a file."""
EXACT_TOPIC, COLUMNS_TOPIC = "umo/exact", "umo/columns"
EVENTS_TOPIC, ALARMS_TOPIC, COMMANDS_TOPIC, BOXES_TOPIC = "events", "alarms", "commands", "black_boxes"
SPARSE_TOPICS = frozenset({EXACT_TOPIC, EVENTS_TOPIC, ALARMS_TOPIC, COMMANDS_TOPIC, BOXES_TOPIC})
"""Topics whose data are kept from period 0 on, even if other data in old files are not kept."""
MALFORMED = "its description is malformed"
"""The text for a file whose description of the run is malformed."""
MAX_GAPS = 10_000
"""Largest number of gaps that are listed, beginning with the first."""


@dataclass(frozen=True)
class LostFrames:
    """A gap: frames that are missing."""

    first: int
    """Number of the first missing frame, from 0."""
    count: int


class _Place(NamedTuple):
    """The place of a chunk: its file, and its offset in the file."""

    file: McapReader
    at: int


class _Places(Sequence[_Place]):
    """The places of the chunks of all files, in order. Each takes 12 bytes of memory."""

    def __init__(self, files: Sequence[McapReader]) -> None:
        self._files, self._file_of, self._offsets = files, array("I"), array("q")
        for number, file in enumerate(files):
            offsets = in_order(file)
            self._offsets += offsets
            self._file_of += array("I", [number]) * len(offsets)

    def __len__(self) -> int:
        return len(self._offsets)

    def __getitem__(self, number: Any) -> Any:
        """Return one place, by its number."""
        return _Place(self._files[self._file_of[number]], self._offsets[number])

    def starting(self, number: int) -> Iterator[_Place]:
        """Yield the places from a number on."""
        return (self[each] for each in range(number, len(self)))


class Recording:
    """A file that `umo run --record` has written, with its later parts if it was rotated. A file can be read while it
    is being written. The recording then has the data that existed when the file was opened. Raises FramesError if the
    file is not a recording.

        with Recording("run.mcap") as recording:
            for block in recording.blocks():
                print(block.frames["time"], block.frames["values"])
    """

    def __init__(self, path: Path | str, *, later: bool = True) -> None:
        """`later`: True if the later files of a rotated recording are included."""
        self.path, self._later = Path(path), later
        self._files = [McapReader(self.path)]
        self._unread: list[str] = []
        """The reasons why later parts are not read."""
        try:
            self.about_file, self.layout = _described(self._files[0])
            for part in later_parts(self.path, int(self.about_file.get("part", "1"))) if later else ():
                self._add(part)
        except BaseException:
            self.close()
            raise
        self._chunks = _Places(self._files)

    def _add(self, path: Path) -> None:
        """Add a later part, if it belongs to the same run. A part that was truncated in its first write contains
        nothing and is not added."""
        try:
            file = McapReader(path)
        except FramesError as error:
            self._unread.append(str(error))
            return
        try:
            about, _ = _described(file)
        except FramesError as error:
            self._unread.append(str(error))
            about = {}
        if about.get("run", "") == self.about_file.get("run"):
            self._files.append(file)
        else:
            file.close()

    # What it is ----------------------------------------------------------------------------------------

    @property
    def about(self) -> dict[str, Any]:
        """The facts about the run: station, wiring, pid, start, and the period in s."""
        return self.layout.about

    @property
    def job(self) -> dict[str, Any]:
        """The job: station, wiring with its text, options, versions (`umo.process.job_facts`). A job that is malformed
        or could not be recorded has only `error`."""
        job: Any = self.about.get("job", {})
        if _is_table(job) and all(_is_table(job.get(name, {})) for name in ("options", "wiring", "versions")):
            given = job.get("options", {}).get("given", {})
            return dict(job) if _is_table(given) else {"error": MALFORMED}
        return {"error": MALFORMED}

    @property
    def is_whole(self) -> bool:
        """True if every file was closed. `umo recording repair` repairs a file that was truncated, or whose recorder
        was killed."""
        return all(file.is_whole for file in self._files)

    @cached_property
    def complete(self) -> bool:
        """True if the recording has all frames, entries, commands and events from its first frame to the end of the
        run."""
        return not self.damage and self._scan.is_exact and not self.lost and self.ended

    @cached_property
    def damage(self) -> list[str]:
        """Sentences that describe the damage and the data that are missing because of it; empty if there is no damage.
        The whole recording is read once for this."""
        _ = self._scan
        told = [*self._unread, *(text for file in self._files for text in self._damage_of(file))]
        last = self._files[-1]
        if self._later and FOLLOWED in last.metadata.get(EXTENT, {}):
            told.append(f"the file that follows {last.path.name} is missing")
        return told

    def _damage_of(self, file: McapReader) -> list[str]:
        name, seen = file.path.name, self._scan.files.get(file.path, FileScan())
        told = list(file.damaged.sentences(name, file.size))
        extent = _extent_of(file)
        if not file.is_whole:
            told.append(not_closed(name, seen.time if seen.blocks else None))
        elif not told and not file.is_sound:
            told.append(f"{name} is damaged outside of its chunks: other readers may fail, but no period is missing")
        if extent is not None and seen.periods != extent.periods:
            told.append(f"{name}: {extent.periods - seen.periods:,} of its {extent.periods:,} periods are missing")
        blocks = file.counts.get(EXACT, 0)
        if file.is_whole and extent is None and seen.blocks != blocks:
            told.append(f"{name}: {blocks - seen.blocks:,} of its {blocks:,} blocks are missing")
        return [*told, *file.metadata.get(DAMAGE, {}).values()]

    @cached_property
    def ended(self) -> bool:
        """True if the recording contains the end of the run."""
        return self._scan.end is not None

    @cached_property
    def first(self) -> int:
        """Number of the first frame, from 0."""
        return next((head.first for head in self._heads()), 0)

    @cached_property
    def replayable_from(self) -> str | None:
        """The reason why the recording cannot be replayed from period 0 on, or None if it can."""
        head = next(self._heads(), None)
        if head is None:
            return "the recording has no periods"
        if not self.job or "error" in self.job:
            return "the recording does not name the station or program that was run" + in_brackets(
                str(self.job.get("error", ""))
            )
        if head.first:
            if self._told_first is not None and self._told_first < head.first:
                return f"the first {head.first - self._told_first} periods are damaged"
            when = f"{head.time:g} s"
            return (
                f"the recording begins at period {head.first} ({when}), but sequences can only be replayed from "
                f"period 0"
            )
        return None

    # What is in it -------------------------------------------------------------------------------------

    def blocks(self, start: float | None = None, stop: float | None = None, *, full: bool = True) -> Iterator[Block]:
        """Yield, in order, the blocks with frames from `start` up to but not including `stop`, in s on the cycle's
        clock. Each has at most one second of the run. With `full` the blocks also contain the columns that replay does
        not need. A damaged chunk is skipped. Its frames count as lost in the following block (`damage`,
        `lost_at_end`)."""
        expected: int | None = None
        for place in self._chunks.starting(self._before(start)):
            for exact, columns in self._pairs(place):
                block = block_of(self.layout, exact, columns if full else None)
                if expected is not None and block.first < expected:
                    place.file.damaged.add(place.at, REPEATED)
                    continue
                if expected is not None and block.first > expected + block.lost:
                    block = replace(block, lost=block.first - expected)
                expected = block.stop
                times = block.frames["time"]
                if stop is not None and times[0] >= stop:
                    return
                if start is None or times[-1] >= start:
                    yield block

    def frames(self, start: float | None = None, stop: float | None = None) -> Frames:
        """Return the frames with times from `start` up to but not including `stop`, in s on the cycle's clock."""
        parts = [block.frames for block in self.blocks(start, stop)]
        if not parts:
            return np.zeros(0, self.layout.dtype)
        frames, at = np.zeros(sum(map(len, parts)), self.layout.dtype), 0
        for part in parts:
            frames[at : at + len(part)] = part
            at += len(part)
        wanted = np.ones(len(frames), bool)
        if start is not None:
            wanted &= frames["time"] >= start
        if stop is not None:
            wanted &= frames["time"] < stop
        return frames if wanted.all() else frames[wanted]

    @cached_property
    def events(self) -> list[NumberedEvent]:
        """The events of the run, in order."""
        kept = self._scan.kept_events
        return [event for head in self._heads() for event in head.events] if kept is None else kept

    @cached_property
    def black_boxes(self) -> list[BlackBox]:
        """The black boxes in order. They show where and why periods were missed, with at most one box in 10 s, and how
        a failed run ended. If there are more than about 10,000 boxes, only the last ones are listed; `black_box_count`
        counts all."""
        return list(self._scan.kept_boxes)

    @property
    def black_box_count(self) -> int:
        """Number of all black boxes."""
        return self._scan.boxes

    @cached_property
    def commands(self) -> list[TakenCommand]:
        """The commands that the machine has taken, in order."""
        return [command for block in self.blocks(full=False) for command in block.commands]

    @property
    def parts(self) -> list[Path]:
        """The files of the recording, in order."""
        return [file.path for file in self._files]

    @property
    def commands_taken(self) -> int:
        """Number of commands in the recording, counted without reading them."""
        return self._scan.commands

    @property
    def block_starts(self) -> tuple[Any, Any]:
        """Two arrays: the time of each block in s on the machine's clock, and the number of its frames."""
        return np.array(self._scan.times), np.array(self._scan.counts)

    @property
    def periods(self) -> int:
        """Number of periods in the recording, counted without reading them."""
        return self._scan.periods

    @cached_property
    def span(self) -> tuple[float, float]:
        """The times of the first and of the last period, in s on the machine's clock; both are 0 without a period."""
        for place in reversed(self._chunks):
            for exact, _ in reversed(list(self._pairs(place))):
                last = block_of(self.layout, exact, None).frames["time"][-1]
                return next(self._heads()).time, float(last)
        return 0.0, 0.0

    @cached_property
    def gaps(self) -> list[LostFrames]:
        """The gaps: missing frames between the first and the last frame, and frames before and after these that the
        files record as lost. Only the first 10,000 gaps are listed; `gap_count` counts all."""
        return list(islice(self._gaps(), MAX_GAPS))

    def _gaps(self) -> Iterator[LostFrames]:
        yield from (LostFrames(*each) for each in self._scan.gaps(self._told_first))
        if self.lost_at_end:
            yield LostFrames(self._scan.stop or 0, self.lost_at_end)

    @cached_property
    def gap_count(self) -> int:
        """Number of all gaps."""
        return sum(1 for _ in self._gaps())

    @cached_property
    def lost(self) -> int:
        """Number of frames that are missing in all gaps."""
        return sum(gap.count for gap in self._gaps())

    @property
    def end(self) -> NumberedEvent | None:
        """The event of the end of the run, or None if the recording has none."""
        return self._scan.end

    @property
    def events_told(self) -> int:
        """Number of events in the recording, counted without keeping them in memory."""
        return self._scan.events

    @property
    def events_lost(self) -> int:
        """Number of events that were overwritten before they were recorded."""
        return self._scan.events_lost

    @property
    def _told_first(self) -> int | None:
        """Return the number of the first frame that the first file had when it was closed; None if unknown."""
        extent = _extent_of(self._files[0])
        return None if extent is None else extent.first

    @cached_property
    def lost_at_end(self) -> int:
        """Number of frames that are missing at the end of the last file, although the file had them when it was
        closed."""
        extent, stop = _extent_of(self._files[-1]), self._scan.stop
        return 0 if extent is None else max(extent.stop - (extent.first if stop is None else stop), 0)

    @cached_property
    def damaged_end(self) -> str:
        """The reason why the end of the recording may be missing, as text; empty if nothing indicates that."""
        if self.lost_at_end:
            return f"{self.lost_at_end} frames at its end are damaged"
        return self.damage[-1] if not self.ended and self.damage else ""

    @property
    def chunks(self) -> int:
        """Number of the recording's chunks. `chunk` returns each of them."""
        return len(self._chunks)

    def chunk(self, number: int) -> list[Block]:
        """Return the blocks of the chunk with this number, from 0; empty if the chunk is damaged."""
        return [block_of(self.layout, exact, columns) for exact, columns in self._pairs(self._chunks[number])]

    # Inside --------------------------------------------------------------------------------------------

    @cached_property
    def _scan(self) -> RecordingScan:
        scan = RecordingScan()
        for place, head in self._placed_heads():
            with _told_as_damaged(place.file):
                scan.add(head, place.file.path)
        return scan

    def _heads(self) -> Iterator[BlockHead]:
        """Yield the heads of all blocks, without their columns."""
        return (head for _, head in self._placed_heads())

    def _placed_heads(self) -> Iterator[tuple[_Place, BlockHead]]:
        stop: int | None = None
        for place in self._chunks:
            for exact, _ in self._pairs(place):
                with _told_as_damaged(place.file):
                    about, rest = headed(exact)
                    head = BlockHead.of(about, len(exact) - len(rest))
                if stop is not None and head.first < stop:
                    place.file.damaged.add(place.at, REPEATED)
                    continue
                stop = head.first + head.periods
                yield place, head

    def _pairs(self, place: _Place) -> Iterator[tuple[memoryview, memoryview | None]]:
        """Yield the two messages of each block of a chunk; nothing if the chunk is damaged."""
        try:
            found = place.file.messages(place.at, (EXACT, COLUMNS))
        except ValueError as error:
            place.file.damaged.add(place.at, damaged(error))
            return
        rest = {message.sequence: message.data for message in found if message.channel == COLUMNS}
        for message in found:
            if message.channel == EXACT:
                yield message.data, rest.get(message.sequence)

    def _before(self, start: float | None) -> int:
        """Return the number of the last chunk that begins before a time."""
        if start is None:
            return 0
        return max(bisect_left(range(len(self._chunks)), start, key=self._time) - 1, 0)

    def _time(self, number: int) -> float:
        """Return the time at which a chunk begins. For a damaged chunk, return the time at which the next undamaged
        chunk begins."""
        for place in self._chunks.starting(number):
            for exact, _ in self._pairs(place):
                return float(headed(exact)[0]["time"])
        return float("inf")

    def close(self) -> None:
        for file in self._files:
            file.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@contextmanager
def _told_as_damaged(file: McapReader) -> Iterator[None]:
    """Return a context that raises FramesError if the description of a block is malformed."""
    try:
        yield
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError) as error:
        raise FramesError(f"{file.path}: a block is damaged: {text_of(error)}") from None


def _extent_of(file: McapReader) -> Extent | None:
    """Return the periods that a file declares."""
    return Extent.read(file.metadata.get(EXTENT, {}))


def _is_table(found: object) -> bool:
    return isinstance(found, Mapping)


def _described(file: McapReader) -> tuple[dict[str, str], Layout]:
    """Return the metadata of a file, and the layout of its frames."""
    about = file.metadata.get(METADATA)
    if about is None:
        damaged = "".join(f": at byte {each.at:,} {each.why}" for each in islice(file.damaged, 1))
        raise FramesError(f"{file.path} is not a recording of umo, or its description is damaged{damaged}")
    if (version := about.get("version")) not in (FORMAT, OLD_FORMAT):
        raise FramesError(
            f"{file.path} has version {version}, but this umo reads only versions {OLD_FORMAT} and {FORMAT}"
        )
    if version == FORMAT and about.get("checksum") != _checksum(about):
        raise FramesError(f"{file.path} is damaged: the checksum of its description is wrong")
    try:
        int(about.get("part", "1"))
        layout = Layout.parse(checked_text(about["description"].encode()))
        initial = layout.about.get("initial", {})
        bytes.fromhex(initial.get("entries", ""))
        if not all(_is_table(each) for each in (initial, initial.get("kept", {}), initial.get("alarms", {}))):
            raise ValueError("its first sample is malformed")
    except KeyError as error:
        raise FramesError(f"{file.path} is damaged: it lacks {error}") from None
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise FramesError(f"{file.path} is damaged: {text_of(error)}") from None
    return about, layout


def _checksum(texts: Mapping[str, str]) -> str:
    """Return the CRC-32 of the metadata of a file, in hexadecimal digits."""
    told = "\0".join(f"{name}\0{texts[name]}" for name in sorted(texts) if name != "checksum")
    return f"{zlib.crc32(told.encode()):08x}"


def as_first(texts: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata of a file that begins a new recording."""
    changed = dict(texts) | {"part": "1"}
    return changed | ({"checksum": _checksum(changed)} if "checksum" in changed else {})


def describe(layout: Layout, part: int = 1) -> dict[str, str]:
    """Return the metadata that describe a file."""
    about = layout.about
    run = json.dumps([about.get("station"), about.get("pid"), about.get("started_monotonic")])
    texts = {"version": FORMAT, "run": run, "part": str(part), "description": layout.describe().decode()}
    return texts | {"checksum": _checksum(texts)}
