"""`umo device get` and `umo device set` of a path that is there only while the station runs, or is no object: they say
what it is."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import Result

from umo import connect, published
from umo.process.job import Job, Plan
from umo.testing import periods

Umo = Callable[..., Result]
STATION = '''
from typing import Annotated

from umo import Compound, DigitalActuator, DigitalSensor, Number, action
from umo.operation.alarms import Alarm, High
from umo.control import Servo


class Press(Compound, alarms={"hot": Alarm(High("oven", 80.0), "too hot")}):
    heater: DigitalActuator
    oven: DigitalSensor
    timer: DigitalSensor
    band: Annotated[float, Number("degC", 1.0, 50.0, tunable=True)] = 10.0

    def setup(self):
        self.servo = Servo(self.oven, self.heater, gain=0.1)

    @action()
    async def bake(self):
        """Bake."""


def machine():
    return Press(
        heater=DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.5),
        oven=DigitalSensor("degC", minimum=0.0, maximum=100.0, resolution=0.1),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
'''


@pytest.fixture
def press(umo: Umo, tmp_path: Path) -> Path:
    folder = tmp_path / "press"
    folder.mkdir()
    (folder / "objects.py").write_text(STATION)
    return folder


def said(result: Result) -> str:
    assert result.exit_code == 2, result.output
    return " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("path", "what", "command"),
    [
        ("servo.error", "a signal", "umo device get press servo.error"),
        ("band", "a tunable number", "umo tune number press band"),
        ("bake", "an action", "umo do press call bake"),
        ("hot", "an alarm", "umo alarm list press"),
    ],
)
def test_a_path_that_is_there_only_while_it_runs_is_told_so(
    umo: Umo, press: Path, path: str, what: str, command: str
) -> None:
    expected = (
        f"umo: {path} is {what}, which exists only while the station runs: start the station (`umo run press "
        f"--realtime`), "
        f"then `{command}`"
    )
    assert said(umo("device", "get", "press", path)) == expected
    assert said(umo("device", "get", "press", "heater", path)) == expected
    assert said(umo("device", "set", "press", path, "1")) == expected


@pytest.mark.parametrize(
    ("path", "near"), [("heatr", "heater"), ("servo.eror", "servo.error"), ("bande", "band"), ("qqqq", "")]
)
def test_a_misspelt_path_is_told_with_the_nearest_of_all_that_there_is(
    umo: Umo, press: Path, path: str, near: str
) -> None:
    hint = f" (did you mean {near!r}?)" if near else ""
    assert said(umo("device", "get", "press", path)) == f"umo: there is no object {path!r} in Press{hint}"


@pytest.fixture
def running(press: Path) -> Iterator[None]:
    plan = Plan(Job(station=str(press)))
    connection = connect(plan.machine, plan.wired)
    with connection as machine, published(connection, plan.name, place=plan.place):
        periods(machine, 3)
        yield


@pytest.mark.usefixtures("running")
def test_while_it_runs_signals_are_shown_and_actions_and_alarms_are_told_with_their_command(umo: Umo) -> None:
    shown = umo("device", "get", "press", "servo.error", "band")
    assert shown.exit_code == 0, shown.output
    assert said(umo("device", "get", "press", "bake")) == "umo: bake is an action: `umo do press call bake`"
    assert said(umo("device", "get", str(os.getpid()), "hot")) == "umo: hot is an alarm: `umo alarm list press`"
