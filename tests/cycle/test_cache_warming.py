"""Cache warming before a tick: umo's own part of a period on copies, without the driver and the user's code."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from helpers.machines import Bench, actuator, bench, relay, sensor, switch, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, Interlock, LookupTable, connect
from umo.cycle import cache_warming
from umo.cycle.cache_warming import COPIED_OBJECTS, CacheWarming, wait_busily
from umo.cycle.machine import ConnectedMachine
from umo.states import PassFail
from umo.testing import Scripted

pytestmark = pytest.mark.usefixtures("each_way")


class Own(DigitalActuator):
    """With a method of the user's."""

    def write(self, value: float) -> bool:
        pytest.fail("the user's code was called")


class Watched(Bench):
    """Everything that could be called is the user's."""

    def control(self) -> None:
        pytest.fail("the user's control was called")

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.limit.read() is PassFail.FAIL, [self.motor], "the limit switch")


def full(motor: DigitalActuator) -> Watched:
    return Watched(
        timer=timer(),
        motor=motor,
        encoder=sensor(incremental=True),
        valve=relay(synchronous=False),
        limit=switch(),
    )


def state(image: Any) -> list[str]:
    return [str(list(each)) for each in (image.values, image.raws, image.pending, image.quality, image.times)]


def test_neither_driver_nor_user_code_is_called_and_nothing_of_the_machine_changes() -> None:
    own = Own("V", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.5, slew_rate=10.0, expires="5 ms")
    machine, box = full(own), Scripted({"encoder": 40})
    connection = connect(machine, wired(machine, box))
    with connection as m:
        warming, image = CacheWarming(connection.wired), connection.image
        calls, events = len(box.calls), connection.machine.events.number
        before = state(image)
        for _ in range(20):
            warming()
        assert state(image) == before
        assert (len(box.calls), connection.machine.events.number, m.now) == (calls, events, 0.0)
        assert own.path == "motor"


@pytest.fixture
def copies(monkeypatch: pytest.MonkeyPatch) -> list[ConnectedMachine]:
    """The machines of the copies that are made."""
    made: list[ConnectedMachine] = []

    def copy(*given: Any) -> ConnectedMachine:
        made.append(ConnectedMachine(*given))
        return made[-1]

    monkeypatch.setattr(cache_warming, "ConnectedMachine", copy)
    return made


def test_the_copies_are_read_and_written_as_the_objects_are(
    caplog: pytest.LogCaptureFixture, copies: list[ConnectedMachine]
) -> None:
    """All are GOOD, so that the usual way is warmed; and nothing is logged."""
    machine = bench(
        encoder=sensor(incremental=True, invalid_raws=[100, 101]),
        limit=switch(),
        motor=actuator(expires="2 ms", slew_rate=1.0),
    )
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        warming = CacheWarming(connection.wired)
        for _ in range(10):
            warming()
        (copied,) = copies
        assert copied.image.sampled_good
        assert copied.clock.number == 10
    assert caplog.text == ""


def test_a_machine_of_thousands_is_copied_in_part(copies: list[ConnectedMachine]) -> None:
    class Rack(Compound):
        motors: list[DigitalActuator]
        timer: DigitalSensor

    machine = Rack(motors=[actuator(expires="5 ms") for _ in range(3 * COPIED_OBJECTS)], timer=timer())
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        warming = CacheWarming(connection.wired)
        warming()
        assert len(copies[0].image.items) == COPIED_OBJECTS
        assert copies[0].clock.number == 1, "the timer is one of them"
        assert type(copies[0].image) is type(connection.image)


def test_a_linearization_of_the_user_s_own_is_not_called(copies: list[ConnectedMachine]) -> None:
    called = []

    class Table(LookupTable):
        def to_input(self, value: float) -> float:
            called.append(value)
            return super().to_input(value)

    class Valve(Compound):
        timer: DigitalSensor
        flow: DigitalActuator

    table = Table((0.0, 1.0, 5.0), (0.0, 2.0, 5.0))
    flow = DigitalActuator("V", default=0.0, minimum=0.0, maximum=5.0, resolution=0.5, linearization=table)
    machine = Valve(timer=timer(), flow=flow)
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        called.clear()
        warming = CacheWarming(connection.wired)
        warming()
        assert called == []
        assert copies[0].clock.number == 1


def test_a_warming_that_fails_is_told_once_and_left_out(caplog: pytest.LogCaptureFixture) -> None:
    machine = bench()
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        warming = CacheWarming(connection.wired)
        warming._actuators.append(None)
        for _ in range(3):
            warming()
    assert caplog.text.count("caches are not warmed") == 1


def test_a_machine_that_cannot_be_copied_runs_without_a_warming(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = bench()
    connection = connect(machine, wired(machine, Scripted()))
    with connection:
        ticker = SimpleNamespace(wait_busily=lambda seconds: None, meanwhile=None)
        connection.wired.timer_wire.driver.ticker = ticker
        monkeypatch.setattr("umo.cycle.cache_warming._copy", lambda item: None)
        wait_busily(connection.wired, 1e-4)
        assert ticker.meanwhile is None
    assert "caches are not warmed" in caplog.text


def test_only_a_timer_in_real_time_rises_early() -> None:
    machine: Any = bench()
    connection = connect(machine, wired(machine, Scripted()))
    with connection as m:
        wait_busily(connection.wired, 1e-4)
        assert m.timer.read() == 0.0
