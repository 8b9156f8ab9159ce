"""Any timer in wall-clock time: `realtime` makes a plant's own period pass at the pace of the wall clock."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from helpers.machines import bench
from umo import connect
from umo.drivers import Channel, Direction, Driver, DriverError, WiringError
from umo.drivers.paced import PacedTimer
from umo.objects import atoms
from umo.testing import VirtualTimer
from umo.wiring import Wired, check, resolve

MISSED = [0, 3, 1, 0]


class Plant(Driver):
    """Counts its periods and the calls of its timer channel."""

    def __init__(self) -> None:
        self.periods = 0
        self.calls: list[str] = []

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 31, signed=text != "tick")

    def initialize(self, channel: Channel, default: int | None) -> None:
        self.calls.append(f"initialize {channel.text}")

    def finalize(self, channel: Channel) -> None:
        self.calls.append(f"finalize {channel.text}")

    def read(self, channel: Channel) -> int:
        self.periods += channel.text == "tick"
        return 0

    def write(self, channel: Channel, raw: int) -> None:
        pass


@pytest.fixture
def ticker(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The wall clock in the test's client: it misses `MISSED`, and logs."""
    answers: Iterator[int] = iter(MISSED)
    log: list[Any] = []

    class FakeTicker:
        due = woke = 0

        def __init__(self, period: float) -> None:
            log.append(period)

        def start(self) -> None:
            log.append("start")

        def wait(self) -> int:
            return next(answers)

        def close(self) -> None:
            log.append("close")

    monkeypatch.setattr("umo.drivers.timerfd.Ticker", FakeTicker)
    return log


def wiring(plant: Driver, **timer: Any) -> dict[str, Any]:
    paths = [item.path for item in atoms(bench())]
    wire: dict[str, Any] = {path: {"driver": "plant"} for path in paths if path != "timer"}
    wire["timer"] = {"driver": "plant", "channel": "tick", "period": "2 ms"} | timer
    return {"drivers": {"plant": plant}, "wire": wire}


def test_the_plants_periods_pass_at_the_pace_of_the_wall_clock_the_missed_ones_too(ticker: list[Any]) -> None:
    plant = Plant()
    with connect(bench(), wiring(plant), realtime=True) as m:
        assert [m.timer.read() for _ in MISSED] == MISSED
        assert plant.periods == 1 + 3 + 1 + 1
    assert ticker == [0.002, "start", "close"]
    assert {"initialize tick", "finalize tick"} <= set(plant.calls)


@pytest.mark.parametrize("call", ["initialize", "read"])
def test_a_paced_timer_that_fails_is_named_as_its_plant(ticker: list[Any], call: str) -> None:
    plant = Plant()

    def explode(channel: Channel, *default: int | None) -> int:
        if channel.text == "tick":
            raise OSError("it has exploded")
        return 0

    setattr(plant, call, explode)
    failing = pytest.raises(DriverError, match="plant: it has exploded; timer")
    with failing, connect(bench(), wiring(plant), realtime=True) as m:
        m.timer.read()


def test_in_virtual_time_nothing_waits(ticker: list[Any]) -> None:
    plant = Plant()
    with connect(bench(), wiring(plant), realtime=False) as m:
        assert [m.timer.read() for _ in range(3)] == [0, 0, 0]
    assert (plant.periods, ticker) == (3, [])


def resolved(given: dict[str, Any] | None, **options: Any) -> Wired:
    return resolve(bench(), given, options)


def test_the_wiring_is_in_real_time_then_and_the_driver_stays_what_it_is() -> None:
    plant = Plant()
    wired = resolved(wiring(plant), realtime=True)
    assert (wired.realtime, wired.paced) == (True, True)
    assert wired.drivers == {"plant": plant}
    assert wired.timer_wire is not None
    assert isinstance(wired.timer_wire.driver, PacedTimer)
    assert (wired.timer_wire.driver.period, wired.timer_wire.driver.timeout) == (0.002, 0.02)
    assert all(wire.driver is plant for wire in wired.wires if wire.item is not wired.timer)


def test_everything_simulated_can_be_in_real_time() -> None:
    assert resolved(None, realtime=True).realtime
    assert not resolved(None).realtime


def test_a_real_time_timer_is_left_as_it_is() -> None:
    wired = resolved(wiring(Plant(), driver="timerfd", channel="tick"), realtime=True)
    assert (wired.realtime, wired.paced) == (True, False)


