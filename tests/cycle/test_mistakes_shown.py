"""Mistakes of the program, which do not end a run: where they are told."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import Result

from helpers.conversions import BUILT
from umo import connect, published
from umo.cycle.events import MISTAKE, Event
from umo.cycle.fault_log import FaultLog
from umo.process.start import LINUX
from umo.testing import periods, station

pytestmark = BUILT
Umo = Callable[..., Result]
OBJECTS = """
from umo import Compound, DigitalActuator, DigitalSensor


class Oven(Compound):
    heater: DigitalActuator
    timer: DigitalSensor
    warming = False

    def control(self):
        if self.warming:
            self.heater.write(1.0)


def machine():
    return Oven(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
"""
APPLICATION = """
from umo.control import wait


async def main(m):
    m.warming = True
    for _ in range(3):
        m.heater.write(5.0)
        await wait("20 ms")
"""
WIRING = """
[drivers.simulated]
type = "simulated"
[wire]
timer = { driver = "simulated", channel = "tick", period = "10 ms" }
heater = { driver = "simulated", channel = "heater" }
"""


@pytest.fixture
def oven(tmp_path: Path) -> Path:
    folder = tmp_path / "oven"
    (folder / "wiring").mkdir(parents=True)
    for name, text in {"__init__.py": "", "objects.py": OBJECTS, "application.py": APPLICATION}.items():
        (folder / name).write_text(text)
    (folder / "wiring" / "simulated.toml").write_text(WIRING)
    return folder


@pytest.mark.parametrize("way", [(), ("--realtime",)][: 1 + LINUX])
def test_a_run_tells_it_in_its_log_its_table_and_its_summary(umo: Umo, oven: Path, way: tuple[str, ...]) -> None:
    result = umo("run", "oven", "--no-record", "--summary", "sum.json", *way)
    assert result.exit_code == 0, result.stderr
    (found,) = json.loads((oven.parent / "sum.json").read_text())["mistakes"]
    assert found["path"] == "heater"
    assert "application.py:8 in main) and control of Oven (" in found["text"]
    assert "objects.py:12 in control)" in found["text"]
    assert "mistake: heater" in result.stdout


@contextmanager
def running(oven: Path) -> Iterator[None]:
    """The oven in this process, until its mistake is told."""
    m = station(oven).machine()
    connection = connect(m, oven / "wiring" / "simulated.toml")
    with connection, published(connection, "oven", "rig"):
        m.cycle.start(station(oven).main(m))
        periods(m, 5)
        yield


def test_why_tells_the_mistakes_whose_events_are_kept(umo: Umo, oven: Path) -> None:
    with running(oven):
        text = " ".join(umo("show", "why", "--now").stdout.split())
    assert "mistake: heater: written by two: sequence main (" in text
    assert "mistake: heater: " in umo("show", "why").stdout


def test_the_log_has_it_once(caplog: pytest.LogCaptureFixture, oven: Path) -> None:
    caplog.set_level(logging.WARNING, "umo")
    with running(oven):
        assert [each.message.split(":")[0] for each in caplog.records] == ["heater written by two"]


def test_the_first_mistakes_of_a_run_are_kept() -> None:
    log = FaultLog()
    for number in range(200):
        log.add(Event(0.1, f"valves.{number}", "written by two", asked=MISTAKE))
    assert (len(log.mistakes), log.mistakes[0].path) == (100, "valves.0")
