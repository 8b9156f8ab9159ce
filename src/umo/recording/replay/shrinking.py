"""Shrinks a recording: it finds the fewest periods that still give the same error, or the same first difference.

The inputs of the left-out periods are missing, so the remaining replay is in open loop. It proves that the error
follows from these inputs, not that a machine would produce these inputs. Up to a first difference the remaining periods
equal the recorded ones bit by bit, so that both programs would reach that difference.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from umo.cycle.events import Event
from umo.errors import text_of
from umo.process.frames.layout import SHRUNK, Layout
from umo.recording.replay.code_given import NOTHING_GIVEN, CodeGiven
from umo.recording.replay.program import Program
from umo.recording.replay.replaying import Replay
from umo.recording.replay.result import Difference, Replayed
from umo.recording.replay.tape import OPEN_LOOP, NotReplayable, Tape, TapeCommand, events_of
from umo.text import place_of

PeriodNumbers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class ShrunkCommand:
    """A command of a client, with its new number."""

    number: int
    period: int
    data: bytes


@dataclass
class ShrunkBlock:
    """The remaining periods."""

    frames: Any
    entries: Any
    commands: list[ShrunkCommand] = field(default_factory=list)
    lost: int = 0
    entries_lost: int = 0
    commands_lost: int = 0
    events_lost: int = 0


@dataclass
class ShrunkTape:
    """A recording of which only some periods remain. Its time continues without gaps."""

    layout: Layout
    job: Mapping[str, Any]
    events: list[Event]
    block: ShrunkBlock

    def blocks(self) -> Iterator[ShrunkBlock]:
        return iter([self.block])


class WholeRecording:
    """A whole recording in memory, from which periods are chosen."""

    def __init__(self, tape: Tape) -> None:
        """Read a recording. Raises NotReplayable if parts of it are lost."""
        blocks = list(tape.blocks())
        if any(block.lost or block.entries_lost or block.commands_lost or block.events_lost for block in blocks):
            raise NotReplayable("parts of the recording are lost: it cannot be shrunk")
        self.layout, self.job = tape.layout, tape.job
        self.damaged_end = str(getattr(tape, "damaged_end", ""))
        """The reason why the end of the recording may be missing, as text; empty if nothing indicates that."""
        self.compared = True
        """True if the commands of the chosen periods are compared in the replay, and not only the error."""
        self._frames = np.concatenate([block.frames for block in blocks])
        self._entries = np.concatenate([block.entries for block in blocks])
        self._ends = np.cumsum(self._frames["entries"])
        self._commands = {command.number: command for block in blocks for command in block.commands}
        self._events = events_of(tape)

    @property
    def count(self) -> int:
        """Number of periods."""
        return len(self._frames)

    def chosen(self, places: PeriodNumbers) -> ShrunkTape:
        """Return the recording with only these periods, in order."""
        frames = self._frames[places]
        ticks = np.maximum(frames["missed"], 1)
        times = frames["time"].tolist()
        frames["number"] = np.cumsum(ticks)
        if period := float(self.layout.about.get("period") or 0.0):
            frames["time"] = frames["number"] * period
        new_times = dict(zip(times, frames["time"].tolist(), strict=True))
        frames["sequence"] = 2 * np.arange(len(frames)) + 2
        commands, numbers = self._renumber(frames, places)
        counts = frames["entries"].tolist()
        ends = self._ends[places].tolist()
        parts = [self._entries[end - count : end] for end, count in zip(ends, counts, strict=True) if count]
        entries = np.concatenate([self._entries[:0], *parts])
        frames["journal"] = np.cumsum(frames["entries"]) - frames["entries"]
        events = [
            event._replace(time=new_times.get(event.time, event.time), command=numbers.get(event.command, 0))
            for event in self._events
            if event.is_end or (event.time in new_times and (not event.command or event.command in numbers))
        ]
        about = self.layout.about | {SHRUNK: self.layout.about.get(SHRUNK, self.count)}
        about |= {} if self.compared else {OPEN_LOOP: True}
        layout = dataclasses.replace(self.layout, about=about)
        return ShrunkTape(layout, self.job, events, ShrunkBlock(frames, entries, commands))

    def _renumber(self, frames: Any, places: PeriodNumbers) -> tuple[list[ShrunkCommand], dict[int, int]]:
        """Number the commands of these periods anew, from 1. Return them, and a dict from the old number of each to its
        new one."""
        taken = self._frames["taken"]
        commands: list[ShrunkCommand] = []
        numbers: dict[int, int] = {}
        if not self._commands and not taken[-1:].any():
            return commands, numbers
        before = np.concatenate([[0], taken[:-1]])[places].tolist()
        for place, (first, last) in enumerate(zip(before, taken[places].tolist(), strict=True)):
            for old in range(first + 1, last + 1):
                number = numbers[old] = len(numbers) + 1
                command: TapeCommand | None = self._commands.get(old)
                commands.append(ShrunkCommand(number, place, b"" if command is None else command.data))
            frames["taken"][place] = len(numbers)
        return commands, numbers


@dataclass(frozen=True)
class ReplayedError:
    """The error that ended a run: its class, and the line of the user's code."""

    kind: str
    place: str
    text: str

    @classmethod
    def of(cls, error: BaseException) -> ReplayedError:
        return cls(type(error).__name__, place_of(error) or "", text_of(error))

    def is_same(self, other: ReplayedError | None) -> bool:
        """True for the same error at the same line. Numbers in the text may differ."""
        return other is not None and (self.kind, self.place) == (other.kind, other.place)


