"""The loop: written out, or as umo.run."""

from __future__ import annotations

import logging

import pytest

from helpers.machines import actuator, bench, sensor, timer, wired
from umo import Compound, DigitalActuator, DigitalSensor, connect, drive, run
from umo.control import next_period, until
from umo.errors import DeclarationError, DriverError, StopError, TimeExpired
from umo.states import OnOff
from umo.testing import Scripted, VirtualTimer, put


class Follower(Compound):
    """The motor follows the encoder."""

    timer: DigitalSensor
    motor: DigitalActuator
    encoder: DigitalSensor

    def control(self) -> None:
        self.motor.write(self.encoder.read() / 10.0)


def follower() -> Follower:
    return Follower(timer=timer(), motor=actuator(), encoder=sensor())


READINGS = [0, 20, 40, 60, 80, 100]


def calls_of(run_it):
    machine, box = follower(), Scripted({"encoder": READINGS})
    run_it(machine, wired(machine, box, clock=VirtualTimer(end_after=5, missed=[0, 2])))
    return box.calls


def written_out(machine, wiring):
    with connect(machine, wiring) as m:
        while m.cycle.running:
            m.timer.read()
            m.sample()
            m.control()
            m.update()


class Leaving(Scripted):
    """Ends Python in one of its calls, as if all were well."""

    call = ""

    def open(self) -> None:
        self._leave("open")

    def read_many(self, channels, out):
        self._leave("read")
        super().read_many(channels, out)

    def write_many(self, channels, raws):
        self._leave("write")
        super().write_many(channels, raws)

    def _leave(self, call: str) -> None:
        if call == self.call:
            raise SystemExit(0)


@pytest.mark.parametrize("call", ["open", "read", "write"])
@pytest.mark.parametrize("drive", [run, written_out])
def test_a_driver_that_exits_is_a_failure_like_any_other(call, drive):
    machine, box = follower(), Leaving({"encoder": READINGS})
    box.call = call
    with pytest.raises(DriverError, match="SystemExit: 0"):
        drive(machine, wired(machine, box, clock=VirtualTimer(end_after=5)))


def test_the_explicit_loop_and_run_are_equal():
    assert calls_of(written_out) == calls_of(run)
    updates = [call.raws for call in calls_of(run) if call.segment == "write_many"]
    assert updates == [(2,), (4,), (6,), (8,), (10,)]


def test_run_returns_what_the_application_returned_and_ends_with_it():
    async def application(m):
        for _ in range(3):
            await next_period()
        return m.now

    machine, box = bench(), Scripted()
    assert run(machine, wired(machine, box), application) == pytest.approx(0.004)
    assert len(box.segments("write_many")) == 4  # the last period is finished too


def test_a_run_that_has_not_ended_by_its_limit_is_ended_and_names_the_line_that_waits():
    async def application(m):
        m.valve.write(OnOff.ON)
        await until(lambda: False)

    machine, box = bench(), Scripted()
    with pytest.raises(TimeExpired, match=r"has not ended by 0.01 s; the application waited at .*test_run.py:\d+"):
        run(machine, wired(machine, box), application, until="10 ms")
    assert next(call.raws for call in box.segments("write_many")) == (0, 1)
    assert box.segments("reset")


def test_a_limit_that_is_no_time_is_refused_before_anything_is_driven():
    machine, box = bench(), Scripted()
    with pytest.raises(DeclarationError, match="soon"):
        run(machine, wired(machine, box), None, until="soon")
    assert not box.calls


def test_the_applications_own_period_is_finished_before_leaving():
    async def application(m):
        m.valve.write(OnOff.ON)

    machine, box = bench(), Scripted()
    run(machine, wired(machine, box), application)
    assert [call.raws for call in box.segments("write_many")] == [(0, 1)]


def test_a_stop_cancels_the_application_and_the_result_is_none():
    cleaned = []

    async def application(m):
        try:
            while True:
                await next_period()
        finally:
            cleaned.append(m.now)

    machine = bench()
    assert run(machine, wired(machine, Scripted(), clock=VirtualTimer(end_after=3)), application) is None
    assert cleaned == [pytest.approx(0.003)]


