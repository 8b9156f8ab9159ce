"""The order in which actuators go to their defaults: at every level of the tree, whatever brings them there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.machines import actuator, failed, relay, switch, timer, wired
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, Interlock, connect
from umo.drivers import Driver, DriverError
from umo.drivers.contract import Channel
from umo.errors import StopError
from umo.objects.stop_order import stop_sequence
from umo.process.reset import ATTEMPT_PAUSE, Resetter
from umo.states import OnOff, PassFail
from umo.testing import Scripted, VirtualTimer, periods, put
from umo.wiring import resolve


class Joint(Compound, stop_order=("brake",)):
    motor: DigitalActuator
    brake: BinaryActuator[OnOff]


class Arm(Compound, stop_order=("lamp", "turn")):
    lift: Joint
    turn: Joint
    lamp: BinaryActuator[OnOff]


class Cell(Compound, stop_order=("valve", "arms.right.lift.motor", "arms.right")):
    """Declared fans, arms, valve; stopped as `stop_order` says at every level."""

    timer: DigitalSensor
    door: BinarySensor[PassFail]
    fans: list[BinaryActuator[OnOff]]
    arms: dict[str, Arm]
    valve: BinaryActuator[OnOff]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.door.read() is PassFail.FAIL, [*self.fans, *self.arms.values()], "open")


def joint() -> Joint:
    return Joint(motor=actuator(), brake=relay(synchronous=False))


def cell() -> Cell:
    arms = {side: Arm(lift=joint(), turn=joint(), lamp=relay()) for side in ("left", "right")}
    return Cell(timer=timer(), door=switch(), fans=[relay(), relay()], arms=arms, valve=relay())


LEFT = [f"arms.left.{path}" for path in ("lamp", "turn.brake", "turn.motor", "lift.brake", "lift.motor")]
RIGHT = [f"arms.right.{path}" for path in ("lift.motor", "lamp", "turn.brake", "turn.motor", "lift.brake")]
ORDER = ["valve", *RIGHT, "fans.0", "fans.1", *LEFT]


def resets(box: Scripted, since: int = 0) -> list[str]:
    found = [call.channels[0] for call in box.calls[since:] if call.segment == "reset"]
    return [path for path in found if path != "door"]


def test_each_compound_orders_its_own_parts_and_one_further_up_what_it_names_itself() -> None:
    assert [item.path for item in stop_sequence(cell())] == ORDER


def test_without_a_stop_order_actuators_stop_as_declared() -> None:
    class Plain(Compound):
        b: BinaryActuator[OnOff]
        joints: list[Joint]
        a: BinaryActuator[OnOff]

    m = Plain(b=relay(), joints=[joint()], a=relay())
    assert [item.path for item in stop_sequence(m)] == ["b", "joints.0.brake", "joints.0.motor", "a"]


def test_of_an_object_that_is_named_twice_the_first_place_counts() -> None:
    class Twice(Compound, stop_order=("joint.motor", "joint", "a", "joint.motor")):
        a: BinaryActuator[OnOff]
        joint: Joint

    m = Twice(a=relay(), joint=joint())
    assert [item.path for item in stop_sequence(m)] == ["joint.motor", "joint.brake", "a"]


def test_leaving_after_an_error_holds_the_order() -> None:
    m, box = cell(), Scripted()
    with pytest.raises(ZeroDivisionError), connect(m, wired(m, box)):
        1 / 0  # noqa: B018
    assert resets(box) == ORDER


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (lambda m: m, ORDER),
        (lambda m: m.arms["left"], LEFT),
        (lambda m: m.arms["right"], RIGHT),  # as the root says, which names a part of it
        (lambda m: m.arms["left"].turn, LEFT[1:3]),
    ],
)
def test_a_reset_of_the_machine_or_of_a_part_holds_the_order(part: Callable[[Cell], Any], expected: list[str]) -> None:
    m, box = cell(), Scripted()
    with connect(m, wired(m, box)):
        since = len(box.calls)
        part(m).reset()
        assert resets(box, since) == expected


def test_an_interlock_holds_the_order_whatever_the_order_in_which_it_names_things() -> None:
    m, box = cell(), Scripted()
    with connect(m, wired(m, box)):
        since = len(box.calls)
        put(m.door, PassFail.FAIL)
        periods(m)
        assert resets(box, since) == ORDER[1:]


def test_what_is_tried_again_holds_the_order() -> None:
    m, box = cell(), Scripted()
    with connect(m, wired(m, box)):
        put(m.door, PassFail.FAIL)
        since = len(box.calls) + 1
        for number in range(len(ORDER) - 1):
            box.at(since + number, OSError("glitch"))
        m.timer.read()
        with pytest.raises(DriverError):
            m.sample()
        since = len(box.calls)
        periods(m)
        assert resets(box, since) == [path for path in ORDER[1:] if path.endswith("brake")]  # the asynchronous ones


class Real(Scripted):
    """Scripted, on hardware: what failed may still be under way."""

    def devices(self) -> list[str]:
        return ["a test's box"]


class RealClock(VirtualTimer):
    """No machine on hardware runs in virtual time."""

    realtime = True


def test_the_second_reset_of_a_device_that_failed_holds_the_order() -> None:
    m, box = cell(), Real()
    connection = connect(m, wired(m, box, clock=RealClock()))
    connection.pause = lambda seconds: None
    since = len(box.calls)
    with pytest.raises(DriverError, match="reset at a later attempt: glitch"), connection:
        since = len(box.calls)
        box.at(since + 2, OSError("glitch"))
    assert resets(box, since) == ORDER * 2


@pytest.fixture
def without_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guardian does its work in this process, where a test can look on, and waits for nothing."""

    def refuse() -> int:
        raise OSError("no more processes")

    monkeypatch.setattr("umo.system.calls.fork", refuse)
    monkeypatch.setattr("umo.system.calls.sleep", lambda seconds: None)


