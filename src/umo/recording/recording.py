"""A recording: what a run was, its frames bit by bit, its events and the commands of its clients."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from umo.errors import FramesError, text_of
from umo.frames.layout import Layout
from umo.frames.reader import Frames, NumberedEvent
from umo.recording.block import BlackBox, Block, TakenCommand, block_of, boxes_of, events_of, headed
from umo.recording.mcap_reader import McapReader
from umo.recording.part_names import later_parts
from umo.text import in_brackets

FORMAT = "1"
"""Version of the messages of umo in a file."""
METADATA = "umo"
"""Name of the metadata that say what a file is."""
EXACT_TOPIC, COLUMNS_TOPIC = "umo/exact", "umo/columns"
EVENTS_TOPIC, ALARMS_TOPIC, COMMANDS_TOPIC, BOXES_TOPIC = "events", "alarms", "commands", "black_boxes"
SPARSE_TOPICS = frozenset({EXACT_TOPIC, EVENTS_TOPIC, ALARMS_TOPIC, COMMANDS_TOPIC, BOXES_TOPIC})
"""What is kept from period 0 on, also where the rest of old files is not."""
MALFORMED = "its description is malformed"
"""Why a file does not say what was run."""


@dataclass(frozen=True)
class LostFrames:
    """Frames that are missing."""

    first: int
    """Number of the first one, from 0."""
    count: int


class _Place(NamedTuple):
    """Where a chunk lies."""

    file: McapReader
    at: int


class Recording:
    """A file that `umo run --record` has written, with its later parts where it was rotated. It can be read while it
    is written: it has then what was there when it was opened. FramesError if it is no recording.

        with Recording("run.mcap") as recording:
            for block in recording.blocks():
                print(block.frames["time"], block.frames["values"])
    """

    def __init__(self, path: Path | str, *, later: bool = True) -> None:
        """`later`: with the files that follow this one by rotation."""
        self.path = Path(path)
        self._files = [McapReader(self.path)]
        try:
            self.about_file, self.layout = _described(self._files[0])
            for part in later_parts(self.path, int(self.about_file.get("part", 1))) if later else ():
                self._add(part)
        except BaseException:
            self.close()
            raise
        self._chunks = [_Place(file, at) for file in self._files for at in file.chunks]

    def _add(self, path: Path) -> None:
        """Add a later part, if it is of the same run. One that was cut in its first write has nothing."""
        try:
            file = McapReader(path)
        except FramesError:
            return
        try:
            about, _ = _described(file)
        except FramesError:
            about = {}
        if about.get("run") == self.about_file["run"]:
            self._files.append(file)
        else:
            file.close()

    # What it is ----------------------------------------------------------------------------------------

    @property
    def about(self) -> dict[str, Any]:
        """The facts about the run: station, wiring, pid, when it started, the period in s."""
        return self.layout.about

    @property
    def job(self) -> dict[str, Any]:
        """What was run: station, wiring with its text, options, versions (`umo.process.job_facts`). Where that is
        malformed, or there was an error, only `error`."""
        job: Any = self.about.get("job", {})
        if _is_table(job) and all(_is_table(job.get(name, {})) for name in ("options", "wiring", "versions")):
            given = job.get("options", {}).get("given", {})
            return dict(job) if _is_table(given) else {"error": MALFORMED}
        return {"error": MALFORMED}

    @property
    def is_whole(self) -> bool:
        """Whether every file ends as it should; `umo record --repair` helps one that was cut or torn."""
        return all(file.is_whole for file in self._files)

    @cached_property
    def complete(self) -> bool:
        """Whether it has all frames, entries and commands from its first frame on, up to the end of the run."""
        exact = all(not block.entries_lost and not block.commands_lost for block in self._all_heads)
        return self.is_whole and exact and not self.gaps and self.ended

    @cached_property
    def ended(self) -> bool:
        """Whether the end of the run is in it."""
        return any(event.is_end for _, event in self.events)

    @cached_property
    def first(self) -> int:
        """Number of the first frame, from 0."""
        return next((head.first for head in self._heads()), 0)

    @cached_property
    def replayable_from(self) -> str | None:
        """None: it can be replayed from period 0 on; else why it cannot."""
        head = next(self._heads(), None)
        if head is None:
            return "it has no periods"
        if not self.job or "error" in self.job:
            return "it does not say what was run" + in_brackets(str(self.job.get("error", "")))
        if head.first:
            when = f"{head.time:g} s"
            return f"it begins at period {head.first} ({when}): sequences exist only by running from period 0"
        return None

    # What is in it -------------------------------------------------------------------------------------

    def blocks(self, start: float | None = None, stop: float | None = None, *, full: bool = True) -> Iterator[Block]:
        """The blocks in order, each of one second of the run at most; those with frames from `start` to before `stop`,
        s on the cycle's clock. `full`: with the columns that replay does not need. A damaged chunk is passed over: its
        frames are lost for the block that follows."""
        expected: int | None = None
        for place in self._chunks[self._before(start) :]:
            for exact, columns in self._pairs(place):
                block = block_of(self.layout, exact, columns if full else None)
                if expected is not None and block.first > expected + block.lost:
                    block = replace(block, lost=block.first - expected)
                expected = block.stop
                times = block.frames["time"]
                if stop is not None and times[0] >= stop:
                    return
                if start is None or times[-1] >= start:
                    yield block

    def frames(self, start: float | None = None, stop: float | None = None) -> Frames:
        """The frames of which the time is from `start` to before `stop`, s on the cycle's clock."""
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
        return [event for head in self._all_heads for event in head.events]

    @cached_property
    def black_boxes(self) -> list[BlackBox]:
        """Where periods were missed and why, one in 10 s at most, and how a run ended that has failed; in order."""
        return [box for head in self._all_heads for box in head.boxes]

    @cached_property
    def commands(self) -> list[TakenCommand]:
        """The commands that the machine has taken, in order."""
        return [command for block in self.blocks(full=False) for command in block.commands]

    @property
    def parts(self) -> list[Path]:
        """Its files, in order."""
        return [file.path for file in self._files]

    @property
    def commands_taken(self) -> int:
        """Number of its commands: counted without reading them."""
        return sum(head.commands for head in self._all_heads)

    @cached_property
    def block_starts(self) -> list[tuple[float, int]]:
        """Of each block its time in s on the machine's clock, and how many frames it has."""
        return [(head.time, head.count) for head in self._all_heads]

    @property
    def periods(self) -> int:
        """Number of its periods: counted without reading them."""
        return sum(head.count for head in self._all_heads)

    @cached_property
    def span(self) -> tuple[float, float]:
        """The times of the first and of the last period, s on the machine's clock; twice 0 without a period."""
        for place in reversed(self._chunks):
            for exact, _ in reversed(list(self._pairs(place))):
                last = block_of(self.layout, exact, None).frames["time"][-1]
                return next(self._heads()).time, float(last)
        return 0.0, 0.0

    @cached_property
    def gaps(self) -> list[LostFrames]:
        """The frames that are missing between the first and the last one."""
        gaps, expected = [], None
        for head in self._all_heads:
            if expected is not None and head.first > expected:
                gaps.append(LostFrames(expected, head.first - expected))
            expected = head.first + head.count
        return gaps

    @property
    def chunks(self) -> int:
        """Number of its chunks, for `chunk`."""
        return len(self._chunks)

    def chunk(self, number: int) -> list[Block]:
        """The blocks of a chunk, by its number from 0; none if it is damaged."""
        return [block_of(self.layout, exact, columns) for exact, columns in self._pairs(self._chunks[number])]

    # Inside --------------------------------------------------------------------------------------------

    @cached_property
    def _all_heads(self) -> list[_Head]:
        return list(self._heads())

    def _heads(self) -> Iterator[_Head]:
        """What each block says of itself, without its columns."""
        for place in self._chunks:
            for exact, _ in self._pairs(place):
                yield _head(headed(exact)[0])

    def _pairs(self, place: _Place) -> Iterator[tuple[memoryview, memoryview | None]]:
        """The two messages of each block of a chunk; none if it is damaged."""
        exact, columns = place.file.topic(EXACT_TOPIC), place.file.topic(COLUMNS_TOPIC)
        try:
            found = list(place.file.messages(place.at))
        except ValueError:
            return
        rest = {message.sequence: message.data for message in found if columns and message.channel == columns}
        for message in found:
            if message.channel == exact:
                yield message.data, rest.get(message.sequence)

    def _before(self, start: float | None) -> int:
        """The number of the last chunk that begins before a time."""
        if start is None:
            return 0
        return max(bisect_left(range(len(self._chunks)), start, key=self._time) - 1, 0)

    def _time(self, number: int) -> float:
        """The time at which a chunk begins; of a damaged one that of the next."""
        for place in self._chunks[number:]:
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