@pytest.mark.parametrize("where", ["application", "control"])
def test_errors_surface_after_the_actuators_have_been_reset(where):
    class Failing(Compound):
        timer: DigitalSensor
        motor: DigitalActuator

        def control(self) -> None:
            if where == "control" and self.now > 0.0025:
                raise ZeroDivisionError("mine")

    async def application(m):
        m.motor.write(5.0)
        await next_period()
        await next_period()
        if where == "application":
            raise ZeroDivisionError("mine")
        while True:
            await next_period()

    machine, box = Failing(timer=timer(), motor=actuator()), Scripted()
    with pytest.raises(ZeroDivisionError, match="mine"):
        run(machine, wired(machine, box), application)
    assert [call.segment for call in box.calls[-3:]] == ["reset", "finalize", "close"]
    assert box.get("motor") == 0


def test_a_device_that_fails_in_the_loop_surfaces_with_its_paths():
    machine, box = bench(), Scripted({"encoder": [0, 0, OSError("cut")]})
    with pytest.raises(DriverError, match="encoder"):
        run(machine, wired(machine, box))
    assert len(box.segments("finalize")) == 4


def test_a_device_that_stays_dead_is_a_stop_error_with_the_first_failure_as_its_cause():
    machine, box = bench(), Scripted()
    box.at(8, lambda call: setattr(box, "broken", OSError("dead")))
    with pytest.raises(StopError) as caught:
        run(machine, wired(machine, box))
    assert isinstance(caught.value.__cause__, DriverError)


def test_a_machine_without_a_timer_does_not_run():
    class Still(Compound):
        motor: DigitalActuator

    machine, box = Still(motor=actuator()), Scripted()
    with pytest.raises(DeclarationError, match="Still has no `timer`"):
        run(machine, {"drivers": {"box": box}, "wire": {"motor": {"driver": "box"}}})
    assert box.calls == []  # it is told before the hardware is touched


def test_drive_is_the_loop_on_a_connected_machine():
    async def application(m):
        put(m.encoder, 12.0)
        await next_period()
        return m.encoder.read()

    with connect(bench()) as m:
        assert drive(m, application) == 12.0
        assert drive(m, application) == 12.0
        assert m.cycle.connected


def test_an_application_that_is_no_sequence_is_a_type_error():
    with pytest.raises(TypeError, match="is not a sequence"):
        run(bench(), None, lambda m: 5)


def test_observers_see_every_period_and_cannot_hurt_it(caplog):
    frames, counts = [], []

    def good(frame):
        frames.append((frame.number, frame.time, frame.missed, frame.execution >= 0, list(frame.raws)))

    def bad(frame):
        counts.append(1)
        raise RuntimeError("observer")

    machine = follower()
    clock = VirtualTimer(missed=[0, 2], end_after=3)
    with caplog.at_level(logging.CRITICAL, "umo"):
        run(machine, wired(machine, Scripted({"encoder": READINGS}), clock=clock), observers=[bad, good])
    assert len(counts) == 1  # disabled after its first failure
    assert [(n, m) for n, _, m, _, _ in frames] == [(1, 0), (3, 2), (4, 0)]
    assert [t for _, t, _, _, _ in frames] == pytest.approx([0.001, 0.003, 0.004])
    assert all(positive for *_, positive, _ in frames)
    assert [raws[:2] for *_, raws in frames] == [[20, 2], [40, 4], [60, 6]]


def test_every_compound_learns_the_period_and_the_ticks_consumed():
    seen = []

    class Part(Compound):
        motor: DigitalActuator

        def control(self) -> None:
            seen.append((self.cycle.period, self.dt))

    class Whole(Compound):
        timer: DigitalSensor
        part: Part

    machine = Whole(timer=timer(), part=Part(motor=actuator()))
    run(machine, wired(machine, Scripted(), clock=VirtualTimer(missed=[0, 1, 4], end_after=4)))
    assert seen == [(0.001, pytest.approx(dt)) for dt in (0.001, 0.001, 0.004, 0.001)]
