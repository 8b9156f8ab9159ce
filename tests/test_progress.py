"""What a run shows while it works."""

from __future__ import annotations

import io

from rich.console import Console

from umo import Compound, DigitalSensor, Frame, connect
from umo.cli.progress import Shown


class Machine(Compound):
    timer: DigitalSensor

    def setup(self) -> None:
        self.task = "homing"
        self.placed, self.parts_total = 1, 2


def shown(times: list[float], *, terminal: bool) -> str:
    file, now = io.StringIO(), [0.0]
    m = Machine(timer=DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False))
    connection = connect(m)
    with connection, Shown(m, Console(file=file, force_terminal=terminal, width=80), lambda: now[0]) as line:
        for number, time in enumerate(times):
            now[0] = time
            frame = Frame(connection.image)
            frame.time = time
            if number == 3:
                m.task = "picking"
            line(frame)
    return file.getvalue()


def test_on_a_terminal_one_line_is_redrawn_ten_times_a_second() -> None:
    text = shown([1.0, 1.05, 1.09, 1.11], terminal=True)
    assert text.count("homing") == 1
    assert "━━━━━━━━━━━━╌╌╌╌╌╌╌╌╌╌╌╌  homing" in text
    assert text.count("picking") == 1
    assert "\n" not in text
    assert text.endswith("\r\x1b[2K")


def test_elsewhere_a_line_is_written_for_every_new_task() -> None:
    assert shown([1.0, 2.0, 3.0, 4.0], terminal=False) == "   1.000 s  homing\n   4.000 s  picking\n"
