"""Axes in manual mode: they react as declared, are free for the operator, and the application goes on or is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from typing import Any

import pytest

import umo
from helpers.machines import relay, timer
from helpers.operator import Operator
from helpers.slide import DT, SERVO, Slide, direction_output, encoder, motor, servo, stepper
from helpers.tiers import each_value, first
from umo import BinaryActuator, Compound, DigitalSensor, Interlock, Quality
from umo.control import Axis, EndStop, ServoAxis, state_of, wait
from umo.control.axis_state import AxisState
from umo.cycle.events import CommandState
from umo.drivers import Channel
from umo.errors import DriverError, TaskFailed
from umo.objects import Actuator, atoms
from umo.states import OnOff, Rotation

ON = {"x.motor": "motor", "x.step": "step", "x.direction": "direction", "x.encoder": "counter", "timer": "tick"}


class Rail(Compound):
    x: Axis
    timer: DigitalSensor


class Disabling(Rail, when_suspended="default"): ...


class RunningOn(Rail, when_suspended="run on"): ...


BOTH = pytest.mark.parametrize("make", [servo, stepper])
Make = Callable[..., Axis]


class Bench(Operator):
    """An operator of an axis on a slide; the setpoints of every period."""

    def __init__(self, machine: Compound, slide: Slide) -> None:
        super().__init__(machine)
        self.slide, self.setpoints = slide, []
        self.x: Any = machine.x  # type: ignore[attr-defined]
        self.machine.observers.append(lambda _: self.setpoints.append(self.x.profile.setpoint))
        self.setpoints: list[Any]

    def until(self, condition: Callable[[], bool], most: int = 20_000) -> None:
        for _ in range(most):
            if condition():
                return
            self.run()
        raise AssertionError("it did not come true")

    def smooth(self, velocity: float, acceleration: float) -> bool:
        """Whether no setpoint was beyond these limits."""
        speeds = [each.velocity for each in self.setpoints]
        steps = (abs(after - before) for before, after in pairwise(speeds))
        return max(map(abs, speeds)) <= velocity * 1.001 and max(steps) <= acceleration * DT * 1.001


@contextmanager
def bench(
    axis: Axis, kind: type[Rail] = Rail, referenced: bool = True, start: float = 40.0, slide: type[Slide] = Slide
) -> Iterator[Bench]:
    m = kind(x=axis, timer=timer())
    with on_slide(m, slide(start)) as found:
        if referenced:
            m.x.encoder.referenced(at=start)
        yield found


@contextmanager
def on_slide(m: Rail, slide: Slide) -> Iterator[Bench]:
    channels = {item.path: ON.get(item.path, "enable") for item in atoms(m)}
    wire: dict[str, Any] = {path: {"driver": "slide", "channel": channel} for path, channel in channels.items()}
    wire["timer"]["period"] = DT
    with umo.connect(m, {"drivers": {"slide": slide}, "wire": wire}):
        found = Bench(m, slide)
        found.do("lease", seconds=60.0)
        yield found


async def forth_and_back(m: Any) -> str:
    await m.x.move_to(60.0)
    await wait(0.2)
    await m.x.move_to(45.0)
    return "done"


LIMITS = {servo: (200.0, 2_000.0), stepper: (15.0, 200.0)}


@pytest.mark.parametrize(("make", "after"), each_value([servo, stepper], [60, 120, 3_000]))
def test_a_motion_stops_on_its_profile_and_goes_on_within_its_limits(make: Make, after: int) -> None:
    with bench(make()) as ann:
        task = ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        assert ann.x.profile.setpoint.velocity > 5.0
        ann.mode("manual")
        assert "x stops" in ann.notes[-1]
        ann.run(after)
        assert ann.x.enabled
        here = ann.slide.position
        if after > 1_000:
            ann.run(500)
            assert ann.slide.position == pytest.approx(here, abs=0.05)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.until(lambda: task.done)
        assert (task.result, ann.slide.position) == ("done", pytest.approx(45.0, abs=0.06))
        assert ann.smooth(*LIMITS[make])


@BOTH
def test_in_manual_mode_an_axis_is_free_for_the_operator(make: Make) -> None:
    with bench(make()) as ann:
        task = ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        ann.mode("manual")
        ann.run(300)
        here = ann.slide.position
        assert ann.call("x.jog", velocity=-10.0).state is CommandState.DONE
        ann.run(300)
        assert ann.slide.position < here - 1.0
        ann.do("let go", "x.jog")
        ann.run(200)
        moved = ann.call("x.move_to", position=50.0)
        assert moved.state is CommandState.BEGUN
        ann.until(lambda: len([each for each in ann.events if each.command == moved.command]) == 2)
        assert ann.slide.position == pytest.approx(50.0, abs=0.06)
        ann.call("x.disable")
        ann.run(10)
        assert not ann.x.enabled
        ann.mode("automatic")
        ann.until(lambda: task.done)
        assert (task.result, ann.slide.position) == ("done", pytest.approx(45.0, abs=0.06))
        assert ann.smooth(*LIMITS[make])


@BOTH
def test_a_motion_that_has_ended_has_released_its_axis(make: Make) -> None:
    """Also if its sequence could not tell any more."""
    with bench(make()) as ann:
        ann.m.cycle.start(forth_and_back(ann.m))
        ann.until(lambda: bool(ann.x.profile.done) and ann.slide.position > 59.9)
        ann.mode("manual")
        ann.run(100)
        assert ann.call("x.jog", velocity=-5.0).state is CommandState.DONE
        ann.run(100)
        assert ann.x.setpoint < 59.9


@BOTH
def test_an_axis_that_was_moved_is_moved_back_or_the_application_does_not_go_on(make: Make) -> None:
    async def program(m: Any) -> None:
        await m.x.move_to(60.0)
        await wait(5.0)
        await m.x.move_to(45.0)

    with bench(make()) as ann:
        task = ann.m.cycle.start(program(ann.m))
        ann.until(lambda: ann.x.state is AxisState.STANDSTILL)
        ann.mode("manual")
        ann.call("x.move_to", position=50.0)
        refused = ann.mode("automatic")
        moves = "x still moves; wait until it stands, or stop the run"
        assert refused.text == f"CommandRefused: the application cannot continue: {moves}"
        assert ann.x.state is AxisState.DISCRETE_MOTION  # nothing has changed
        ann.until(lambda: ann.x.state is AxisState.STANDSTILL)
        refused = ann.mode("automatic")
        assert refused.state is CommandState.REFUSED
        assert refused.text.startswith("CommandRefused: the application cannot continue: x is at ")
        assert refused.text.endswith("the application left it at 60.00 mm; move it back (`x.move_to`), or stop the run")
        ann.call("x.disable")
        ann.run(3)
        assert ann.mode("automatic").state is CommandState.REFUSED
        ann.call("x.move_to", position=60.0)
        ann.until(lambda: ann.x.state is AxisState.STANDSTILL)
        ann.call("x.disable")
        assert ann.mode("automatic").state is CommandState.DONE
        assert ann.x.enabled
        ann.until(lambda: task.done)
        assert ann.slide.position == pytest.approx(45.0, abs=0.06)


def test_an_axis_without_a_motion_keeps_its_integral_over_manual_mode() -> None:
    with bench(servo()) as ann:

        async def program(m: Any) -> None:
            await m.x.move_to(60.0)
            await wait(1.0)

        ann.m.cycle.start(program(ann.m))
        ann.until(lambda: ann.x.state is AxisState.STANDSTILL)
        ann.x.servo.integral = 0.02
        ann.mode("manual")
        ann.mode("automatic")
        assert ann.x.servo.integral != 0.0
        ann.m.cycle.start(ann.m.x.move_to(50.0))  # nothing holds it up
        ann.until(lambda: ann.x.state is AxisState.STANDSTILL and ann.slide.position == pytest.approx(50.0, abs=0.06))


@BOTH
def test_an_axis_that_lost_its_reference_is_refused(make: Make) -> None:
    with bench(make()) as ann:
        ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        ann.mode("manual")
        ann.run(500)
        ann.x.encoder.referenced(False)
        ann.x.disable()
        text = ann.mode("automatic").text
        assert "x has lost its reference; home it (`x.home`)" in text


@BOTH
def test_an_axis_that_the_operator_has_enabled_is_let_go_of_again(make: Make) -> None:
    with bench(make()) as ann:
        ann.mode("manual")
        ann.call("x.jog", velocity=5.0)
        ann.run(50)
        ann.do("let go", "x.jog")
        ann.run(200)
        assert ann.x.enabled
        ann.mode("automatic")
        assert not ann.x.enabled


@BOTH
def test_an_axis_declared_so_is_disabled_and_enabled_again_from_where_it_stands(make: Make) -> None:
    with bench(make(), Disabling) as ann:
        task = ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        ann.mode("manual")
        assert "x is disabled" in ann.notes[-1]
        ann.run(300)
        assert not ann.x.enabled
        ann.slide.position -= 1.0  # a motion goes on from wherever the axis stands
        ann.run(3)
        ann.mode("automatic")
        ann.until(lambda: task.done)
        assert ann.slide.position == pytest.approx(45.0, abs=0.06)


@BOTH
def test_an_axis_declared_so_moves_on_to_its_end(make: Make) -> None:
    with bench(make(), RunningOn) as ann:
        task = ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        ann.mode("manual")
        assert "x moves on to its end" in ann.notes[-1]
        ann.run(2_000)
        assert ann.slide.position == pytest.approx(60.0, abs=0.1)
        ann.mode("automatic")
        ann.until(lambda: task.done)
        assert ann.slide.position == pytest.approx(45.0, abs=0.06)
        assert ann.smooth(*LIMITS[make])


@pytest.mark.parametrize(("make", "at", "jogged"), each_value([servo, stepper], [200, 30, 600, 1_200], [False, True]))
def test_homing_that_was_suspended_goes_on(make: Make, at: int, jogged: bool) -> None:
    x = make()
    x.homing = EndStop(direction=-1, position=-5.0, clearance=10.0)
    with bench(x, referenced=False, start=8.0) as ann:

        async def program(m: Any) -> None:
            await m.x.home()
            await m.x.move_to(20.0)

        task = ann.m.cycle.start(program(ann.m))
        ann.run(at)
        ann.mode("manual")
        ann.run(300)
        if jogged:
            assert ann.call("x.jog", velocity=8.0).state is CommandState.DONE
            ann.run(200)
            ann.do("let go", "x.jog")
            ann.run(100)
        if task.done:
            return
        assert ann.mode("automatic").state is CommandState.DONE
        ann.until(lambda: task.done)
        assert ann.x.encoder.quality is Quality.GOOD
        assert ann.slide.position == pytest.approx(20.0, abs=0.15)


@BOTH
def test_an_axis_that_an_action_has_left_moving_stops_when_the_lease_ends(make: Make) -> None:
    class Feeding(Rail):
        @umo.action
        def feed(self) -> None:
            self.x.jog(5.0)

    with bench(make(), Feeding) as ann:
        ann.mode("manual")
        ann.call("feed")
        ann.run(100)
        assert ann.x.profile.setpoint.velocity == pytest.approx(5.0)
        ann.do("give back")
        ann.run(300)
        assert (ann.x.profile.setpoint.velocity, ann.x.enabled) == (0.0, True)
        assert ann.notes[-1].startswith("the lease has ended: x stops")
        ann.do("lease", seconds=60.0)
        assert ann.call("x.move_to", position=40.0).state is CommandState.BEGUN


class Cut(Slide):
    """A slide of which the encoder may be cut off."""

    cut = False

    def read(self, channel: Any) -> int:
        if self.cut and channel.text == "counter":
            raise DriverError("cut")
        return super().read(channel)


class Lit(Rail):
    lamp: BinaryActuator[OnOff]

    def setup(self) -> None:
        self.suspended = False

    def on_suspend(self) -> None:
        self.suspended = True


@BOTH
def test_an_axis_that_cannot_be_suspended_is_disabled_and_the_change_goes_on(make: Make) -> None:
    """Its encoder fails in the period in which it pushes against an end stop."""
    x = make(encoder=encoder(on_error="mark"))
    x.homing, x.stall = EndStop(direction=-1, position=-5.0, clearance=10.0), 30.0
    slide = Cut(0.0)
    with on_slide(Lit(x=x, lamp=relay(), timer=timer()), slide) as ann:
        ann.m.cycle.start(ann.x.home())
        ann.m.lamp.write(OnOff.ON)
        ann.until(lambda: abs(ann.x.error) > ann.x.following_error)
        slide.cut = True
        assert ann.mode("manual").state is CommandState.DONE
        assert "disabled, as it could not be suspended: BadInput: x.encoder is BAD" in ann.notes
        assert ann.m.suspended
        ann.run()
        assert (ann.x.enabled, ann.x.cycle.fault, ann.m.lamp.read()) == (False, None, OnOff.OFF)
        slide.cut = False
        ann.run(300)
        assert ann.mode("automatic").state is CommandState.DONE


class Port(Slide):
    """A card that sets all outputs in one transfer; the slide sees the direction before a step, or after it."""

    direction_first = True

    def write_many(self, channels: Sequence[Channel], raws: Any) -> None:
        both = zip(channels, map(int, raws), strict=True)
        for channel, raw in sorted(both, key=lambda each: each[0].text, reverse=not self.direction_first):
            self.write(channel, raw)


class StepFirst(Port):
    direction_first = False


@pytest.mark.parametrize("slide", [Port, StepFirst])
@pytest.mark.parametrize(("target", "default"), [(20.0, Rotation.CW), (60.0, Rotation.CCW)])
@pytest.mark.parametrize("at", first(5, [*range(40, 60, 4), *(at for at in range(40, 60) if at % 4)]))
def test_a_change_to_manual_mode_costs_a_stepper_no_step(
    slide: type[Port], target: float, default: Rotation, at: int
) -> None:
    """Its direction is in the charge of its law, as its steps are."""
    x = stepper(direction=direction_output(default))
    with bench(x, slide=slide) as ann:
        ann.m.cycle.start(ann.x.move_to(target))
        ann.run(at)
        ann.mode("manual")
        assert "x.direction" not in ann.notes[-1].partition("to the default")[2].partition(";")[0]
        ann.run(300)
        assert ann.x.commanded == pytest.approx(ann.slide.position, abs=0.03)


@pytest.mark.parametrize(("make", "at"), each_value([servo, stepper], [50, 250, 700]))
def test_an_axis_that_is_homed_stops_although_it_is_declared_to_run_on(make: Make, at: int) -> None:
    x = make()
    x.homing = EndStop(direction=-1, position=-5.0, clearance=10.0)
    with bench(x, RunningOn, referenced=False, start=20.0) as ann:
        task = ann.m.cycle.start(ann.x.home())
        ann.until(lambda: bool(ann.x.profile.setpoint.velocity))
        ann.run(at)
        ann.mode("manual")
        assert "x stops" in ann.notes[-1]
        ann.run(2_000)
        assert (ann.x.profile.setpoint.velocity, ann.x.enabled, ann.x.cycle.fault) == (0.0, True, None)
        ann.mode("automatic")
        ann.until(lambda: task.done)
        assert ann.x.encoder.quality is Quality.GOOD


@BOTH
@pytest.mark.parametrize("referenced", [False, True])
def test_an_axis_that_is_jogged_stops_although_it_is_declared_to_run_on(make: Make, referenced: bool) -> None:
    with bench(make(), RunningOn, referenced=referenced) as ann:
        ann.x.jog(10.0)
        ann.run(100)
        ann.mode("manual")
        assert "x stops" in ann.notes[-1]
        ann.run(300)
        assert ann.x.profile.setpoint.velocity == 0.0


def actuators(axis: Any) -> list[Actuator]:
    return [each for each in atoms(axis) if isinstance(each, Actuator)]


class Guarded(RunningOn):
    lamp: BinaryActuator[OnOff]

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: state_of(self.lamp) is OnOff.ON, [self.x], "the lamp is lit")


@BOTH
def test_a_jog_that_an_interlock_has_interrupted_does_not_run_on_when_it_lets_go(make: Make) -> None:
    with on_slide(Guarded(x=make(), lamp=relay(when_suspended="hold"), timer=timer()), Slide()) as ann:
        ann.x.jog(10.0)
        ann.run(50)
        ann.m.lamp.write(OnOff.ON)
        ann.run(5)
        assert any(each.inhibited for each in actuators(ann.x))
        ann.mode("manual")
        ann.m.lamp.write(OnOff.OFF)
        ann.run(300)
        assert not any(each.inhibited for each in actuators(ann.x))
        assert ann.x.profile.setpoint.velocity == 0.0


@BOTH
@pytest.mark.parametrize("motion", ["move_to", "home"])
def test_an_axis_that_the_operator_disables_during_his_motion_is_not_in_fault(make: Make, motion: str) -> None:
    x = make()
    x.homing = EndStop(direction=-1, position=-5.0, clearance=10.0)
    with bench(x) as ann:
        ann.mode("manual")
        moved = ann.call("x.move_to", position=60.0) if motion == "move_to" else ann.call("x.home")
        ann.until(lambda: bool(ann.x.profile.setpoint.velocity))
        assert ann.call("x.disable").state is CommandState.DONE
        ann.run(3)
        end = [event for event in ann.events if event.command == moved.command][-1]
        assert (end.state, end.text) == (CommandState.FAILED, "AxisError: x was disabled during its motion")
        assert ann.x.cycle.fault is None
        assert ann.mode("automatic").state is CommandState.DONE


def jog_into_a_fault(ann: Bench) -> None:
    """The operator's jog ends in a fault of the axis, which he clears."""
    ann.run(60)
    ann.mode("manual")
    ann.run(300)
    ann.call("x.jog", velocity=10.0)
    ann.run(20)
    ann.slide.stuck = True
    ann.until(lambda: ann.x.cycle.fault is not None)
    ann.slide.stuck = False
    ann.run(50)
    assert "x is in fault" in ann.mode("automatic").text
    assert ann.do("clear", "x").state is CommandState.DONE


