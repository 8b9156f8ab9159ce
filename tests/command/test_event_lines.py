"""The lines that `umo run` prints when an alarm or the mode changes, and the times of the lines of its log."""

from __future__ import annotations

import io
import logging
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import Result

from umo.cycle.events import ALARM, CommandState, Event, Events
from umo.operation.commands.client_commands import Mode
from umo.process.start import LINUX
from umo.system import streams
from umo_command.progress_line import RunProgressLine
from umo_command.run.event_lines import LINES_PER_SECOND, EventLines

STATION = """
from umo import Compound, DigitalActuator, DigitalSensor
from umo.control import wait
from umo.operation.alarms import Alarm, High, Priority


class Press(Compound, alarms={"hot": Alarm(High("heater", 5.0), "the press is hot", priority=Priority.HIGH)}):
    heater: DigitalActuator
    timer: DigitalSensor


def machine() -> Press:
    return Press(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.5),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )


async def main(m):
    for volts in (8.0, 0.0):
        m.heater.write(volts)
        await wait("100 ms")
"""


class Told:
    """The lines of events, on a clock that the test sets."""

    def __init__(self, mode: Mode = Mode.AUTOMATIC) -> None:
        self.now = 100.0
        self.lines: list[str] = []
        self.events = EventLines(lambda time, text: self.lines.append(f"{time:g} {text}"), mode, lambda: self.now)


def alarm(time: float, text: str, who: str = "") -> Event:
    return Event(time, "tank.full", text, who, asked=ALARM)


def mode(time: float, mode: Mode, state: CommandState = CommandState.DONE) -> Event:
    return Event(time, "", "", "ann", 7, state, f"mode {mode}")


@pytest.mark.parametrize("way", [(), ("--realtime",)][: 1 + LINUX])
def test_a_run_prints_when_an_alarm_begins_and_ends(
    umo: Callable[..., Result], tmp_path: Path, way: tuple[str, ...]
) -> None:
    (tmp_path / "press").mkdir()
    (tmp_path / "press" / "objects.py").write_text(STATION)
    (tmp_path / "press" / "application.py").write_text("from .objects import main")
    result = umo("run", "press", "--no-record", *way)
    assert result.exit_code == 0, result.output
    told = re.findall(r"^ +\d+\.\d{3} s  (alarm .*)$", result.stderr, re.MULTILINE)
    assert told == [f"alarm hot: {state} (high): the press is hot" for state in ("unacknowledged", "returned")]


def test_a_change_of_the_mode_is_printed_when_it_is_done_with_the_client() -> None:
    told = Told()
    told.events.add(mode(1.0, Mode.AUTOMATIC))  # as it is already
    told.events.add(mode(2.0, Mode.MANUAL))
    told.events.add(mode(3.0, Mode.AUTOMATIC, CommandState.REFUSED))
    told.events.add(mode(4.0, Mode.AUTOMATIC, CommandState.BEGUN))
    told.events.add(mode(5.0, Mode.AUTOMATIC))
    assert told.lines == ["2 mode manual (ann)", "5 mode automatic (ann)"]


def test_a_run_that_begins_in_manual_mode_prints_the_change_to_automatic_mode() -> None:
    told = Told(Mode.MANUAL)
    told.events.add(mode(1.0, Mode.AUTOMATIC))
    assert told.lines == ["1 mode automatic (ann)"]


def test_an_alarm_that_an_operator_has_hidden_is_not_printed_any_more() -> None:
    told = Told()
    told.events.add(alarm(1.0, "shelved (high): too full; for 10 min", "ann"))
    told.events.add(alarm(2.0, "shelved active (high): too full"))
    told.events.add(alarm(3.0, "unacknowledged (high): too full; the shelving time has ended"))
    assert [line[:1] for line in told.lines] == ["1", "3"]
    assert told.lines[0] == "1 alarm tank.full: shelved (high): too full; for 10 min (ann)"


def test_other_events_are_not_printed() -> None:
    told = Told()
    told.events.add(Event(1.0, "", "1", "ann", 1, CommandState.DONE, "lease"))
    told.events.add(Event(1.0, "mixer", "in fault: no feed", asked="fault"))  # the log has it
    assert told.lines == []


def test_of_a_flood_a_second_has_so_many_lines_and_the_number_of_the_others() -> None:
    told = Told()
    for number in range(LINES_PER_SECOND + 5):
        told.events.add(alarm(float(number), "unacknowledged (high): too full"))
    told.events.look()
    assert len(told.lines) == LINES_PER_SECOND
    told.now += 1.0
    told.events.look()
    assert told.lines[LINES_PER_SECOND:] == ["14 and 5 more changes within a second"]
    told.events.add(alarm(20.0, "returned (high): too full"))
    assert told.lines[-1] == "20 alarm tank.full: returned (high): too full"


def test_the_end_of_a_run_does_not_lose_the_number_of_the_others() -> None:
    told = Told()
    for _ in range(LINES_PER_SECOND + 1):
        told.events.add(alarm(3.0, "unacknowledged (high): too full"))
    told.events.look(is_over=True)
    assert told.lines[-1] == "3 and 1 more changes within a second"


@pytest.mark.parametrize(("terminal", "begun"), [(True, "\r\x1b[2K"), (False, "")])
def test_a_line_stands_before_the_progress_and_without_control_characters(terminal: bool, begun: str) -> None:
    console = Console(file=io.StringIO(), force_terminal=terminal)
    RunProgressLine(console).note(12.5, "alarm tank.full: \x1b[31m")
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue() == f"{begun}  12.500 s  alarm tank.full: ?[31m\n"


def test_a_line_of_the_log_about_an_event_begins_with_its_time_on_the_terminal_of_umo(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(logging, "lastResort", None)
    monkeypatch.setattr(sys, "stderr", screen := io.StringIO())
    streams.log_on_lines()
    assert logging.lastResort is not None
    monkeypatch.setattr(logging.getLogger("umo"), "handlers", [logging.lastResort])
    monkeypatch.setattr(logging.getLogger("umo"), "propagate", False)
    events = Events()
    events.add(Event(12.5, "heater", "inhibited: the level is low"), logged=True)
    events.log(lambda: "caches are not warmed")
    events.tell()
    assert screen.getvalue() == "  12.500 s  heater inhibited: the level is low\ncaches are not warmed\n"
