"""Servo and stepper axes on a simulated slide: homing, moving, jogging, interlocks, and what can go wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

import umo
from helpers.axis_rig import Machine, index_pulse, machine, run
from helpers.slide import COUNT, DT, HIGH, INDEX, LOW, SWITCH, Slide, encoder, servo, stepper
from helpers.tiers import each_value
from umo import Compound, DigitalSensor, Interlock, Quality
from umo.control import (
    Axis,
    EndStop,
    HomeSwitch,
    SearchResult,
    ServoAxis,
    move_together,
    next_period,
    together,
    wait,
)
from umo.control.axis_state import AxisState
from umo.errors import AxisError, BadInput, Busy, DeclarationError, HomingError, RangeError
from umo.objects import atoms
from umo.states import EnableDisable, OnOff

BOTH = pytest.mark.parametrize("make", [servo, stepper])


# Homing ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "start"), each_value([servo, stepper], [10.0, 89.0, 97.0]))
def test_homing_finds_the_index_pulse_wherever_the_axis_begins(make: Callable[..., Axis], start: float) -> None:
    m = machine(make(encoder=encoder(zero_offset=INDEX)))
    m.x.homing, slide = index_pulse(m), Slide(start)

    async def work(m: Machine) -> None:
        await m.x.home()
        assert m.x.encoder.quality is Quality.GOOD
        assert m.x.encoder.read() == pytest.approx(slide.position, abs=2 * COUNT)
        assert m.x.encoder.read() == pytest.approx(INDEX - 2.0, abs=0.1)
        assert m.enable.read() is EnableDisable.DISABLE
        await m.x.move_to(20.0)
        assert slide.position == pytest.approx(20.0, abs=0.06)

    run(m, slide, work)


@BOTH
def test_homing_ends_well_when_the_count_is_right_already(make: Callable[..., Axis]) -> None:
    m = machine(make(encoder=encoder(zero_offset=INDEX)))
    m.x.homing, slide = index_pulse(m), Slide(30.0)
    slide.origin = round(INDEX / COUNT)

    async def work(m: Machine) -> None:
        await m.x.home()
        assert m.x.encoder.read() == pytest.approx(slide.position, abs=2 * COUNT)

    run(m, slide, work)


@pytest.mark.parametrize(("make", "start"), each_value([servo, stepper], [1.0, 50.0, LOW, HIGH]))
def test_homing_references_the_edge_of_a_home_switch(make: Callable[..., Axis], start: float) -> None:
    m = machine(make())
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0, clearance=1.0)
    slide = Slide(start)

    async def work(m: Machine) -> None:
        await m.x.home()
        assert slide.position == pytest.approx(SWITCH + 1.0, abs=0.1)
        assert m.x.encoder.read() == pytest.approx(slide.position, abs=0.1)

    run(m, slide, work)


@pytest.mark.parametrize(("make", "after"), each_value([servo, stepper], [1, 3, 5]))
def test_a_home_switch_that_bounces_when_it_is_met_references_its_edge(make: Callable[..., Axis], after: int) -> None:
    m, slide = machine(make()), Slide(50.0)
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0)
    met: list[float] = []

    def watch(m: Machine) -> None:
        if slide.position < SWITCH:
            met.append(m.now)
        slide.switch_broken = len(met) == after

    async def work(m: Machine) -> None:
        await m.x.home()
        assert m.x.encoder.read() == pytest.approx(slide.position, abs=0.1)

    run(m, slide, work, watch)
    assert len(met) > after


@pytest.mark.parametrize(("make", "direction"), each_value([servo, stepper], [-1, 1]))
def test_homing_references_an_end_stop(make: Callable[..., Axis], direction: int) -> None:
    stop = LOW if direction < 0 else HIGH
    m, slide = machine(make(encoder=encoder(minimum=-10.0, maximum=110.0))), Slide()
    m.x.homing = EndStop(position=stop, direction=direction, clearance=8.0)

    async def work(m: Machine) -> None:
        await m.x.home()
        assert m.x.encoder.read() == pytest.approx(stop - 8.0 * direction, abs=0.1)
        assert slide.position == pytest.approx(stop - 8.0 * direction, abs=0.1)

    run(m, slide, work)


def test_the_force_at_an_end_stop_is_limited_during_homing_only() -> None:
    m, slide, largest = machine(servo()), Slide(), {True: 0.0, False: 0.0}
    m.x.homing = EndStop(position=LOW, clearance=10.0)

    def watch(m: Machine) -> None:
        volts = abs(slide.levels["motor"]) / 200
        searching = m.x.state is AxisState.HOMING
        largest[searching] = max(largest[searching], volts)

    async def work(m: Machine) -> None:
        await m.x.home()
        await m.x.move_to(90.0)

    run(m, slide, work, watch)
    assert largest[True] == pytest.approx(3.0, abs=0.01)
    assert largest[False] > 3.5


@BOTH
@pytest.mark.parametrize("fault", ["stuck", "dead"])
def test_an_axis_that_does_not_move_cannot_be_homed(make: Callable[..., Axis], fault: str) -> None:
    m, slide = machine(make(encoder=encoder(zero_offset=INDEX))), Slide()
    m.x.homing = index_pulse(m)
    setattr(slide, fault, True)
    with pytest.raises(HomingError, match="x does not move, or its encoder is dead"):
        run(m, slide, lambda m: m.x.home())
    assert (slide.levels["motor"], slide.levels["step"], slide.levels["enable"]) == (0, 0, 0)


@BOTH
def test_a_switch_that_never_becomes_active_is_named(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide()
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0)
    slide.switch_broken = True
    with pytest.raises(HomingError, match="x found no home switch: switch did not become ON"):
        run(m, slide, lambda m: m.x.home())


def test_an_axis_without_a_way_of_homing_says_so() -> None:
    with pytest.raises(DeclarationError, match="x does not declare how it is homed"):
        run(machine(servo()), Slide(), lambda m: m.x.home())


# Moving ------------------------------------------------------------------------------------------------


async def at_home(m: Machine, slide: Slide) -> None:
    """As if it were homed."""
    await next_period()
    m.x.encoder.referenced(at=slide.position)


@BOTH
def test_a_motion_keeps_its_speed_and_ends_in_the_window(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(40.0)
    speeds: list[float] = []
    last = [slide.position]

    def watch(m: Machine) -> None:
        speeds.append(abs(slide.position - last[0]) / DT)
        last[0] = slide.position

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(60.0, speed=10.0)

    run(m, slide, work, watch)
    assert slide.position == pytest.approx(60.0, abs=0.06)
    travelled = sum(speeds) * DT
    assert travelled == pytest.approx(20.0, abs=0.5)
    assert len(speeds) * DT >= 2.0


@BOTH
def test_a_target_outside_the_declared_range_is_refused(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide()

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(100.1)

    with pytest.raises(RangeError, match=r"x: 100\.1 mm is outside 0 to 100"):
        run(m, slide, work)


@BOTH
def test_an_axis_that_is_not_referenced_is_not_moved(make: Callable[..., Axis]) -> None:
    slide = Slide()

    async def work(m: Machine) -> None:
        await next_period()
        await m.x.move_to(50.0)

    with pytest.raises(BadInput, match="UNREFERENCED"):
        run(machine(make()), slide, work)
    assert slide.position == 40.0


@BOTH
def test_a_second_motion_is_refused(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide()

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await together(m.x.move_to(45.0), m.x.move_to(50.0))

    with pytest.raises(Busy, match="x is busy with move_to; move_to was not started"):
        run(m, slide, work)

    async def jogged(m: Machine) -> None:
        await at_home(m, slide)
        m.x.jog(5.0)
        await m.x.move_to(50.0)

    with pytest.raises(Busy, match="x is busy with jog"):
        run(m, slide, jogged)


@BOTH
@pytest.mark.parametrize("fault", ["stuck", "dead"])
def test_an_axis_that_does_not_follow_ends_the_motion(make: Callable[..., Axis], fault: str) -> None:
    m, slide = machine(make()), Slide()

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(45.0)
        setattr(slide, fault, True)
        await m.x.move_to(80.0)

    with pytest.raises(AxisError, match=r"x (does not follow|lost steps)"):
        run(m, slide, work)


def test_an_axis_that_follows_but_does_not_arrive_says_where_it_stands() -> None:
    m, slide = machine(servo(integral_time=math.inf, gain=0.05, window=0.01)), Slide()

    def watch(m: Machine) -> None:
        if slide.position > 50.0:
            slide.stuck = True  # the slide jams on the last way

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(51.0)

    with pytest.raises(AxisError, match="x did not arrive at 51: it is at 50"):
        run(m, slide, work, watch)


def test_lost_steps_are_made_up() -> None:
    m, slide = machine(stepper()), Slide()

    def watch(m: Machine) -> None:
        slide.stuck = 45.0 < slide.position < 45.2 and m.x.stepping.count < 107  # the rotor misses some steps

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(50.0)

    run(m, slide, work, watch)
    assert slide.position == pytest.approx(50.0, abs=0.03)
    assert m.x.stepping.count > 200


@BOTH
def test_axes_that_move_together_arrive_together(make: Callable[..., Axis]) -> None:
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=1e9, resolution=1.0, synchronous=False)

    class Two(Compound):
        a: Axis
        b: Axis
        timer: DigitalSensor

    m = Two(a=make(), b=make(), timer=timer)
    wire: dict[str, Any] = {"timer": {"driver": "a", "channel": "tick", "period": "1 ms"}}
    on = {"motor": "motor", "step": "step", "direction": "direction", "encoder": "counter"}
    for atom in atoms(m):
        axis, _, part = atom.path.partition(".")
        if part:
            wire[atom.path] = {"driver": axis, "channel": on[part]}
    a, b = Slide(10.0), Slide(40.0)
    arrived: dict[str, float] = {}

    async def work(m: Two) -> None:
        await next_period()
        m.a.encoder.referenced(at=10.0)
        m.b.encoder.referenced(at=40.0)
        m.cycle.start(note("a", a, 40.0))
        m.cycle.start(note("b", b, 50.0))
        await move_together((m.a, 40.0), (m.b, 50.0))

    async def note(name: str, slide: Slide, target: float) -> None:
        while abs(slide.position - target) > 0.5:
            await next_period()
        arrived[name] = m.now

    connection = umo.connect(m, {"drivers": {"a": a, "b": b}, "wire": wire})
    with connection:
        connection.machine.observers.append(lambda frame: b.advance())
        umo.drive(m, work)
    assert (a.position, b.position) == pytest.approx((40.0, 50.0), abs=0.06)
    assert arrived["a"] == pytest.approx(arrived["b"], abs=0.05)


def test_axes_move_together_within_the_limits_that_were_tuned() -> None:
    slow, fast = servo(), servo()
    timer = DigitalSensor("sampling_period", minimum=0.0, maximum=1e9, resolution=1.0, synchronous=False)

    class Two(Compound):
        a: Axis
        b: Axis
        timer: DigitalSensor

    with umo.connect(Two(a=slow, b=fast, timer=timer)) as m:
        m.a.encoder.referenced(at=0.0)
        before = m.a.time_to(100.0)
        m.a.profile.velocity, m.a.profile.acceleration, m.a.profile.jerk = 20.0, 200.0, 5_000.0
        ahead = m.a.time_to(100.0)
        assert ahead > 4 * before
        m.a.enable()
        assert m.a.profile.to(100.0) == pytest.approx(ahead)


# Jogging -----------------------------------------------------------------------------------------------


@BOTH
def test_a_jog_moves_until_it_is_ended(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(40.0)

    async def work(m: Machine) -> None:
        await next_period()
        m.x.jog(10.0)  # not referenced
        await wait(1.0)
        assert slide.position == pytest.approx(50.0, abs=1.0)
        m.x.jog(0.0)
        await wait(0.3)
        stood = slide.position
        await wait(0.3)
        assert slide.position == pytest.approx(stood, abs=0.02)
        m.x.reference(at=slide.position)
        await m.x.move_to(45.0)

    run(m, slide, work)
    assert slide.position == pytest.approx(45.0, abs=0.06)


@BOTH
def test_a_jog_of_a_referenced_axis_stops_at_the_end_of_its_range(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(95.0)

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        m.x.jog(15.0)
        await wait(1.0)
        assert slide.position == pytest.approx(100.0, abs=0.1)
        m.x.jog(15.0)
        await wait(0.2)
        assert slide.position == pytest.approx(100.0, abs=0.1)
        m.x.jog(-15.0)
        await wait(0.5)
        assert slide.position < 96.0

    run(m, slide, work)


# Interlocks and cancelling -----------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "latched"), each_value([servo, stepper], [False, True]))
def test_an_inhibited_axis_waits_and_goes_on_to_its_target(make: Callable[..., Axis], latched: bool) -> None:
    m, slide = machine(make()), Slide(40.0)
    m.latched = latched
    stood: list[float] = []

    def watch(m: Machine) -> None:
        slide.door = int(0.5 < m.now < 2.0)
        if 1.0 < m.now < 2.0:
            stood.append(slide.position)
        if latched and m.now > 2.5:
            m.x.acknowledge()

    async def work(m: Machine) -> float:
        await at_home(m, slide)
        await m.x.move_to(60.0, speed=12.0)
        return m.now

    ended = run(m, slide, work, watch)
    assert slide.position == pytest.approx(60.0, abs=0.06)
    assert max(stood) - min(stood) < 0.05
    assert 42.0 < stood[0] < 50.0
    assert ended > (3.0 if latched else 2.5)


@BOTH
def test_a_cancelled_motion_decelerates_to_standstill(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(20.0)

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        motion = m.cycle.start(m.x.move_to(90.0, speed=12.0))
        await wait(1.0)
        motion.cancel()
        await wait(0.5)
        stood = slide.position
        await wait(0.5)
        assert slide.position == pytest.approx(stood, abs=0.02)
        assert stood < 40.0
        await m.x.move_to(stood - 2.0)

    run(m, slide, work)


def test_a_servo_axis_that_is_disabled_leaves_its_motor_at_the_default() -> None:
    m, slide = machine(servo()), Slide()

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(45.0)
        m.x.disable()
        await wait(0.01)
        assert slide.levels["motor"] == 0
        slide.position = 30.0  # pushed by hand
        await wait(0.1)
        assert slide.position == pytest.approx(30.0, abs=0.1)
        await m.x.move_to(35.0)

    run(m, slide, work)
    assert slide.position == pytest.approx(35.0, abs=0.06)


def test_a_search_tells_what_it_met() -> None:
    m, slide, met = machine(servo()), Slide(), []

    class Own:
        async def find(self, axis: Axis) -> None:
            met.append(await axis.search(20.0, lambda: slide.position > 42.0))
            met.append(await axis.search(20.0, reach=2.0))
            met.append(await axis.search(20.0))
            axis.reference(at=100.0)

    m.x.homing = Own()
    run(m, slide, lambda m: m.x.home())
    assert met == [SearchResult.CONDITION, SearchResult.REACH, SearchResult.STOP]
    assert m.x.encoder.zero_offset == 0.0  # as declared: the reference has ended with the connection


# What a review found -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes", [{"stall": 1.0}, {"jerk": 2_000.0}, {"acceleration": 100.0}], ids=["stall", "jerk", "acceleration"]
)
def test_a_slow_start_is_not_taken_for_the_end_stop(changes: dict[str, float]) -> None:
    m, slide = machine(servo(encoder=encoder(minimum=-10.0, maximum=110.0), **changes)), Slide(48.0)
    m.x.homing = EndStop(position=LOW, clearance=8.0)
    run(m, slide, lambda m: m.x.home())
    assert slide.position == pytest.approx(LOW + 8.0, abs=0.1)


@pytest.mark.parametrize(("make", "acceleration"), [(servo, 500.0), (stepper, 50.0)])
def test_a_reversal_is_not_taken_for_a_standstill(make: Callable[..., Axis], acceleration: float) -> None:
    m, slide = machine(make(acceleration=acceleration)), Slide(20.0)
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0, clearance=1.0)
    run(m, slide, lambda m: m.x.home())
    assert slide.position == pytest.approx(SWITCH + 1.0, abs=0.1)


def test_an_axis_that_is_moved_while_homing_is_inhibited_is_homed_right() -> None:
    m, slide = machine(servo(encoder=encoder(minimum=-10.0, maximum=110.0))), Slide(80.0)
    m.x.homing = EndStop(position=HIGH, direction=1, clearance=8.0)

    def watch(m: Machine) -> None:
        slide.door = int(0.1 < m.now < 0.4)
        if slide.door:
            slide.position -= 0.2  # the arm sinks

    run(m, slide, lambda m: m.x.home(), watch)
    assert slide.position == pytest.approx(HIGH - 8.0, abs=0.1)
    assert slide.start < 80.1


@BOTH
def test_an_index_pulse_is_found_though_an_interlock_has_disabled_the_counters_reset(make: Callable[..., Axis]) -> None:
    class Guarded(Machine):
        def interlocks(self) -> Any:
            yield Interlock(lambda: self.door.read() is OnOff.ON, [self.x, self.enable], "the door is open")

    m = machine(make(encoder=encoder(zero_offset=INDEX)), Guarded)
    m.x.homing, slide = index_pulse(m), Slide(60.0)

    def watch(m: Machine) -> None:
        slide.door = int(m.now < 0.1 or 0.6 < m.now < 0.7)

    run(m, slide, lambda m: m.x.home(), watch)
    assert slide.position == pytest.approx(INDEX - 2.0, abs=0.1)


def test_a_stepper_that_moves_backwards_waits_for_its_interlock_and_starts_with_a_ramp() -> None:
    m, slide = machine(stepper()), Slide(60.0)
    last, speeds = [60.0], [0.0]

    def watch(m: Machine) -> None:
        slide.door = int(0.5 < m.now < 3.0)
        if int(m.now * 1000) % 50 == 0:
            speeds.append(abs(slide.position - last[0]) / 0.05)
            last[0] = slide.position

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(30.0, speed=12.0)

    run(m, slide, work, watch)
    assert slide.position == pytest.approx(30.0, abs=0.06)
    assert max(speeds) < 14.0


@BOTH
def test_a_disabled_axis_ends_its_motion_and_forgets_it(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(40.0)

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        motion = m.cycle.start(caught(m.x.move_to(80.0)))
        await wait(0.3)
        m.x.disable()
        assert "x was disabled during its motion" in str(await motion)
        await wait(0.2)
        slide.position = 30.0
        await wait(0.3)
        m.x.reference(at=slide.position)
        m.x.enable()
        await wait(0.2)
        slide.door = 1
        await wait(0.2)
        slide.door = 0
        await wait(1.0)
        assert slide.position == pytest.approx(30.0, abs=0.2)
        m.x.jog(5.0)
        m.x.disable()
        await m.x.move_to(32.0)

    run(m, slide, work)
    assert slide.position == pytest.approx(32.0, abs=0.06)


async def caught(work: Coroutine[Any, Any, Any]) -> Exception | None:
    try:
        await work
    except Exception as error:
        return error
    return None


@BOTH
def test_an_axis_at_rest_stays_where_an_interlock_let_it_be_pushed(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(40.0)

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(60.0)
        slide.door = 1
        await wait(0.2)
        slide.position -= 20.0
        await wait(0.2)
        slide.door = 0
        await wait(0.5)

    run(m, slide, work)
    assert slide.position == pytest.approx(40.0, abs=0.5)


@BOTH
def test_a_move_after_a_jog_without_reference_is_refused_by_itself(make: Callable[..., Axis]) -> None:
    m, slide = machine(make()), Slide(40.0)

    async def work(m: Machine) -> Any:
        await next_period()
        m.x.jog(10.0)
        await wait(0.1)
        m.x.jog(0.0)
        return str(await caught(m.x.move_to(30.0)))

    assert "UNREFERENCED" in run(m, slide, work)


def test_lost_steps_are_not_made_up_for_ever() -> None:
    m, slide = machine(stepper(encoder=encoder(maximum=120.0))), Slide(100.0)

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(105.6)  # 0.6 mm beyond the end stop

    with pytest.raises(AxisError, match=r"x did not arrive at 105\.6"):
        run(m, slide, work)


@BOTH
def test_a_search_ends_without_an_end_stop_that_is_noticed(make: Callable[..., Axis]) -> None:
    m, slide = machine(make(stall=math.inf)), Slide(90.0)
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0)
    slide.switch_broken = True
    with pytest.raises(HomingError, match="x found no home switch"):
        run(m, slide, lambda m: m.x.home())


def test_the_force_is_not_limited_after_homing_that_failed() -> None:
    m, slide = machine(servo()), Slide(40.0)
    m.x.homing = HomeSwitch(switch=m.switch, active=OnOff.ON, position=SWITCH, creep_speed=5.0)
    slide.switch_broken = True

    async def work(m: Machine) -> None:
        assert isinstance(await caught(m.x.home()), HomingError)

    run(m, slide, work)
    assert isinstance(m.x, ServoAxis)
    assert m.x.servo.limit == math.inf


@pytest.mark.parametrize("name", ["velocity", "jerk", "window", "search_speed", "stall", "step_size"])
def test_a_number_of_an_axis_that_is_not_above_0_is_refused(name: str) -> None:
    for number in (0.0, -1.0, "300 mm/s", True):
        with pytest.raises(DeclarationError, match=rf"Stepper\.{name} must be above 0, not "):
            stepper(**{name: number})


def test_homing_that_cannot_work_is_refused() -> None:
    with pytest.raises(DeclarationError, match="direction is -1 or 1, not -2"):
        EndStop(position=0.0, direction=-2)
    m = machine(servo(stall=math.inf))
    m.x.homing = EndStop(position=0.0)
    with pytest.raises(DeclarationError, match="x: homing on an end stop requires `stall`"):
        run(m, Slide(), lambda m: m.x.home())


def test_a_motion_ends_when_the_axis_has_stayed_in_its_window() -> None:
    m, slide = machine(servo(window_time=0.05, gain=8.0, integral_time=0.03)), Slide(40.0)
    errors: list[float] = []

    def watch(m: Machine) -> None:
        errors.append(abs(m.x.error))

    async def work(m: Machine) -> None:
        await at_home(m, slide)
        await m.x.move_to(60.0)
        assert max(errors[-45:]) < 0.05

    run(m, slide, work, watch)