@BOTH
@pytest.mark.parametrize("moved", [False, True])
def test_an_application_that_awaits_a_motion_which_a_fault_has_ended_does_not_go_on(make: Make, moved: bool) -> None:
    with bench(make()) as ann:
        task = ann.m.cycle.start(forth_and_back(ann.m))
        jog_into_a_fault(ann)
        ann.x.encoder.referenced(at=ann.slide.position)
        if moved:
            ann.call("x.move_to", position=50.0)
            ann.until(lambda: ann.x.state is AxisState.STANDSTILL)
        refused = ann.mode("automatic")
        assert refused.state is CommandState.REFUSED
        text = "the application cannot continue: x was in fault: its motion has ended; stop the run, and start it again"
        assert refused.text == f"CommandRefused: {text}"
        assert not task.done


@BOTH
def test_an_application_of_which_the_fault_has_ended_the_sequence_as_well_goes_on(make: Make) -> None:
    with bench(make()) as ann:
        task = ann.x.cycle.start(forth_and_back(ann.m))
        jog_into_a_fault(ann)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.run(10)
        assert task.done


@BOTH
def test_an_application_that_awaits_no_motion_of_an_axis_that_was_in_fault_goes_on(make: Make) -> None:
    async def program(m: Any) -> str:
        await wait(2.0)
        return "done"

    with bench(make()) as ann:
        task = ann.m.cycle.start(program(ann.m))
        jog_into_a_fault(ann)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.until(lambda: task.done)
        assert task.result == "done"


