"""The station's own tests: `pytest` in its folder. No test sleeps: time is a wired device."""

from collections.abc import Callable
from typing import Any

import pytest

from umo import TaskFailed, check, connect, drive, run
from umo.states import OpenClosed, PassFail
from umo.testing import periods, put, station

TANK = station(__file__)
SIMULATED = TANK.wirings["simulated"]
Plant = TANK.load("plant").Plant  # a class of the station: `from ..plant import Plant` works in its own modules only
main = TANK.main
machine: Callable[[], Any] = TANK.machine  # a Tank; imported at run time, so a type checker does not know it


@pytest.mark.parametrize("name", TANK.wirings)
def test_the_wirings_fit_the_machine(name: str) -> None:
    assert check(machine(), TANK.wirings[name]) == []


def test_the_level_is_kept_and_the_tank_drained_at_the_end() -> None:
    levels = []
    connection = connect(machine(), SIMULATED)
    with connection as m:
        connection.machine.observers.append(lambda frame: levels.append(m.level.read()))
        drive(m, main)
    assert max(levels) == pytest.approx(308.0, abs=3.0)
    assert levels[-1] <= 50.0


def test_the_plant_fills_and_leaks() -> None:
    plant = Plant(level=100.0, leak=2.0)
    plant.write(plant.channel("out:inlet"), 1)
    plant.advance(0.5)
    assert plant.level == pytest.approx(109.0)


def test_an_overflow_stops_the_machine_with_both_valves_closed() -> None:
    """All channels are simulated, and the test itself plays the plant."""
    connection = connect(machine())
    with pytest.raises(TaskFailed, match="overflows"), connection as m:
        m.aim(300.0)
        periods(m)
        assert m.inlet.read() is OpenClosed.OPEN
        put(m.overflow, PassFail.FAIL)
        periods(m)
    assert connection.driver("simulated").get("inlet") == 0


def test_a_sensor_that_never_rises_ends_the_run() -> None:
    with pytest.raises(TimeoutError, match="60 s"):
        run(machine(), None, main, until="1 h")
