"""`umo recording shrink`: fewer periods, the same error, said to be open loop."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from helpers.machines import Bench, bench, wired
from helpers.tapes import Case, MemoryTape, recorded, save
from umo import drive
from umo.recording.block import TakenCommand
from umo.recording.replay.replaying import replay
from umo.recording.replay.shrinking import ReplayedDifference, Shrinking, periods_left
from umo.recording.replay.tape import OPEN_LOOP, NotReplayable
from umo.testing import Scripted

Umo = Callable[..., Result]


class Fragile(Bench):
    """Fails when the encoder was above 50 in three periods, and below 5 afterwards."""

    def setup(self) -> None:
        self.high = 0

    def control(self) -> None:
        value = self.encoder.read()
        self.high += value > 50.0
        if self.high >= 3 and value < 5.0:
            raise RuntimeError(f"broken at {self.now:g} s")


READINGS = [(n * 37) % 180 + 20 for n in range(300)] + [3]


def fragile() -> Case:
    return Case(lambda: bench(Fragile), lambda m: wired(m, Scripted({"encoder": READINGS})), drive)


def shrinking(tape: Any, case: Case) -> Shrinking:
    return Shrinking(tape, program=lambda each: case.program())


def test_only_the_periods_that_matter_are_left() -> None:
    case = fragile()
    tape = case.record()
    assert len(tape.frames) == 300
    found = shrinking(tape, case)
    short = found.run()
    assert len(short.block.frames) == len(found.places) == 4
    assert short.block.frames["number"].tolist() == [1, 2, 3, 4]
    assert "broken at 0.3" in found.ending.text


def test_of_a_difference_the_periods_before_it_are_still_the_recorded_ones() -> None:
    """`Latch` remembers the highest reading; the other program forgets what is above 60."""
    case, other = latch(Latch), latch(Forgetful)
    tape = case.record()
    found = Shrinking(tape, program=lambda each: other.program())
    assert isinstance(found.ending, ReplayedDifference) and found.ending.path == "motor"
    short = found.run()
    assert len(short.block.frames) == len(found.places) <= 3
    assert OPEN_LOOP not in short.layout.about
    again = replay(short, other.program())
    assert again.difference is not None and ReplayedDifference.of(again.difference) == found.ending
    assert replay(short, case.program()).identical


class Latch(Bench):
    def setup(self) -> None:
        self.highest = 0.0

    def control(self) -> None:
        self.highest = max(self.highest, self.kept(self.encoder.read()))
        self.motor.write(self.highest / 20.0)

    def kept(self, value: float) -> float:
        return value


class Forgetful(Latch):
    def kept(self, value: float) -> float:
        return min(value, 60.0)


def latch(kind: type[Latch]) -> Case:
    return Case(
        lambda: bench(kind),
        lambda m: wired(m, Scripted({"encoder": READINGS})),
        lambda m: [step(m) for _ in range(300)],
    )


def test_a_recording_without_an_error_has_nothing_to_shrink_to() -> None:
    case = Case(lambda: bench(), lambda m: wired(m, Scripted()), lambda m: [step(m) for _ in range(20)])
    with pytest.raises(NotReplayable, match="is identical and ends without"):
        shrinking(case.record(), case)


def step(m: Any) -> None:
    m.timer.read()
    m.sample()
    m.control()
    m.update()


def test_commands_stay_with_their_periods_and_are_counted_anew() -> None:
    tape = fragile().record()
    (block,) = tape.recorded
    block.frames["taken"][100:] = 2
    block.frames["taken"][200:] = 3
    block.commands.extend(TakenCommand(n, 0, json.dumps({"do": str(n)}).encode()) for n in (1, 2, 3))
    source = shrinking(tape, fragile()).source
    short = source.chosen([5, 200, 299])  # type: ignore[arg-type]
    assert [(each.number, each.data) for each in short.block.commands] == [(1, b'{"do": "3"}')]
    assert short.block.frames["taken"].tolist() == [0, 1, 1]
    assert len(source.chosen([100, 200]).block.commands) == 3  # type: ignore[arg-type]


def test_the_periods_in_words() -> None:
    assert periods_left([3, 4, 5, 9, 11, 12]) == "3 to 5, 9, 11 to 12"
    assert periods_left(range(0, 40, 2)) == "0, 2, 4, 6, 8, 10, 12, 14 and 12 more pieces"


def failing_conveyor() -> MemoryTape:
    tape = recorded("conveyor", fault=["sorter.entry wrong length at 2.2 s"], patience=1.0)
    assert tape.events[-1].is_end
    return tape


def test_a_shrunk_recording_gives_the_same_error_and_says_that_it_is_open_loop(umo: Umo, tmp_path: Path) -> None:
    file = save(failing_conveyor(), tmp_path / "run.mcap")
    short = tmp_path / "run.shrunk.mcap"
    for seconds in ("1", "20"):  # more time, where a busy computer came to nothing
        short.unlink(missing_ok=True)
        result = umo("recording", "shrink", str(file), "--for", seconds)
        assert result.exit_code == 0, result.output
        assert "in open loop they give the same error" in result.stdout
        if is_smaller := short.stat().st_size < file.stat().st_size:
            break
    assert is_smaller
    again = umo("recording", "replay", str(short))
    assert again.exit_code == 0 and "in open loop, of which only the error is compared" in again.stdout, again.output
    told = {
        name: " ".join(text) for name, *text in map(str.split, umo("recording", "info", str(short)).stdout.splitlines())
    }
    assert re.fullmatch(r"by umo recording shrink from [\d,]+ periods, for a replay in open loop; .*", told["shrunk"])
    assert "shrunk" not in umo("recording", "info", str(file)).stdout.split()
    assert umo("recording", "shrink", str(file)).exit_code == 2


def test_other_runs_of_this_process_are_warned_after_it(umo: Umo, tmp_path: Path) -> None:
    assert umo("recording", "shrink", str(tmp_path / "none.mcap")).exit_code == 2
    assert logging.getLogger("umo").isEnabledFor(logging.WARNING)


def test_a_folder_that_there_is_not_is_told_before_the_search(umo: Umo, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"")
    result = umo("recording", "shrink", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "none" / "short.mcap"))
    assert result.exit_code == 2 and "there is no folder" in result.stderr.replace("\n", " ")