class Cell(Compound, equipment=True):
    lamp: BinaryActuator[OnOff]
    broken = False

    def control(self) -> None:
        if self.broken:
            raise RuntimeError("broken")


class Plant(Rail):
    """An axis, and equipment that moves it and is around another part of the machine."""

    cell: Cell


def plant(axis: Axis) -> Plant:
    return Plant(x=axis, timer=timer(), cell=Cell(lamp=relay()))


async def home(m: Any) -> None:
    await m.x.home()


APPLICATIONS = pytest.mark.parametrize("application", [forth_and_back, home])


@contextmanager
def moved_by_a_cell(make: Make, application: Callable[[Any], Any]) -> Iterator[tuple[Bench, Any]]:
    """An axis that a sequence of the cell has moved until the mode became manual; and this sequence."""
    axis = make()
    axis.homing = EndStop(direction=-1, position=-5.0, clearance=10.0)
    with on_slide(plant(axis), Slide(40.0)) as ann:
        ann.x.encoder.referenced(at=40.0)
        task = ann.m.cell.cycle.start(application(ann.m))  # type: ignore[attr-defined]
        ann.until(lambda: abs(ann.x.profile.setpoint.velocity) > 5.0)
        ann.mode("manual")
        ann.run(500)
        assert not task.done
        yield ann, task


