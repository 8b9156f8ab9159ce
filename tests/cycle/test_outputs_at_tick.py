"""`outputs = "at next tick"`: what a period computes is sent right after the next tick, before sampling."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from helpers.machines import Bench, actuator, bench, failed, relay, sensor, switch, timer, wired
from umo import Compound, DigitalActuator, Interlock, connect, published
from umo.errors import DriverError, WiringError
from umo.process.frames import Reader
from umo.states import OnOff, PassFail
from umo.testing import Scripted
from umo.wiring import resolve

pytestmark = pytest.mark.usefixtures("each_way")


def later(machine: Compound, box: Scripted) -> dict[str, Any]:
    return wired(machine, box) | {"process": {"outputs": "at next tick"}}


def begin(m: Bench, periods: int = 1) -> None:
    """Whole periods, and of the next one the tick and the sample."""
    for _ in range(periods):
        m.timer.read()
        m.sample()
        m.control()
        m.update()
    m.timer.read()
    m.sample()


def sent(box: Scripted, channel: str) -> list[int]:
    """What the transfers of whole periods have sent to a channel."""
    calls = box.segments("write_many")
    return [call.raws[call.channels.index(channel)] for call in calls if channel in call.channels]


def test_what_a_period_writes_is_sent_after_the_next_tick_and_before_its_sample() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        begun = len(box.calls)
        m.motor.write(2.0)
        m.update()
        m.timer.read()
        assert (len(box.calls), m.motor.read(), m.motor.pending) == (begun, 0.0, 2.0)
        m.sample()
        assert [call.segment for call in box.calls[begun:]] == ["write_many", "read_many"]
        assert (sent(box, "motor")[-1], m.motor.read(), m.motor.time) == (4, 2.0, m.now)


def test_a_rate_limit_makes_one_step_per_period_and_an_expired_command_goes_with_the_next_tick() -> None:
    machine, box = bench(motor=actuator(slew_rate=1000.0, expires="3 ms")), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.motor.write(2.5)
        m.update()
        before = len(sent(box, "motor"))
        begin(m, periods=6)
        assert sent(box, "motor")[before:] == [2, 4, 2, 0, 0, 0, 0]  # half volts: it expires with the third tick


def test_a_command_that_expired_in_missed_periods_is_not_sent_any_more() -> None:
    machine, box, clock = bench(motor=actuator(expires="3 ms")), Scripted(), Scripted()
    wiring = wired(machine, box, clock=clock) | {"process": {"outputs": "at next tick"}}
    with connect(machine, wiring) as m:
        begin(m)
        m.motor.write(2.5)
        m.update()
        before = len(sent(box, "motor"))
        clock.set("timer", 100)
        m.timer.read()
        m.sample()
        assert sent(box, "motor")[before:] == [0]


class Guarded(Bench):
    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.limit.read() is PassFail.FAIL, [self.motor], "the limit switch")


def test_an_interlock_resets_right_after_the_sample_that_sees_its_condition() -> None:
    box = Scripted({"limit": [0, 0, 0, 0, 1]})
    machine = Guarded(timer=timer(), motor=actuator(), encoder=sensor(), valve=relay(), limit=switch())
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.motor.write(2.0)
        m.update()
        m.timer.read()
        m.sample()
        m.motor.write(3.0)
        begun = len(box.calls)
        m.update()
        m.timer.read()
        m.sample()
        assert [call.segment for call in box.calls[begun:]] == ["write_many", "read_many", "reset"]
        assert m.motor.inhibited == "the limit switch"
        assert not m.motor.write(3.0)
        m.update()
        begin(m)
        assert (sent(box, "motor")[-1], m.motor.read()) == (0, 0.0)


def test_a_reset_goes_out_at_once_and_nothing_of_before_comes_after_it() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.motor.write(2.0)
        m.valve.write(OnOff.ON)
        m.motor.reset()
        assert box.calls[-1].segment == "reset"
        m.update()
        begin(m)
        assert (sent(box, "motor")[-1], sent(box, "valve")[-1]) == (0, 1)


def test_the_last_periods_outputs_are_not_sent_at_the_end_but_the_defaults() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.motor.write(2.0)
        m.update()
    assert 4 not in sent(box, "motor")
    assert box.get("motor") == 0


def test_without_an_update_nothing_is_sent() -> None:
    """As by default: a program that has caught an error of its period leaves `update` out."""
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        before = len(sent(box, "motor"))
        m.motor.write(2.0)
        m.sample()
        m.timer.read()
        m.sample()
        assert sent(box, "motor")[before:] == []
        m.update()
        m.timer.read()
        m.sample()
        assert sent(box, "motor")[before:] == [4]


def test_a_program_that_does_not_sample_sends_with_its_next_update() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        for written in (1.0, 2.0, 3.0):
            m.timer.read()
            m.motor.write(written)
            m.update()
        assert sent(box, "motor") == [4, 6]


def test_a_part_is_sent_when_it_is_updated() -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.motor.write(2.0)
        m.motor.update()
        assert sent(box, "motor")[-1] == 4


@pytest.mark.parametrize(
    ("broken", "paths"), [("write", ["motor", "valve"]), ("all", ["motor", "valve", "encoder", "limit"])]
)
def test_sample_reads_although_the_outputs_failed_and_names_all_that_failed(broken: str, paths: list[str]) -> None:
    machine, box = bench(), Scripted()
    with connect(machine, later(machine, box)) as m:
        begin(m)
        m.update()
        m.timer.read()
        first, begun = len(box.calls), len(box.segments("read_many"))
        for number in range(first, first + (1 if broken == "write" else 2)):
            box.at(number, OSError("unplugged"))
        with pytest.raises(DriverError) as caught:
            m.sample()
        assert sorted(failed(caught.value)) == sorted(paths)
        assert len(box.segments("read_many")) == begun + 1


def test_a_frame_holds_what_stood_at_the_hardware_in_its_period() -> None:
    machine, box = bench(), Scripted()
    connection = connect(machine, later(machine, box))
    with connection as m, published(connection, "press") as ring, Reader(ring.path) as reader:
        m.timer.read()
        m.sample()
        m.motor.write(2.0)
        m.update()
        m.timer.read()
        m.sample()
        m.update()
        frames = reader.read()
        assert frames["values"][:, reader.index("motor")].tolist() == [0.0, 2.0]
        assert frames["number"].tolist() == [1, 2]


@pytest.mark.parametrize("value", ["later", True, 1])
def test_another_word_is_a_fault_of_the_wiring(value: object) -> None:
    machine = bench()
    with pytest.raises(WiringError, match="must be one of at once, at next tick"):
        resolve(machine, wired(machine, Scripted()) | {"process": {"outputs": value}})


def test_a_machine_without_a_timer_has_no_next_tick() -> None:
    class Timeless(Compound):
        motor: DigitalActuator

    machine = Timeless(motor=actuator())
    for process in ({"outputs": "at next tick"}, {"busy_wait": "10 us"}):
        with pytest.raises(WiringError, match="the machine has no timer"):
            resolve(machine, {"wire": {"motor": {"driver": "simulated"}}, "process": process})