@pytest.mark.usefixtures("without_children")
def test_the_guardian_holds_the_order() -> None:
    m, box = cell(), Scripted()
    assert Resetter(m, resolve(m, wired(m, box))).reset(0.0) == {}
    assert [call.channels[0] for call in box.segments("initialize")] == ORDER
    assert resets(box) == ORDER * 2  # again when what was under way has been carried out


# A device that does not answer holds none of the others back ----------------------------------------------


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that the transfer stage sees, in s: it stands still unless a test moves it."""
    now = [100.0]
    monkeypatch.setattr("umo.cycle.transfer.monotonic", lambda: now[0])
    return now


class Slow(Driver):
    """A circuit whose writes time out while `silent`; every call goes into a list that circuits share."""

    def __init__(self, calls: list[str]) -> None:
        self.calls = calls
        self.silent = True

    def channel(self, text: str) -> Channel:
        return Scripted().channel(text)

    def initialize(self, channel: Channel, default: int | None) -> None:
        pass

    def read(self, channel: Channel) -> int:
        return 0

    def write(self, channel: Channel, raw: int) -> None:
        self.calls.append(channel.text)
        if self.silent:
            raise TimeoutError("no answer")


def mixed(calls: list[str]) -> tuple[Cell, dict[str, Any], Slow]:
    """The right arm on a circuit that times out, everything else on one that does not."""
    m, slow, quick = cell(), Slow(calls), Slow(calls)
    quick.silent = False
    wiring = wired(m, quick, entries={path: {"driver": "slow"} for path in RIGHT}, slow=slow)
    return m, wiring, slow


REST = [path for path in ORDER if path not in (*RIGHT, "valve")]
LAST = ["valve", RIGHT[0], *REST, *RIGHT[1:]]
"""The first that times out, then everybody else, and only then the rest of its circuit."""


@pytest.mark.usefixtures("clock")
def test_after_the_first_timeout_of_a_driver_its_other_actuators_are_reset_last() -> None:
    calls: list[str] = []
    m, wiring, _ = mixed(calls)
    with pytest.raises(StopError) as caught, connect(m, wiring):
        pass
    assert calls == LAST
    assert [failure.path for failure in caught.value.failures] == RIGHT


@pytest.mark.usefixtures("clock")
def test_a_driver_that_timed_out_in_the_run_is_reset_last_at_its_end() -> None:
    calls: list[str] = []
    m, wiring, slow = mixed(calls)
    with connect(m, wiring):
        with pytest.raises(DriverError):
            m.arms["right"].turn.brake.write(OnOff.ON)
        slow.silent = False
        calls.clear()
    assert calls == ["valve", *REST, *RIGHT]


@pytest.mark.usefixtures("clock")
def test_a_reset_in_the_run_does_not_wait_for_a_driver_that_timed_out() -> None:
    calls: list[str] = []
    m, wiring, slow = mixed(calls)
    with connect(m, wiring):
        with pytest.raises(DriverError):
            m.arms["right"].turn.brake.write(OnOff.ON)
        calls.clear()
        with pytest.raises(DriverError, match="the driver is away: no answer") as caught:
            m.reset()
        assert calls == ["valve", *REST]
        assert sorted(failed(caught.value)) == sorted(RIGHT)
        slow.silent = False
        periods(m)
        calls.clear()
        m.reset()
        assert set(calls) == {*ORDER}


def test_a_timeout_of_long_ago_does_not_count(clock: list[float]) -> None:
    calls: list[str] = []
    m, wiring, slow = mixed(calls)
    with connect(m, wiring):
        with pytest.raises(DriverError):
            m.arms["right"].turn.brake.write(OnOff.ON)
        slow.silent = False
        clock[0] += 0.501 + 2 * slow.timeout
        calls.clear()
    assert calls == ORDER


def test_any_other_failure_keeps_its_place() -> None:
    m, box = cell(), Scripted()
    with pytest.raises(StopError), connect(m, wired(m, box)):
        since = len(box.calls)
        box.at(since + 1, OSError("refused"))
    assert resets(box, since) == ORDER


def test_a_call_that_took_as_long_as_its_timeout_counts_as_timed_out(clock: list[float]) -> None:
    class Late(Slow):
        def write(self, channel: Channel, raw: int) -> None:
            self.calls.append(channel.text)
            clock[0] += self.timeout
            raise OSError("the line is dead")

    calls: list[str] = []
    m, wiring, _ = mixed(calls)
    wiring["drivers"]["slow"] = Late(calls)
    with pytest.raises(StopError), connect(m, wiring):
        pass
    assert calls == LAST


@pytest.mark.usefixtures("without_children", "clock")
def test_the_guardian_tries_a_silent_device_once_an_attempt_and_at_the_end_all_of_it() -> None:
    class Opened(Slow):
        def initialize(self, channel: Channel, default: int | None) -> None:
            self.write(channel, 0)

    calls: list[str] = []
    m = cell()
    silent, quick = Opened(calls), Slow(calls)
    quick.silent = False
    wiring = wired(m, quick, entries={path: {"driver": "slow"} for path in RIGHT}, slow=silent)
    left = Resetter(m, resolve(m, wiring)).reset(0.9 * ATTEMPT_PAUSE)  # as long again for what was not tried
    assert calls == [RIGHT[0], *["valve", *REST] * 2, *RIGHT[1:], RIGHT[0]]  # and once more: it may answer by now
    assert left == dict.fromkeys(RIGHT, "slow: no answer")