def break_cell(ann: Bench, task: Any) -> None:
    ann.m.cell.broken = True  # type: ignore[attr-defined]
    ann.run(2)
    assert task.done
    ann.m.cell.broken = False  # type: ignore[attr-defined]
    assert ann.do("clear", "cell").state is CommandState.DONE


def refused(ann: Bench, path: str, **arguments: Any) -> str:
    number = ann.call(path, **arguments).command
    return [event.text for event in ann.events if event.command == number][-1]


@BOTH
@APPLICATIONS
def test_a_jog_goes_on_until_it_is_let_go_of_if_the_suspended_motion_of_the_application_is_cancelled(
    make: Make, application: Any
) -> None:
    with moved_by_a_cell(make, application) as (ann, task):
        ann.call("x.jog", velocity=10.0)
        ann.run(100)
        break_cell(ann, task)
        ann.run(100)
        assert ann.x.profile.setpoint.velocity == pytest.approx(10.0, abs=0.1)
        assert "busy with jog" in refused(ann, "x.move_to", position=50.0)
        assert ann.do("let go", "x.jog").state is CommandState.DONE
        ann.run(300)
        assert ann.x.profile.setpoint.velocity == 0.0
        assert ann.x.enabled


@BOTH
@APPLICATIONS
def test_an_operators_motion_arrives_if_the_suspended_motion_of_the_application_is_cancelled(
    make: Make, application: Any
) -> None:
    with moved_by_a_cell(make, application) as (ann, task):
        ann.x.encoder.referenced(at=ann.slide.position)
        moved = ann.call("x.move_to", position=70.0)
        assert moved.state is CommandState.BEGUN
        ann.run(100)
        break_cell(ann, task)
        assert "busy with move_to" in refused(ann, "x.jog", velocity=10.0)
        ann.until(lambda: len([each for each in ann.events if each.command == moved.command]) == 2)
        assert [each.state for each in ann.events if each.command == moved.command][-1] is CommandState.DONE
        assert ann.slide.position == pytest.approx(70.0, abs=0.06)