@dataclass(frozen=True)
class _Head:
    first: int
    count: int
    time: float
    entries_lost: int
    commands_lost: int
    events: list[NumberedEvent]
    commands: int
    """How many there are."""
    boxes: list[BlackBox]


def _head(about: Mapping[str, Any]) -> _Head:
    return _Head(
        about["first"], about["count"], about["time"], about["entries_lost"], about["commands_lost"], events_of(about),
        len(about["commands"]), boxes_of(about),
    )  # fmt: skip


def _is_table(found: object) -> bool:
    return isinstance(found, Mapping)


def _described(file: McapReader) -> tuple[dict[str, str], Layout]:
    """What the file says of itself, and the layout of its frames."""
    about = file.metadata.get(METADATA)
    if about is None:
        raise FramesError(f"{file.path} is not a recording of umo")
    if about.get("version") != FORMAT:
        raise FramesError(f"{file.path} is of version {about.get('version')}, this umo reads version {FORMAT}")
    try:
        layout = Layout.parse(about["description"].encode())
        initial = layout.about.get("initial", {})
        bytes.fromhex(initial.get("entries", ""))
        if not all(_is_table(each) for each in (initial, initial.get("kept", {}), initial.get("alarms", {}))):
            raise ValueError("its first sample is malformed")
    except KeyError as error:
        raise FramesError(f"{file.path} is damaged: it lacks {error}") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise FramesError(f"{file.path} is damaged: {text_of(error)}") from None
    return about, layout


def describe(layout: Layout, part: int = 1) -> dict[str, str]:
    """The metadata of a file."""
    about = layout.about
    run = json.dumps([about.get("station"), about.get("pid"), about.get("started_monotonic")])
    return {"version": FORMAT, "run": run, "part": str(part), "description": layout.describe().decode()}
