"""The message of a run that failed: what, when and where in one line, what else failed in a second one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from helpers.machines import Bench, actuator, bench, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, connect, run
from umo.control import until, wait
from umo.cycle.trace import Statistics
from umo.errors import DeclarationError, DriverError, Failure, Mistake, RangeError, StateError, StopError, WiringError
from umo.objects import find
from umo.process.outcome import Failed, Outcome, message_of
from umo.testing import Scripted, periods
from umo_command.run.run_folder import RunSummary

HERE = r"\S*test_outcome\.py:\d+"


def failed(application: Any, machine: Compound | None = None, box: Scripted | None = None) -> Failed:
    """How a run fails."""
    machine = machine or bench()
    with pytest.raises(BaseException) as caught:
        run(machine, wired(machine, box or Scripted()), application)
    return Failed.of(caught.value)


def after_2_ms(act: Callable[[Bench], object]) -> Any:
    async def main(m: Bench) -> None:
        await wait("2 ms")
        act(m)

    return main


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda m: m.motor.write(math.nan), "motor: nan is not finite"),
        (lambda m: m.motor.write(99.0), "motor: 99 V is outside -10 to 10"),
        (lambda m: m.valve.write("ON"), "valve: 'ON' is not a state of OnOff"),
        (lambda m: {}["no such part"], "KeyError: 'no such part'"),
        (lambda m: find(m, "nothing"), "no object 'nothing' in Bench"),
        (lambda m: setattr(m, "motor", 3), "motor is a part; parts cannot be replaced"),
    ],
    ids=["nan", "range", "state", "key", "path", "declaration"],
)
def test_what_is_raised_in_the_run_has_its_time_and_place_and_status_1(act: Any, text: str) -> None:
    end = failed(after_2_ms(act))
    assert re.fullmatch(rf".*{text}.* \(at 0\.003 s, {HERE} in <lambda>\)", end.message), end.message
    assert end.status == 1
    assert "Traceback" in end.traceback


def test_the_place_of_a_condition_that_raises_is_in_the_condition() -> None:
    async def main(m: Bench) -> None:
        def tilted() -> bool:
            raise LookupError("no tilt")

        await until(tilted)

    assert re.fullmatch(rf"LookupError: no tilt \(at 0\.001 s, {HERE} in tilted\)", failed(main).message)


def test_a_mistake_before_the_first_period_is_the_users_and_has_no_time() -> None:
    m = bench()
    for act, kind in ((lambda: m.motor.write(99.0), RangeError), (lambda: m.valve.write("ON"), StateError)):  # type: ignore[arg-type]
        with pytest.raises(kind) as caught, connect(m, wired(m, Scripted())):
            act()
        assert Failed.of(caught.value).status == 2
        assert " (at " not in message_of(caught.value)


def test_pythons_own_traceback_says_when_once_for_the_last_run() -> None:
    error = KeyError("again")

    def fail(m: Bench) -> None:
        raise error

    for _ in range(2):
        failed(after_2_ms(fail))
    assert error.__notes__ == ["at 0.003 s"]


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor


class Tunnel(Compound):
    zones: tuple[Zone, ...]
    timer: DigitalSensor


def tunnel(count: int) -> Tunnel:
    return Tunnel(zones=tuple(Zone(heater=actuator(), temperature=sensor()) for _ in range(count)), timer=timer())


class Box(Scripted):
    """A box with a device that can go away."""

    dead = False

    def devices(self) -> list[str]:
        return ["modbus tcp 127.0.0.1:5020"]

    def _call(self, segment: str, *rest: Any) -> Any:
        if self.dead and segment not in ("finalize", "close"):
            raise TimeoutError("timed out (10 ms)")
        return super()._call(segment, *rest)


def test_a_dead_box_of_40_objects_is_named_once_with_its_device_and_the_first_objects() -> None:
    m, box = tunnel(20), Box()
    wiring = wired(m, box, clock=type("Real", (Scripted,), {"realtime": True})({"timer": 0}))
    wiring["wire"]["timer"] = {"driver": "clock", "period": "1 ms"}
    connection = connect(m, wiring)
    connection.pause = lambda seconds: None
    with pytest.raises(StopError) as caught, connection:
        periods(m)
        box.dead = True
        periods(m)
    what, more = message_of(caught.value).splitlines()
    box_is_dead = "box (modbus tcp 127.0.0.1:5020): timed out (10 ms); "
    heaters, sensors = (f"zones.0.{name}, zones.1.{name} and 18 others" for name in ("heater", "temperature"))
    assert what.startswith(f"could not be read: {box_is_dead}{sensors} (at 0.002 s, ")
    assert more == f"not brought to their defaults: {box_is_dead}{heaters}"
    assert len(caught.value.failures) == 20


def test_drivers_that_failed_each_have_a_line_and_the_message_two() -> None:
    error = DriverError("could not be read", [Failure(f"{i}.x", "in", "cut", f"box {i}") for i in range(4)])
    assert str(error).splitlines() == [
        "could not be read: box 0: cut; 0.x (channel in)",
        *(f"  box {i}: cut; {i}.x (channel in)" for i in (1, 2, 3)),
    ]
    assert message_of(error).splitlines() == [
        "could not be read: box 0: cut; 0.x (channel in)",
        "box 1: cut; 1.x (channel in); box 2: cut; 2.x (channel in); box 3: cut; 3.x (channel in)",
    ]


def test_a_mistake_in_the_code_of_a_driver_is_named_with_its_place() -> None:
    class Careless(Scripted):
        def read_many(self, channels: Any, out: Any) -> None:
            if self.period and len(self.calls) > 20:
                raise KeyError("adc:7")
            super().read_many(channels, out)

    what = rf"could not be read: box: KeyError: 'adc:7' \({HERE} in read_many\); encoder and limit"
    assert re.match(rf"{what} \(at 0\.0\d+ s, ", failed(None, box=Careless()).message)


def test_notes_share_the_second_line_and_the_faults_of_a_wiring_keep_their_own() -> None:
    error = ValueError("one\ntwo")
    error.add_note("three\nfour")
    error.add_note("five")
    assert message_of(error) == "ValueError: one\ntwo; three; four; five"
    wiring = WiringError("2 faults", [Mistake("a.toml", "wire.x", "wrong"), Mistake("a.toml", "wire.y", "wrong")])
    assert message_of(wiring) == "2 faults\na.toml: wire.x: wrong\na.toml: wire.y: wrong"
    assert message_of(DeclarationError("no timer")) == "no timer"


def test_the_table_of_a_run_points_at_umo_why_where_periods_were_missed() -> None:
    for missed, hint in ((0, "missed 0"), (125, "missed 125 (why: `umo show why`)")):
        statistics = Statistics()
        statistics.missed = missed
        console = Console(width=80, record=True, file=StringIO())
        console.print(RunSummary(statistics).table("umo run"))
        assert f"{hint} " in console.export_text()


def test_the_table_of_a_run_shows_times_as_everything_else_does() -> None:
    console = Console(width=80, record=True, file=StringIO())
    statistics = Statistics(capacity=1)
    statistics._times[:] = 20
    statistics.periods = 3
    console.print(RunSummary(statistics, Outcome(simulated=0.004), elapsed=0.000_25).table("umo run"))
    assert "4 ms in 250 µs, 16 x real time" in console.export_text()


def test_a_run_that_was_stopped_before_it_started_does_not_say_that_its_outputs_are_at_their_defaults() -> None:
    assert Outcome(stopped_by=2, driven=True).outputs == "every actuator is at its default"
    assert Outcome(stopped_by=2).outputs.startswith(
        "the run had not started: the outputs that it had reached are at their defaults"
    )