@BOTH
@APPLICATIONS
def test_an_axis_of_which_the_suspended_motion_was_cancelled_is_free_for_the_application(
    make: Make, application: Any
) -> None:
    with moved_by_a_cell(make, application) as (ann, task):
        break_cell(ann, task)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.run(5)
        assert ann.x.enabled is (application is forth_and_back)  # homing that is cancelled disables the axis
        assert ann.x.state is not AxisState.HOMING
        here = ann.slide.position
        ann.run(300)
        assert ann.slide.position == pytest.approx(here, abs=0.06)
        ann.x.encoder.referenced(at=ann.slide.position)
        again = ann.m.cycle.start(ann.x.move_to(50.0))
        ann.until(lambda: again.done)
        assert ann.slide.position == pytest.approx(50.0, abs=0.06)


class Table(ServoAxis, equipment=True): ...


def test_a_motion_of_the_application_that_fails_is_a_fault_although_the_operator_has_disabled_the_axis() -> None:
    async def program(m: Any) -> None:
        with suppress(TaskFailed):
            await m.x.move_to(60.0)

    axis = Table(**SERVO | {"motor": motor(), "encoder": encoder(), "following_error": 1e9, "settling_time": 0.1})
    with bench(axis) as ann:
        ann.m.cycle.start(program(ann.m))
        ann.run(60)
        ann.mode("manual")
        ann.run(300)
        ann.call("x.move_to", position=40.0)
        ann.run(30)
        ann.call("x.disable")
        ann.run(300)
        ann.slide.stuck = True
        assert ann.mode("automatic").state is CommandState.DONE
        ann.run(1000)
        assert "did not arrive" in (ann.x.cycle.fault or "")