@dataclass(frozen=True)
class ReplayedDifference:
    """A first difference, by its object and both values."""

    path: str
    recorded: str
    replayed: str

    @classmethod
    def of(cls, difference: Difference) -> ReplayedDifference:
        return cls(difference.path, difference.recorded, difference.replayed)

    @property
    def text(self) -> str:
        return f"{self.path}: recorded {self.recorded}, replayed {self.replayed}".removeprefix(": ")


class Shrinking:
    """The search for the fewest periods. `go_on` is called before each replay. The search ends when `go_on` returns
    False."""

    def __init__(
        self, tape: Tape, given: CodeGiven = NOTHING_GIVEN, program: Callable[[Tape], Program] | None = None
    ) -> None:
        """Raise NotReplayable if the replay of the recording has neither a difference nor an error."""
        self.source = WholeRecording(tape)
        self._program = program or (lambda each: Program.of(each, given))
        self.replays = 0
        self.places: PeriodNumbers = np.arange(self.source.count)
        """The remaining periods."""
        self.ending: ReplayedError | ReplayedDifference
        """The error or difference that the remaining periods give."""
        result = self._replayed(self.places)
        self.code = result.code
        """A remark if the code differs from that of the recorded run."""
        difference = result.difference
        if difference is not None and result.error is None and result.periods <= self.source.count:
            self.places, self.ending = self.places[: difference.period + 1], ReplayedDifference.of(difference)
        elif result.error is not None:
            self.source.compared = False
            self.ending = ReplayedError.of(result.error)
        else:
            as_far = f"as far as the recording goes ({lost}), " if (lost := self.source.damaged_end) else ""
            raise NotReplayable(
                f"the replay of this recording is identical {as_far}and ends without an error: nothing to shrink to"
            )

    def run(self, go_on: Callable[[], bool] = lambda: True) -> ShrunkTape:
        """Leave out periods as long as the error or difference remains."""
        size = max(len(self.places) // 2, 1)
        while go_on():
            before = len(self.places)
            self._pass(size, go_on)
            if size == 1 and len(self.places) == before:
                break
            size = max(size // 2, 1) if len(self.places) == before else max(min(size, len(self.places) // 2), 1)
        return self.source.chosen(self.places)

    def _pass(self, size: int, go_on: Callable[[], bool]) -> None:
        """Try to leave out each piece of `size` periods, beginning with the last piece, which ends with the error."""
        at = len(self.places)
        while at > 0 and go_on():
            start = max(at - size, 0)
            rest = np.concatenate([self.places[:start], self.places[at:]])
            if len(rest) and self._is_same(rest):
                self.places = rest
            at = start

    def _is_same(self, places: PeriodNumbers) -> bool:
        result, ending = self._replayed(places), self.ending
        if isinstance(ending, ReplayedError):
            return result.error is not None and ending.is_same(ReplayedError.of(result.error))
        found = result.difference
        return found is not None and found.period == len(places) - 1 and ReplayedDifference.of(found) == ending

    def _replayed(self, places: PeriodNumbers) -> Replayed:
        """Replay only these periods, and return the result."""
        self.replays += 1
        tape = self.source.chosen(places)
        return Replay(tape, self._program(tape)).run()


def periods_left(places: Sequence[int]) -> str:
    """Return the remaining periods as text, such as `3 to 17, 40`."""
    runs: list[list[int]] = []
    for place in places:
        if runs and place == runs[-1][1] + 1:
            runs[-1][1] = place
        else:
            runs.append([place, place])
    shown = [f"{first}" if first == last else f"{first} to {last}" for first, last in runs[:8]]
    return ", ".join(shown) + (f" and {len(runs) - 8} more pieces" if len(runs) > 8 else "")
