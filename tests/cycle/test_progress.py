"""What a run shows while it works."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from umo import Compound, DigitalSensor, connect
from umo.cycle.showing import frame_of
from umo.cycle.stage import Progress
from umo.errors import RangeError
from umo_command.progress_line import RunProgressLine


class Machine(Compound):
    timer: DigitalSensor


def machine() -> Machine:
    return Machine(timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False))


def shown(times: list[float], *, terminal: bool) -> str:
    file, now = io.StringIO(), [0.0]
    connection = connect(machine())
    console = Console(file=file, force_terminal=terminal, width=80)
    with connection as m, RunProgressLine(console, lambda: now[0]) as line:
        m.cycle.progress("homing", done=1, total=2)
        frame = frame_of(connection.machine)
        for number, time in enumerate(times):
            now[0] = frame.time = time
            if number == 3:
                m.cycle.progress("picking\x1b[2J")
            frame.progress = connection.machine.progress
            line(frame)
    return file.getvalue()


def test_on_a_terminal_one_line_is_redrawn_ten_times_a_second() -> None:
    text = shown([1.0, 1.05, 1.09, 1.11], terminal=True)
    assert text.count("homing") == 1
    assert "━━━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌╌╌  homing" in text
    assert text.count("picking") == 1
    assert "\n" not in text
    assert text.endswith("\r\x1b[2K")


def test_elsewhere_a_line_is_written_for_every_new_text() -> None:
    assert shown([1.0, 2.0, 3.0, 4.0], terminal=False) == "   1.000 s  homing\n   4.000 s  picking?[2J\n"


@pytest.mark.parametrize("terminal", [True, False])
def test_the_share_is_worked_out_where_a_line_is_drawn_and_in_no_other_period(terminal: bool, monkeypatch: Any) -> None:
    asked: list[Progress] = []
    monkeypatch.setattr(Progress, "share", property(lambda progress: asked.append(progress) or 0.5))
    shown([1.0, 1.05, 1.09], terminal=terminal)
    assert asked == [Progress("homing", 1, 2)]


def test_numbers_that_are_not_given_stay() -> None:
    connection = connect(machine())
    with connection as m:
        m.cycle.progress("homing", total=3)
        m.cycle.progress("picking", done=1)
        m.cycle.progress("placing")
        assert connection.machine.progress == ("placing", 1, 3)
        assert connection.machine.progress.share == 1 / 3


@pytest.mark.parametrize(("name", "number"), [("done", -1), ("total", 1.5), ("done", True), ("total", "3")])
def test_progress_counts_in_whole_numbers(name: str, number: object) -> None:
    with connect(machine()) as m, pytest.raises(RangeError, match=f"progress: {name}="):
        m.cycle.progress("homing", **{name: number})  # type: ignore[arg-type]


def test_counts_of_numpy_are_whole_numbers() -> None:
    shown = Progress().then("half", np.int64(3), np.uint8(6))
    assert (shown.done, shown.total, type(shown.done)) == (3, 6, int)
