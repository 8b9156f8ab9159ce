"""`umo recording shrink --closed`: the fewest faults, options and commands; tests that `umo recording shrink -o
FILE.py` writes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from helpers.recorded import block_at_random, layout_of
from helpers.tapes import MemoryTape, recorded, save
from umo.recording.block import TakenCommand
from umo.recording.replay.closed_loop import ClosedShrinking, Trial, recorded_trial
from umo.recording.replay.code_given import CodeGiven
from umo.recording.replay.tape import NotReplayable
from umo.text import shown_path

Umo = Callable[..., Result]
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="each trial is a fork"),
]
OBJECTS = """
from typing import Annotated
from umo import Compound, DigitalActuator, DigitalSensor, Number
class Oven(Compound):
    heater: DigitalActuator
    door: DigitalSensor
    timer: DigitalSensor
    gain: Annotated[float, Number("", 0.0, 2.0, tunable=True)] = 0.1
def machine(size: float = 1.0):
    return Oven(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
        door=DigitalSensor("mm", minimum=0.0, maximum=100.0, resolution=1.0),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo.control import next_period
async def main(m, level: int = 3, other: int = 1):
    for number in range(60):
        await next_period()
        if m.gain > 1.0 and level > 7:
            raise ValueError(f"too high in {number}")
        if m.door.read() > 50.0 and number > 30:
            raise LookupError("the door is open")
"""
KEY = {"who": "ann", "key": "k"}
COMMANDS: list[tuple[int, dict[str, Any]]] = [
    (2, KEY | {"do": "lease"}),
    (4, KEY | {"do": "tune", "path": "gain", "value": 0.5}),
    (6, KEY | {"do": "nonsense"}),
    (8, KEY | {"do": "tune", "path": "gain", "value": 1.5}),
    (9, KEY | {"do": "give back"}),
]


@pytest.fixture
def oven(tmp_path: Path) -> Path:
    station = tmp_path / "oven"
    station.mkdir()
    (station / "objects.py").write_text(OBJECTS)
    (station / "application.py").write_text(APPLICATION)
    return station


@pytest.mark.full
def test_the_fewest_options_and_commands_are_left(oven: Path) -> None:
    options = {"other": 2, "level": 9, "size": 4.0}
    shrinking = ClosedShrinking(Trial(str(oven), options=options, commands=COMMANDS))
    assert (shrinking.ending.kind, shrinking.ending.text[:24]) == ("ValueError", "ValueError: too high in ")
    trial = shrinking.run()
    assert trial.options == {"level": 9}
    assert list(trial.commands) == [COMMANDS[0], COMMANDS[3]]
    assert trial.ending() is not None and replace(trial, options={}).ending() is None


def test_the_fewest_faults_of_a_recording_are_left(oven: Path) -> None:
    faults = ["door drift 500 mm/s at 1 ms", "door stuck at 20 ms", "heater noise 0.5 V"]
    (oven / "application.py").write_text(STUCK)
    tape = recorded(str(oven), fault=faults, level=2)
    shrinking = ClosedShrinking(recorded_trial(tape, CodeGiven(str(oven))))
    trial = shrinking.run()
    assert trial.faults == ["door drift 500 mm/s at 0.001 s"] and not trial.options and trial.fixed["until"] > 1.0


def test_what_ends_without_an_error_or_has_devices_is_refused_in_a_line(oven: Path) -> None:
    with pytest.raises(NotReplayable, match="ends without an error"):
        ClosedShrinking(Trial(str(oven)))
    with pytest.raises(NotReplayable, match="levl"):
        ClosedShrinking(Trial(str(oven), options={"levl": 3}))
    modbus = {"drivers": {"io": {"type": "modbus", "host": "127.0.0.1"}},
              "wire": {"heater": {"driver": "io", "channel": "holding:0"}, "door": {"driver": "simulated"},
                       "timer": {"driver": "timerfd", "period": "1 ms"}}}  # fmt: skip
    with pytest.raises(NotReplayable, match="has devices"):
        ClosedShrinking(Trial(str(oven), wiring=modbus))


STUCK = """from umo.control import next_period
async def main(m, level: int = 3):
    for number in range(60):
        await next_period()
    if m.door.raw != 0:
        raise LookupError("the door is open")
"""


@pytest.mark.full
def test_the_tests_that_are_written_fail_until_the_code_is_repaired(umo: Umo, oven: Path, tmp_path: Path) -> None:
    application = oven / "application.py"
    application.write_text("from umo.control import next_period\n" + FAILING)
    file = save(recorded(str(oven), level=5), tmp_path / "run.mcap")
    opened, closed = tmp_path / "test_open.py", tmp_path / "test_closed.py"
    done = umo("recording", "shrink", str(file), str(oven), "-o", str(opened), "--for", "60")
    assert done.exit_code == 0 and "53 periods, 53 left" in done.stdout, done.output
    assert umo("recording", "shrink", str(file), str(oven), "-o", str(opened)).exit_code == 2
    done = umo("recording", "shrink", str(file), str(oven), "--closed", "-o", str(closed))
    assert done.exit_code == 0 and f"umo run {shown_path(str(oven))} --level 5" in done.stdout, done.output
    for repaired in (False, True):
        if repaired:
            application.write_text(application.read_text().replace("level > 4", "level > 400"))
        for test in (opened, closed):
            assert passes(test) == repaired, test.read_text()


FAILING = """async def main(m, level: int = 3):
    for number in range(60):
        await next_period()
        if level > 4 and number > 50:
            raise ValueError("too high")
"""


def passes(test: Path) -> bool:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(test.parent), str(test)]
    environ = os.environ | {"PYTHONPATH": os.pathsep.join(str(Path(each).resolve()) for each in filter(None, sys.path))}
    return subprocess.run(command, cwd=test.parent, env=environ, capture_output=True, check=False).returncode == 0


def test_a_wrong_file_is_told(umo: Umo, tmp_path: Path) -> None:
    for words in (["-o", "x.txt"], ["--closed", "-o", "x.mcap"]):
        done = umo("recording", "shrink", str(tmp_path / "none.mcap"), *words)
        assert done.exit_code == 2 and "write a test (.py)" in done.stderr


def test_commands_after_lost_periods_come_at_their_ticks() -> None:
    blocks = []
    for first, lost in ((0, 0), (20, 10)):
        block = block_at_random(layout_of(), first, 10, first)
        commands = [TakenCommand(first + 1, first + 4, b'{"do": "stop"}'), TakenCommand(first + 2, -1, b'{"do": "x"}')]
        blocks.append(replace(block, commands=commands, lost=lost))
    tape = MemoryTape(layout_of(), {"station": "conveyor"})
    tape.recorded = blocks
    assert [tick for tick, _ in recorded_trial(tape).commands] == [5, 1, 25, 21]


@pytest.mark.parametrize("levels", [60, 900, 100_000])
def test_a_command_that_is_nested_too_deeply_is_refused_with_its_period(levels: int) -> None:
    block = block_at_random(layout_of(), 0, 10, 0)
    nested = b'{"do": "tune", "value": ' + b"[" * levels + b"]" * levels + b"}"
    tape = MemoryTape(layout_of(), {"station": "conveyor"})
    tape.recorded = [replace(block, commands=[TakenCommand(1, 4, nested)])]
    with pytest.raises(NotReplayable, match="the command of period 5 has more than 50 levels"):
        recorded_trial(tape)
