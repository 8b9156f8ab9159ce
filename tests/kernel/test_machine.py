"""A whole machine on the lines of a simulated GPIO chip: connected, run in real time, killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

import pytest

from .gpio_sim import Chip, Trace

WIRING = """
[drivers.pins]
type = "umo.drivers.gpio:Gpio"
chip = "{chip}"

[wire]
"inlet" = {{ driver = "pins", channel = "line:INLET" }}
"drain" = {{ driver = "pins", channel = "line:1", inverted = true }}
"level" = {{ driver = "pins", channel = "lines:4-13" }}
"overflow" = {{ driver = "pins", channel = "line:2 bias=pull-down" }}
"timer" = {{ driver = "timerfd", period = "20 ms" }}
"""


@pytest.fixture
def station(tank: Path, gpio_chip: Callable[..., Chip]) -> tuple[Path, Chip]:
    """A tank with an inlet, normally closed, and an inverted drain; the level is a number of 10 bits. The resistor of
    the inlet's line is on the wrong side, so that it can be seen when nobody drives the line."""
    chip = gpio_chip(lines=16, names={0: "INLET"})
    chip.line(0).pull(1)
    (tank / "wiring" / "board.toml").write_text(WIRING.format(chip=chip.label))
    return tank, chip


def umo(*words: str | Path) -> list[str]:
    return [sys.executable, "-c", "from umo_command import main; main()", *map(str, words)]


@contextmanager
def running(tank: Path) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(umo("run", tank, "-w", "board"), stdin=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()


def wait_until(condition: Callable[[], object], process: subprocess.Popen[bytes]) -> None:
    """For 30 s, as long as the process runs."""
    end = monotonic() + 30
    while not condition():
        assert monotonic() < end and process.poll() is None
        sleep(0.02)


def users() -> list[int]:
    """The processes that hold lines of a chip."""
    found = []
    for folder in Path("/proc").glob("[0-9]*/fd"):
        with suppress(OSError):
            if any(os.readlink(link) == "anon_inode:gpio-line" for link in folder.iterdir()):
                found.append(int(folder.parent.name))
    return found


def test_a_wiring_is_checked_and_objects_are_read_and_set_by_hand(station: tuple[Path, Chip]) -> None:
    tank, chip = station
    for line, level in ((5, 1), (7, 1), (13, 1)):
        chip.line(line).pull(level)
    subprocess.run(umo("check", tank, "-w", "board"), check=True)
    read = subprocess.run(
        umo("device", "get", tank, "level", "-w", "board"), check=True, stdout=subprocess.PIPE, text=True
    )
    assert "261" in read.stdout  # (2 + 8 + 512) * 0.5 mm
    with Trace(chip.label) as trace:
        subprocess.run(umo("device", "set", tank, "drain", "OPEN", "--for", "0.1", "-w", "board"), check=True)
    levels = [what for line, what in trace.events() if line == 1 and what.startswith("set")]
    assert (levels[0], levels[-1]) == ("set 1", "set 1")
    assert "set 0" in levels


def test_a_run_drives_its_outputs_and_leaves_them_at_their_defaults(station: tuple[Path, Chip]) -> None:
    tank, chip = station
    with Trace(chip.label) as trace:
        with running(tank) as process:
            wait_until(lambda: (0, "set 1") in trace.events(), process)
            assert (chip.line(0).value, chip.line(1).value) == (1, 1)
            process.send_signal(signal.SIGINT)
        assert [what for line, what in trace.events() if line == 0 and what != "out"][-1] == "set 0"
    assert users() == []


def test_the_guardian_resets_the_outputs_when_the_control_process_is_killed(station: tuple[Path, Chip]) -> None:
    tank, chip = station
    with Trace(chip.label) as trace:
        with running(tank) as process:
            wait_until(lambda: (0, "set 1") in trace.events(), process)
            trace.taken()
            (control,) = users()
            os.kill(control, signal.SIGKILL)
            assert process.wait(30) != 0
        events = trace.events()
    for line, level in ((0, "set 0"), (1, "set 1")):
        done = [what for number, what in events if number == line]
        assert "out" in done and [what for what in done if what != "out"][-1] == level