def test_a_paced_timer_may_stand_beside_hardware() -> None:
    class Card(Plant):
        def devices(self) -> list[str]:
            return ["card 1"]

    given = wiring(Card(), driver="clock")
    given["drivers"]["clock"] = VirtualTimer()
    with pytest.raises(WiringError, match=r"clock runs in virtual time.* or run with --realtime"):
        resolved(given)
    with pytest.raises(WiringError, match=r"clock runs in virtual time"), connect(bench(), given):
        pass
    assert resolved(given, realtime=True).realtime


def test_virtual_time_beside_hardware_is_no_mistake_as_long_as_nothing_runs() -> None:
    class Card(Plant):
        def devices(self) -> list[str]:
            return ["card 1"]

    given = wiring(Card())
    assert check(bench(), given) == []
    text = "plant runs in virtual time, but driver plant controls hardware (card 1)"
    assert resolve(bench(), given, to_run=False).mixed_times == text
    assert resolved(given, realtime=True).mixed_times == ""


def test_an_object_on_the_timers_channel_is_still_found() -> None:
    given = wiring(Plant())
    path = next(iter(given["wire"]))
    given["wire"][path] = {"driver": "plant", "channel": "tick"}
    with pytest.raises(WiringError, match=f"channel 'tick' of plant is already used by ({path}|timer)"):
        resolved(given, realtime=True)


@pytest.mark.parametrize("value", ["yes", 1, 0.5])
def test_realtime_is_true_or_false(value: object) -> None:
    with pytest.raises(WiringError, match="the option realtime is true or false, not"):
        resolved(wiring(Plant()), realtime=value)


def test_without_a_timer_there_is_no_real_time() -> None:
    from umo import BinaryActuator, Compound
    from umo.states import OnOff

    class Lamp(Compound):
        lamp: BinaryActuator[OnOff]

    lamp = Lamp(lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
    with pytest.raises(WiringError, match="real time needs a timer, and the machine has no object `timer`"):
        resolve(lamp, None, {"realtime": True})


def test_an_option_realtime_of_a_driver_is_not_mistaken_for_the_runs() -> None:
    """It can still be set in the driver's table."""
    from umo.wiring import driver_options

    given = {"drivers": {"plant": {"type": "test_paced:Own"}}, "wire": {}}
    assert list(driver_options(given)) == ["seed"]


class Own(Plant):
    def __init__(self, *, realtime: bool = False, seed: int = 0) -> None:
        super().__init__()


# The command --------------------------------------------------------------------------------------


@pytest.fixture
def quick_tank(tank: Path) -> Path:
    """A new station that works for about a second."""
    application = tank / "application.py"
    application.write_text(application.read_text().replace("20 s", "100 ms"))
    return tank


def factor(folder: Path) -> float | None:
    """Simulated time over wall-clock time of a run; None in real time."""
    found: float | None = json.loads((folder / "summary.json").read_text())["realtime_factor"]
    return found


@pytest.mark.full
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time is Linux's")
def test_a_new_station_runs_in_wall_clock_time_if_asked_to(umo: Callable[..., Result], quick_tank: Path) -> None:
    result = umo("run", "tank", "--target", "35", "--summary", "summary.json")
    assert result.exit_code == 0
    assert (factor(quick_tank.parent) or 0.0) > 2
    result = umo("run", "tank", "--target", "35", "--realtime", "--summary", "summary.json")
    assert result.exit_code == 0, result.stderr
    assert "--realtime" not in result.stderr
    assert factor(quick_tank.parent) is None


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time is Linux's")
@pytest.mark.full
def test_with_a_real_time_timer_the_option_is_a_sentence(umo: Callable[..., Result], quick_tank: Path) -> None:
    wiring = quick_tank / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text().replace('driver = "tank", channel = "tick"', 'driver = "timerfd"'))
    (quick_tank / "application.py").write_text("async def main(m):\n    pass\n")
    result = umo("run", "tank", "--realtime")
    assert result.exit_code == 0
    assert "umo: --realtime has no effect: the timer of this wiring is a real-time timer" in result.stderr


def test_without_a_timer_the_command_says_so(umo: Callable[..., Result], tank: Path) -> None:
    for file in ("control.py", "objects.py"):
        lines = (tank / file).read_text().splitlines()
        (tank / file).write_text("\n".join(line for line in lines if "    timer" not in line) + "\n")
    wiring = tank / "wiring" / "simulated.toml"
    wiring.write_text("\n".join(line for line in wiring.read_text().splitlines() if "tick" not in line) + "\n")
    result = umo("run", "tank", "--realtime")
    assert result.exit_code == 2, result.stderr
    assert "real time needs a timer, and the machine has no object `timer`" in result.stderr
