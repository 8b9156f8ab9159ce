"""The period in C: a stop, an error, a driver's stand-in and a fork are heeded as in Python, and outputs reach their
defaults."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest

from helpers.conversions import BUILT
from helpers.generating import needs_a_compiler
from helpers.in_c import FragileInC, TimerInC
from helpers.machines import actuator, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor
from umo.cycle.connect import connect
from umo.cycle.run import drive
from umo.cycle.stopping import request_stop
from umo.drivers import DriverError, MovesInC
from umo.drivers.optional import transfer_in_c
from umo.drivers.paced import PacedTimer
from umo.drivers.simulated import Simulated
from umo.drivers.timerfd import TimerFd
from umo.drivers.wrapping import Wrapper
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.generate.period_in_c import PeriodInC
from umo.system.signal_handling import handling
from umo.wiring import resolve

pytestmark = [needs_a_compiler, BUILT]


class Tank(Compound):
    timer: DigitalSensor
    level: DigitalSensor
    valve: DigitalActuator
    seen: int = 0

    def control(self) -> None:
        self.seen += 1
        self.valve.write(0.05 * self.level.read())


class Rig:
    """A tank that is past the comparison of its laws: its level is 40 mm, 2 V are written."""

    def __init__(self) -> None:
        self.at: dict[int, Callable[[], object]] = {}
        """What is called as the timer is read so often."""
        self.box, self.clock = FragileInC(), TimerInC(on_period=lambda number: self.at.get(number, int)())
        self.box.set("level", 80)
        self.m: Any = Tank(timer=timer(), level=sensor(), valve=actuator())
        wiring = resolve(self.m, wired(self.m, self.box, clock=self.clock))
        prepared = prepare(self.m, wiring)
        self.connection = connect(self.m, wiring)
        self.connection.laid_out = lambda machine: (machine.attach(CompiledLaws(prepared)), machine.attach(self.period))
        self.period = PeriodInC()

    def begin(self) -> AbstractContextManager[object]:
        @contextmanager
        def connected() -> Any:
            with self.connection:
                while self.clock.reads < 2 * COMPARED:
                    self.period.run(1, None)
                yield

        return connected()


def test_the_standard_loop_is_in_c_and_ends_in_the_period_of_a_stop_with_outputs_at_their_defaults() -> None:
    rig = Rig()
    rig.at[500] = request_stop
    with rig.connection as m:
        drive(m)
        assert (rig.clock.reads, rig.m.seen) == (500, 500)
        assert rig.box.get("valve") == 4
        assert rig.box.moved_in_c > 800
        assert rig.period.reasons == {}
    assert rig.box.get("valve") == 0


def test_a_signal_ends_a_wait_in_c_at_once() -> None:
    """The tick would come in 100 s."""
    box, m = FragileInC(), Tank(timer=timer(), level=sensor(), valve=actuator())
    wiring = wired(m, box)
    wiring["wire"]["timer"] = {"driver": "timerfd", "period": "100 s"}
    connection, period = connect(m, wiring), PeriodInC()
    connection.laid_out = lambda machine: machine.attach(period)
    with connection, handling(lambda *_: request_stop(), [signal.SIGALRM]):
        period._bind()
        assert "TICK" not in period.reasons
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        drive(m)
        assert (connection.stop.requested, connection.machine.clock.number) == (True, 0)


def test_many_periods_are_one_call_until_something_comes_in() -> None:
    rig = Rig()
    with rig.begin():
        assert rig.period.run(50, None) == 50
        rig.m.cycle.tell("something")
        assert [rig.period.run(50, None) for _ in range(2)] == [1, 50]


def test_a_failing_sensor_ends_the_loop_with_its_error_in_its_period() -> None:
    rig = Rig()
    with rig.begin():
        began = rig.clock.reads
        rig.at[began + 10] = lambda: rig.box.set("level", OSError("cut"))
        with pytest.raises(DriverError, match="could not be read: box: cut; level"):
            rig.period.run(50, None)
        assert rig.clock.reads == began + 10
        rig.box.set("level", 80)
    assert rig.box.get("valve") == 0


class Refused(BaseException):
    pass


@contextmanager
def refused(transfer: Any, blocks: list[Any], also_timer: bool) -> Iterator[None]:
    """Meanwhile no call is to reach a driver, as in a process that was forked from the control process."""

    def instead(*_: object) -> Any:
        raise Refused

    before = [(each, dict(vars(each))) for each in (transfer, transfer.callees, *blocks)]
    (transfer if also_timer else transfer.callees).refuse(instead)
    yield
    for each, attributes in before:
        vars(each).update(attributes)


@pytest.mark.parametrize("also_timer", [False, True])
@pytest.mark.parametrize("bound_again", [False, True])
def test_a_driver_that_is_refused_is_not_reached_in_c_either(bound_again: bool, also_timer: bool) -> None:
    rig = Rig()
    with rig.begin():
        image, reads, moved = rig.connection.image, rig.clock.reads, rig.box.moved_in_c
        with refused(image.transfer, [*image.inputs, *image.outputs], also_timer):
            if bound_again:
                rig.period._native = None
            for _ in range(3):
                with pytest.raises(Refused):
                    rig.period.run(1, None)
        assert rig.box.moved_in_c == moved
        assert (rig.clock.reads == reads) is also_timer


def test_nothing_is_written_any_more_once_the_machine_was_reset() -> None:
    rig = Rig()
    with rig.begin():
        rig.connection.image.transfer.callees.end_writing()
        before = rig.box.get("valve")
        rig.box.set("level", 20)
        with pytest.raises(DriverError, match="the machine has been reset; nothing is written any more"):
            rig.period.run(50, None)
        assert rig.box.get("valve") == before == 4
        rig.connection.image.transfer.callees.written = True


class Own(Simulated):
    def read_many(self, channels: Any, out: Any) -> None:
        out[:] = 7


class Both(Simulated, MovesInC):
    def read_many(self, channels: Any, out: Any) -> None:
        out[:] = 7

    def in_c(self, channels: Any, write: bool) -> Any:
        return "not now"


@pytest.mark.parametrize(
    "driver, why",
    [
        (Own(history=0), "Own has functions of its own in Python"),
        (Both(history=0), "not now"),
        (PacedTimer(Simulated(history=0)), "PacedTimer has functions of its own in Python"),
        (Wrapper(Simulated(history=0)), "it has no transfers in C"),
        (Simulated(), "it keeps a history of writes: set `history = 0`"),
        (TimerFd(), "it does not run"),
    ],
)
def test_what_a_driver_does_in_python_is_not_passed_by_in_c(driver: Any, why: str) -> None:
    assert transfer_in_c(driver, (), False) == why


def test_a_simulated_circuit_has_the_same_values_in_both_ways() -> None:
    circuit = Simulated(history=0)
    a, b = map(circuit.channel, "ab")
    circuit.set("a", 3)
    found = transfer_in_c(circuit, (a, b), False)
    assert not isinstance(found, str)
    circuit.write(b, -5)
    assert [circuit.get("a"), circuit.read(b)] == [3, -5]