class Braked(ServoAxis):
    """An axis whose brake does not answer."""

    def disable(self) -> None:
        if self.enabled and self.cycle.running:
            raise ValueError("the brake did not answer")


def test_an_axis_that_cannot_be_disabled_in_a_change_to_manual_mode_is_not_controlled() -> None:
    with bench(Braked(**SERVO | {"motor": motor(), "encoder": encoder()}), Disabling) as ann:
        ann.m.cycle.start(forth_and_back(ann.m))
        ann.run(60)
        assert ann.mode("manual").state is CommandState.DONE
        assert any("disabled, as it could not be suspended: ValueError: the brake" in note for note in ann.notes)
        ann.run(2)
        assert (ann.x.enabled, ann.x.motor.read()) == (False, ann.x.motor.default)


async def jogging(m: Any) -> None:
    m.x.jog(10.0)
    try:
        await wait(1000.0)
    finally:
        m.x.halt()


async def jogging_on(m: Any) -> None:
    m.x.jog(10.0)
    await wait(1000.0)


async def begin_jog(m: Any) -> None:
    m.x.jog(10.0)


@pytest.mark.parametrize(
    ("make", "application", "operated"), each_value([servo, stepper], [jogging, jogging_on], [False, True])
)
def test_a_suspended_jog_whose_sequence_is_cancelled_is_not_gone_on_with(
    make: Make, application: Any, operated: bool
) -> None:
    with moved_by_a_cell(make, application) as (ann, task):
        if operated:  # in the first of two changes to manual mode, and in the second
            ann.call("x.jog", velocity=-10.0)
            ann.run(100)
            assert ann.mode("automatic").state is CommandState.DONE
            ann.run(10)
            ann.mode("manual")
            ann.call("x.jog", velocity=-10.0)
            ann.run(100)
        break_cell(ann, task)
        ann.run(100)
        assert ann.mode("automatic").state is CommandState.DONE
        ann.run(300)
        assert (ann.x.enabled, ann.x.profile.setpoint.velocity) == (True, 0.0)
        here = ann.slide.position
        ann.run(300)
        assert ann.slide.position == pytest.approx(here, abs=0.06)
        ann.x.encoder.referenced(at=ann.slide.position)
        again = ann.m.cycle.start(ann.x.move_to(50.0))
        ann.until(lambda: again.done)
        assert ann.slide.position == pytest.approx(50.0, abs=0.06)


@BOTH
@pytest.mark.parametrize(("application", "speed"), [(jogging_on, 10.0), (jogging, 0.0)])
def test_an_operators_jog_ends_with_a_suspended_program_only_if_that_halts_the_axis(
    make: Make, application: Any, speed: float
) -> None:
    """No halt is ignored, whoever calls it."""
    with moved_by_a_cell(make, application) as (ann, task):
        ann.x.encoder.referenced(False)
        ann.call("x.jog", velocity=10.0)
        ann.run(100)
        break_cell(ann, task)
        ann.run(100)
        assert ann.x.profile.setpoint.velocity == pytest.approx(speed, abs=0.1)
        ann.do("let go", "x.jog")
        ann.run(300)
        assert ann.x.profile.setpoint.velocity == 0.0


@pytest.mark.parametrize(
    ("make", "application", "operated"), each_value([servo, stepper], [jogging, begin_jog], [False, True])
)
def test_a_suspended_jog_is_gone_on_with_if_nobody_has_cancelled_it(
    make: Make, application: Any, operated: bool
) -> None:
    """Also if the sequence that began it had ended before; and in a second change of the mode."""
    with bench(make(), referenced=False) as ann:
        ann.m.cycle.start(application(ann.m))
        for _ in range(2):
            ann.until(lambda: abs(ann.x.profile.setpoint.velocity) > 9.9)
            ann.mode("manual")
            ann.run(300)
            assert ann.x.profile.setpoint.velocity == 0.0
            if operated:
                ann.call("x.jog", velocity=-5.0)
                ann.run(100)
                ann.do("let go", "x.jog")
                ann.run(300)
            assert ann.mode("automatic").state is CommandState.DONE
        ann.until(lambda: ann.x.profile.setpoint.velocity > 9.9)
